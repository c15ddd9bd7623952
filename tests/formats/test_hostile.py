"""Bombs and damaged files: a sentence, little memory, and nothing but our own errors."""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from tests.formats.hostile import bombs, mutations, zeros_in_gzip
from tests.formats.samples import spz_header
from usdsplat import formats
from usdsplat.core.errors import UsdSplatError

MEMORY_LIMIT_MB = 500
"""Of a whole process, Python and NumPy included."""

READ_EACH = """
import sys
from pathlib import Path
from usdsplat import formats
from usdsplat.core.errors import UsdSplatError
for path in sys.argv[1:]:
    try:
        print(f"read {len(formats.read(path).cloud)}")
    except UsdSplatError as error:
        print(error)
    # Not getrusage: its maximum counts the process that started this one.
    lines = Path("/proc/self/status").read_text().splitlines()
    print(next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) // 1024)
"""

linux_only = pytest.mark.skipif(
    not Path("/proc/self/status").exists(), reason="the system does not tell the highest memory"
)


def read_in_a_process(paths: list[Path]) -> list[tuple[str, int]]:
    """What reading each said, and the highest memory so far [MB], in one fresh process."""
    command = [sys.executable, "-W", "error", "-c", READ_EACH, *map(str, paths)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    assert done.stderr == ""
    lines = done.stdout.splitlines()
    return list(zip(lines[::2], map(int, lines[1::2]), strict=True))


@linux_only
def test_bombs_are_refused_in_a_sentence_and_little_memory(tmp_path):
    """Oracle: the shape of every error, and the memory that the system counted."""
    paths = bombs(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    for path, (said, memory) in zip(paths, read_in_a_process(paths), strict=True):
        assert said.startswith(f"{path}: ") and ": found " in said and ", expected " in said, said
        assert len(said) < 400 + len(str(path))
        assert memory < MEMORY_LIMIT_MB / 2, path
    assert sorted(tmp_path.rglob("*")) == before


@linux_only
def test_the_largest_claim_that_is_believed_fits_the_memory(tmp_path):
    """Oracle: a million equal splats are a legal file, however small; the system counts memory."""
    path = tmp_path / "equal.spz"
    path.write_bytes(zeros_in_gzip(spz_header(1 << 20, degree=3), (1 << 20) * 64))
    ((said, memory),) = read_in_a_process([path])
    assert said == "read 1048576"
    assert memory < MEMORY_LIMIT_MB


@pytest.mark.parametrize("seed", range(4))
def test_damaged_files_are_refused_or_read_as_finite_clouds(data, tmp_path, seed):
    """Oracle: whatever else escapes, a warning included, is a bug."""
    read = 0
    for path in mutations(data, tmp_path, 100, seed):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                cloud = formats.read(path).cloud
            except UsdSplatError as error:
                assert "\n" not in str(error)
                assert str(error).startswith(str(path))
                continue
        read += 1
        for values in (cloud.positions, cloud.scales, cloud.rotations, cloud.opacities, cloud.sh):
            assert np.isfinite(values).all(), path
        assert cloud.scales.min(initial=0) >= 0
    assert 10 < read < 90  # neither harmless nor hopeless


def test_faults_are_the_same_for_the_same_seed(data, tmp_path):
    """Oracle: the bytes of a second run."""
    runs = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        runs.append(list(mutations(data, tmp_path / name, 20, seed=7)))
    for first, second in zip(*runs, strict=True):
        assert first.name == second.name
        if first.is_file():
            assert first.read_bytes() == second.read_bytes()
