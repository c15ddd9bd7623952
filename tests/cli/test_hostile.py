"""Tests of corrupt and malicious files on the command line, each in a separate process."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.cli.converting import Converted, convert_each
from tests.formats.hostile import bombs
from tests.formats.mutations import mutations
from tests.formats.reading import MEMORY_LIMIT_MB, linux_only

SAMPLE = 100
"""Damaged files that are converted."""


def convert_all(sources, folder):
    """Convert each source to a stage in `folder`, which is new."""
    folder.mkdir()
    pairs = [(source, folder / f"{number}.usdc") for number, source in enumerate(sources)]
    done = convert_each(pairs)
    assert len(done) == len(pairs)
    return done


def check_refused(done: Converted) -> None:
    """One sentence, status 2, nothing written, little memory."""
    assert done.status == 2, done
    assert len(done.said) == 1, done
    (sentence,) = done.said
    assert sentence.startswith("usdsplat: ") and "Traceback" not in sentence
    assert ": found " in sentence and ", expected " in sentence
    assert done.peak < MEMORY_LIMIT_MB, done
    assert not Path(done.target).exists()


@linux_only
def test_every_bomb_and_every_lie_is_one_sentence(data, tmp_path):
    """Oracle: the contract of errors, and the memory that the system counted."""
    lies = sorted((data / "hostile").iterdir())
    assert len(lies) >= 8
    for done in convert_all([*lies, *bombs(tmp_path)], tmp_path / "out"):
        check_refused(done)
    assert list((tmp_path / "out").iterdir()) == []


@linux_only
def test_damaged_files_are_a_stage_or_one_sentence(data, tmp_path):
    """Oracle: status 0 with a stage that exists, or status 2 with one sentence and none."""
    converted = convert_all(mutations(data, tmp_path, SAMPLE, seed=5), tmp_path / "out")
    stages = [Path(done.target) for done in converted if done.status == 0]
    for done in converted:
        if done.status == 0:
            assert done.peak < MEMORY_LIMIT_MB, done
        else:
            check_refused(done)
    assert SAMPLE / 10 < len(stages) < SAMPLE * 0.9  # neither harmless nor hopeless
    assert sorted((tmp_path / "out").iterdir()) == sorted(stages)


def test_a_process_that_a_user_starts_says_the_same(data, tmp_path):
    """Oracle: the sentence of the process that was forked."""
    source, target = data / "hostile" / "count_lies.ply", tmp_path / "a.usdc"
    command = "import sys; from usdsplat.cli.main import main; sys.exit(main(sys.argv[1:]))"
    done = subprocess.run(
        [sys.executable, "-c", command, "convert", str(source), str(target)],
        capture_output=True,
        text=True,
    )
    (forked,) = convert_each([(source, target)])
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.splitlines() == forked.said
    check_refused(forked)
