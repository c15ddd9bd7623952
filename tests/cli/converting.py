"""Run `usdsplat convert`, or another command, on many files, each in a separate process.

One process imports the commands and is forked for every file. It has run nothing before, so a child
behaves like a process that a user starts.
"""

from __future__ import annotations

import faulthandler
import importlib
import json
import os
import resource
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
    seconds: float
    """[s] processor time."""


def convert_each(
    pairs: Iterable[tuple[Path, Path]], command: str = "convert {} {}"
) -> list[Converted]:
    """Convert each source to its target.

    Args:
        pairs: Sources and targets.
        command: Command line, with {} for the source and for the target, if it has one.
    """
    done = subprocess.run(
        [sys.executable, "-m", "tests.cli.converting", *command.split()],
        input="\n".join(json.dumps([str(path) for path in pair]) for pair in pairs),
        capture_output=True,
        text=True,
        cwd=Path(__file__).resolve().parents[2],
    )
    assert done.returncode == 0, done.stderr
    return [Converted(**json.loads(line)) for line in done.stdout.splitlines()]


def _converted(command: list[str], source: str, target: str) -> Converted:
    with tempfile.TemporaryFile() as errors, tempfile.TemporaryFile() as memory:
        child = os.fork()
        if child == 0:
            paths = iter((source, target))
            words = [next(paths) if word == "{}" else word for word in command]
            _run_and_exit(words, errors.fileno(), memory.fileno())
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        errors.seek(0)
        memory.seek(0)
        said = errors.read().decode().splitlines()
        peak, seconds = json.loads(memory.read() or b"[-1, -1]")
        return Converted(source, target, status, said, peak, seconds)


def _run_and_exit(words: list[str], errors: int, memory: int) -> None:
    """The child: never returns."""
    from usdsplat.cli.main import main

    status = 70  # what a shell would not mistake for one of ours
    try:
        os.dup2(errors, 2)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        faulthandler.dump_traceback_later(_HANG_S, exit=True)
        status = main(words)
        lines = Path("/proc/self/status").read_text().splitlines()
        peak = next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) // 1024
        used = resource.getrusage(resource.RUSAGE_SELF)
        os.write(memory, json.dumps([peak, used.ru_utime + used.ru_stime]).encode())
    finally:
        sys.stderr.flush()
        os._exit(status)


if __name__ == "__main__":
    modules = ["pxr.Usd", f"usdsplat.cli.{sys.argv[1]}", "usdsplat.interchange"]
    modules += ["usdsplat.cli.stages", "usdsplat.products.checking"]
    for module in modules:
        importlib.import_module(module)  # so that no conversion is measured with its imports
    for line in sys.stdin.read().splitlines():
        print(json.dumps(asdict(_converted(sys.argv[1:], *json.loads(line)))), flush=True)
