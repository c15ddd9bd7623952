"""Tests with thousands of damaged files of every format: each gives an error or a valid cloud."""

from __future__ import annotations

import shutil
import time
from collections import defaultdict

import pytest

from tests.folded import folded
from tests.formats.mutations import mutations, sources
from tests.formats.reading import MEMORY_LIMIT_MB, check_sentence, linux_only, read_in_a_process
from usdsplat import formats

CHUNKS, EACH = 8, 260
"""2,080 files where CI looks; the sweep takes ten times as many of other seeds."""


def run(data, folder, seed, count):
    """Read `count` damaged captures, check each, and return what came of them.

    Odd seeds leave out splats that are not finite, even ones refuse them.
    """
    outcomes = read_in_a_process(mutations(data, folder, count, seed), drop=bool(seed % 2))
    assert len(outcomes) == count
    for outcome in outcomes:
        assert outcome.bug == "", f"{outcome.path}\n{outcome.bug}"
        assert outcome.peak < MEMORY_LIMIT_MB, outcome
        if outcome.splats < 0:
            check_sentence(outcome)
    shutil.rmtree(folder)
    return outcomes


@linux_only
@pytest.mark.parametrize("seed", folded(range(CHUNKS), keep=2))
def test_damaged_files_are_refused_or_read_as_sound_clouds(data, tmp_path, seed):
    """Oracle: whatever else escapes, a warning included, is a bug; the system counts memory."""
    outcomes = run(data, tmp_path, seed, EACH)
    read = sum(outcome.splats >= 0 for outcome in outcomes)
    assert EACH / 10 < read < EACH * 0.9  # neither harmless nor hopeless


@linux_only
@pytest.mark.slow
def test_ten_times_as_many_of_other_seeds(data, tmp_path):
    """Oracle: as above. Prints what each kind of file took at most."""
    worst = defaultdict(lambda: [0, 0, 0.0, 0])
    for seed in range(1000, 1000 + 10 * CHUNKS):
        (tmp_path / "chunk").mkdir()
        for outcome in run(data, tmp_path / "chunk", seed, EACH):
            name = next(part for part in outcome.path.split("/") if part[:5].isdecimal())
            row = worst[name.rsplit("_", 1)[1]]
            row[0] += 1
            row[1] += outcome.splats >= 0
            row[2:] = max(row[2], outcome.seconds), max(row[3], outcome.peak)
    print(f"\n{'kind':20} {'files':>6} {'read':>6} {'longest [s]':>12} {'most [MB]':>10}")
    for name, (count, read, seconds, peak) in sorted(worst.items()):
        print(f"{name:20} {count:6} {read:6} {seconds:12.3f} {peak:10}")


def test_every_format_is_among_the_good_files(data, tmp_path):
    """Oracle: the registry; undamaged, each source is read by its format and all are."""
    found = set()
    for source in sources(data):
        folder = tmp_path / source.name
        for name, content in source.files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
        alone = next(iter(source.files)) if len(source.files) == 1 else ""
        path = folder / (source.opened or alone)
        assert len(formats.read(path).cloud) > 0
        found.add(formats.find(path))
    assert found == set(formats.FORMATS)


def test_faults_are_the_same_for_the_same_seed(data, tmp_path, monkeypatch):
    """Oracle: the bytes of a second run, in another year."""
    runs = []
    now = time.time()
    for name, years in (("a", 0), ("b", 1)):
        monkeypatch.setattr(time, "time", lambda years=years: now + years * 3.2e7)
        (tmp_path / name).mkdir()
        made = list(mutations(data, tmp_path / name, 60, seed=7))
        runs.append([(path.name, path.read_bytes()) for path in made if path.is_file()])
    assert runs[0] == runs[1]
