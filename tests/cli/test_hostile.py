"""Hostile files at the command line, each in a process of its own: what a user would meet."""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.formats.hostile import bombs, mutations

CONVERT = """
import sys
from pathlib import Path
from usdsplat.cli.main import main
status = main(["convert", *sys.argv[1:]])
lines = Path("/proc/self/status").read_text().splitlines()
print(next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) // 1024)
sys.exit(status)
"""
MEMORY_LIMIT_MB = 500
TIMEOUT_S = 60
"""Generous: a test asserts no wall-clock time. The acceptance run prints what each took."""

linux_only = pytest.mark.skipif(
    not Path("/proc/self/status").exists(), reason="the system does not tell the highest memory"
)


def convert(source, target):
    """Run `usdsplat convert` in a process: (status, lines on stderr, highest memory [MB])."""
    done = subprocess.run(
        [sys.executable, "-c", CONVERT, str(source), str(target)],
        capture_output=True, text=True, timeout=TIMEOUT_S,
    )  # fmt: skip
    assert done.returncode in (0, 2), done.stderr
    return done.returncode, done.stderr.splitlines(), int(done.stdout.splitlines()[-1])


def check_refused(source, target):
    """One sentence, status 2, nothing written, little memory."""
    status, said, memory = convert(source, target)
    assert status == 2, (source, said)
    (sentence,) = said
    assert sentence.startswith("usdsplat: ") and "Traceback" not in sentence
    assert ": found " in sentence and ", expected " in sentence
    assert memory < MEMORY_LIMIT_MB
    assert not target.exists()


@linux_only
def test_every_bomb_and_every_lie_is_one_sentence(data, tmp_path):
    """Oracle: the contract of errors, and the memory that the system counted."""
    known = (".ply", ".spz", ".sog")
    lies = [path for path in sorted((data / "hostile").iterdir()) if path.suffix in known]
    assert len(lies) >= 7
    files = [*lies, *bombs(tmp_path)]
    targets = [tmp_path / "out" / f"{i}.usdc" for i in range(len(files))]
    (tmp_path / "out").mkdir()
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(check_refused, files, targets))
    assert list((tmp_path / "out").iterdir()) == []


@linux_only
def test_damaged_files_are_a_stage_or_one_sentence(data, tmp_path):
    """Oracle: status 0 with a stage that exists, or status 2 with one sentence and none."""

    def check(numbered):
        i, source = numbered
        target = tmp_path / "out" / f"{i}.usdc"
        status, said, memory = convert(source, target)
        assert target.exists() == (status == 0)
        assert memory < MEMORY_LIMIT_MB
        if status == 2:
            assert len(said) == 1 and said[0].startswith("usdsplat: ")

    (tmp_path / "out").mkdir()
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(check, enumerate(mutations(data, tmp_path, 24, seed=5))))
