"""Run `usdsplat convert` on many files, each in a separate process.

One process imports the command and is forked for every file. It has run nothing before, so a child
behaves like a process that a user starts.
"""

from __future__ import annotations

import faulthandler
import importlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

_HANG_S = 60  # generous: no test asserts a time, but none waits for ever


@dataclass(frozen=True, slots=True)
class Converted:
    """What a process came to."""

    source: str
    target: str
    status: int
    said: list[str]
    """Lines on stderr."""
    peak: int
    """[MB] the most memory that the process had."""


def convert_each(pairs: Iterable[tuple[Path, Path]]) -> list[Converted]:
    """Convert each source to its target."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.cli.converting"],
        input="\n".join(json.dumps([str(path) for path in pair]) for pair in pairs),
        capture_output=True,
        text=True,
        cwd=Path(__file__).resolve().parents[2],
    )
    assert done.returncode == 0, done.stderr
    return [Converted(**json.loads(line)) for line in done.stdout.splitlines()]


def _converted(source: str, target: str) -> Converted:
    with tempfile.TemporaryFile() as errors, tempfile.TemporaryFile() as memory:
        child = os.fork()
        if child == 0:
            _convert_and_exit(source, target, errors.fileno(), memory.fileno())
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        errors.seek(0)
        memory.seek(0)
        said = errors.read().decode().splitlines()
        return Converted(source, target, status, said, int(memory.read() or b"-1"))


def _convert_and_exit(source: str, target: str, errors: int, memory: int) -> None:
    """The child: never returns."""
    from usdsplat.cli.main import main

    status = 70  # what a shell would not mistake for one of ours
    try:
        os.dup2(errors, 2)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        faulthandler.dump_traceback_later(_HANG_S, exit=True)
        status = main(["convert", source, target])
        lines = Path("/proc/self/status").read_text().splitlines()
        peak = next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) // 1024
        os.write(memory, str(peak).encode())
    finally:
        sys.stderr.flush()
        os._exit(status)


if __name__ == "__main__":
    for module in ("pxr.Usd", "usdsplat.cli.convert", "usdsplat.interchange"):
        importlib.import_module(module)  # so that no conversion is measured with its imports
    for line in sys.stdin.read().splitlines():
        print(json.dumps(asdict(_converted(*json.loads(line)))), flush=True)
