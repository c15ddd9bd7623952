"""Run commands while writing fails, and judge what they leave.

A run is judged by four statements: the exit status is 0 only if the result is whole; the earlier
file at the target is unchanged, or the new one is whole; nothing else is left; and at most one line
is said, without a traceback.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO

from tests.faults import results

SOURCE = Path(__file__).with_name("shim.c")
OLD = b"an earlier file"
OUT = "out"
KILLED, INTERRUPTED = -9, 130
_UNCOUNTED = re.compile(
    r"\([0-9]+ %(, .*)?\)$| so far(, .* was expected)?$|^libpng error: No IDATs"
)
"""Lines of progress, and what libpng prints after an interrupt while it opens a file."""


@dataclass(frozen=True, slots=True)
class Command:
    """A command that writes."""

    name: str
    arguments: tuple[str, ...]
    """Arguments; the results lie in the folder OUT."""
    targets: tuple[str, ...]
    """Files that it writes in the folder OUT."""
    kept: tuple[str, ...] = ()
    """Names in OUT that a failed run may leave if a checkpoint is among them, for --resume, or if
    they are whole and only the last step failed."""
    work: tuple[str, ...] = ()
    """Names in OUT that a failed run may leave, from which the same command continues."""

    @property
    def replaced(self) -> tuple[str, ...]:
        """Targets at which an earlier file is before a run."""
        files = [name for name in self.targets if "." in name and not name.endswith(".clips")]
        return () if self.kept else tuple(name for name in files if "/" not in name)


SMALL = ("--resolution", "32x24", "--threads", "1")
FRAMES = ("--frames", "1:3", "--threads", "1")


def _convert(source: str, name: str) -> Command:
    return Command(f"convert to {name}", ("convert", source, f"{OUT}/{name}"), (name,))


def _render(name: str, *more: str) -> Command:
    arguments = ("render", "stage.usda", "-o", f"{OUT}/{name}", *SMALL, *more)
    return Command(f"render {' '.join((name, *more))}", arguments, (name,))


COMMANDS = (
    *(_convert("scan.ply", f"o{suffix}") for suffix in (".usda", ".usdc", ".usdz")),
    *(_convert("stage.usda", f"o{suffix}") for suffix in (".ply", ".spz", ".sog", ".splat")),
    _convert("stage.usda", "o.compressed.ply"),
    _convert("stage.usda", "o.glb"),
    Command(
        "convert to o/meta.json", ("convert", "stage.usda", f"{OUT}/o/meta.json"), ("o/meta.json",)
    ),
    Command(
        "convert --split",
        ("convert", "two.usda", f"{OUT}/o.ply", "--split"),
        ("o_A.ply", "o_B.ply"),
    ),
    Command(
        "convert a sequence to clips",
        ("convert", "scan.####.ply", f"{OUT}/o.usda", "--clips"),
        ("o.usda", "o.clips"),
    ),
    Command(
        "lod",
        ("lod", "scan.ply", "-o", f"{OUT}/o.usda", "--leaf-splats", "256"),
        ("o.usda", "o_chunks"),
        work=(".o.usda.building",),
    ),
    _render("o.exr"),
    _render("o.exr", "--aovs", "color,Z,id"),
    _render("o.exr", "--deep"),
    _render("o.png"),
    Command(
        "simulate",
        ("simulate", "push.usda", "-o", f"{OUT}/o.usda", *FRAMES, "--force"),
        ("o.usda", "o_data"),
        ("o.usda", "o_data"),
    ),
)


@dataclass(frozen=True, slots=True)
class Ended:
    """A command that has ended."""

    status: int
    said: str


@dataclass(frozen=True, slots=True)
class Verdict:
    """What is wrong with what a run left; empty texts if nothing is."""

    fault: str
    status: int
    lost: str = ""
    litter: str = ""
    talk: str = ""

    @property
    def is_clean(self) -> bool:
        """Whether nothing is wrong."""
        return not (self.lost or self.litter or self.talk)


@dataclass(slots=True)
class Runner:
    """Runs commands with faults, in an empty folder OUT each time.

    Args:
        folder: Folder with the inputs.
        shim: The compiled `shim.c`.
    """

    folder: Path
    shim: Path
    _process: subprocess.Popen[str] = field(init=False)
    _wanted: dict[str, object] = field(default_factory=dict)
    _remarks: dict[str, set[str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        environment = {**os.environ, "LD_PRELOAD": str(self.shim)}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.faults.server"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
            text=True,
        )

    def close(self) -> None:
        """End the server."""
        _pipe(self._process.stdin).close()
        self._process.wait()
        _pipe(self._process.stdout).close()

    @property
    def out(self) -> Path:
        """Folder of results."""
        return self.folder / OUT

    def start(self, command: Command) -> None:
        """Empty the folder of results, but for an earlier file at each target that is a file."""
        shutil.rmtree(self.out, ignore_errors=True)
        self.out.mkdir()
        for name in command.replaced:
            (self.out / name).write_bytes(OLD)

    def run(
        self, command: Command, fault: tuple[str, int] | None = None, limit: int | None = None
    ) -> Ended:
        """Run a command."""
        task = {
            "arguments": command.arguments,
            "folder": str(self.folder),
            "fault": fault and (f"{self.out}/", *fault),
            "log": str(self.folder / "log.txt"),
            "limit": limit,
        }
        _pipe(self._process.stdin).write(json.dumps(task) + "\n")
        _pipe(self._process.stdin).flush()
        return Ended(*json.loads(_pipe(self._process.stdout).readline()))

    def calls(self, command: Command) -> list[str]:
        """Return the names of the calls that write, in a run without faults."""
        log = self.folder / "log.txt"
        log.unlink(missing_ok=True)
        self.start(command)
        ended = self.run(command, ("count", 0))
        assert ended.status == 0, ended.said
        self._wanted[command.name] = self._read(command)
        self._remarks[command.name] = set(ended.said.splitlines())
        return log.read_text().splitlines()

    def judge(
        self, command: Command, fault: tuple[str, int] | None = None, limit: int | None = None
    ) -> Verdict:
        """Run a command with a fault, after `calls`, and judge what is left."""
        self.start(command)
        ended = self.run(command, fault, limit)
        name = f"at most {limit} bytes" if fault is None else f"{fault[0]} at {fault[1]}"
        verdict = Verdict(name, ended.status)
        if ended.status == KILLED:
            problem = self._lost(command, is_done=False)
            ended = self.run(command)
            if ended.status:
                problem = problem or f"the next run: {ended.status} {ended.said}"
            verdict = replace(verdict, lost=problem or self._lost(command, is_done=True))
            return replace(verdict, litter=self._litter(command, is_done=True))
        is_done = ended.status == 0
        problem = self._lost(command, is_done=is_done)
        if ended.status not in (0, 2, INTERRUPTED):
            problem = problem or "an unexpected status"
        lines = [line for line in ended.said.splitlines() if not _UNCOUNTED.search(line)]
        own = [line for line in lines if line not in self._remarks[command.name]]
        return replace(
            verdict,
            lost=problem,
            litter=self._litter(command, is_done=is_done),
            talk="" if is_done or len(own) == 1 else ended.said or "nothing is said",
        )

    def _lost(self, command: Command, *, is_done: bool) -> str:
        """Say what is lost: a result that is neither the earlier file nor whole."""
        try:
            if is_done:
                is_same = self._read(command) == self._wanted[command.name]
                return "" if is_same else "another result than without a fault"
            for name in command.targets:
                path = self.out / name
                is_old = path.is_file() and path.read_bytes() == OLD
                if path.exists() and not (is_old or name in command.kept):
                    results.read(path)
        except Exception as error:
            return f"{type(error).__name__}: {error}"
        missing = [name for name in command.replaced if not (self.out / name).exists()]
        return f"no {', '.join(missing)}" if missing else ""

    def _litter(self, command: Command, *, is_done: bool) -> str:
        """Return the names of other files than the targets."""
        allowed = {name.partition("/")[0] for name in command.targets}
        found = {path.name for path in self.out.iterdir()} - allowed
        found -= set() if is_done else set(command.work)
        inside = {
            path.name
            for name in allowed
            for path in (self.out / name).rglob("*")
            if path.name.startswith(".") or (is_done and not results.is_part(path))
        }
        left = {name for name in command.kept if (self.out / name).exists()}
        if left and not is_done and not any(self.out.rglob("checkpoint")):
            is_whole = left == {*command.kept} and self._read(command) == self._wanted[command.name]
            found |= set() if is_whole else left
        return " ".join(sorted(found | inside))

    def _read(self, command: Command) -> list[object]:
        return [results.read(self.out / name) for name in command.targets]


def compile_shim(folder: Path) -> Path | None:
    """Compile `shim.c`; None if there is no compiler, or this is not Linux."""
    compiler = shutil.which("cc")
    if compiler is None or not sys.platform.startswith("linux"):
        return None
    shim = folder / "shim.so"
    options = ["-shared", "-fPIC", "-O1", "-o", str(shim), str(SOURCE), "-ldl"]
    subprocess.run([compiler, *options], check=True)
    return shim


def faults(calls: Sequence[str], *, wide: bool) -> list[tuple[str, int]]:
    """Return the faults to try on a command with these calls.

    Of the calls that write, the first, the middle and the last, or about 20 with both ends dense;
    the last rename, or four.
    """
    count = len(calls)
    renames = [number for number, name in enumerate(calls, 1) if name == "rename"]
    uses_stdio = "fwrite" in calls
    if wide:
        dense = {*range(1, 6), *range(count - 4, count + 1)}
        numbers = sorted({*dense, *range(1, count, max(1, count // 10))} & {*range(1, count + 1)})
        some = numbers[:: max(1, len(numbers) // 6)]
        ends = [*some, *renames[-4:]]
        modes = [("enospc", numbers), ("once", ends), ("kill", ends), ("stop", ends)]
        modes.append(("lost", numbers[::3] if uses_stdio else []))
    else:
        modes = [
            ("enospc", sorted({1, count // 2, count - 2})),
            ("once", sorted({count // 2, renames[-1]})),
            ("kill", sorted({count // 2, renames[-1]})),
            ("stop", [count // 2]),
            ("lost", [count * 2 // 3] if uses_stdio else []),
        ]
    return [(mode, number) for mode, numbers in modes for number in numbers if number > 0]


def limits(size: int, *, wide: bool) -> list[int]:
    """Return sizes of files to allow, below the size of a result [byte]."""
    missing = (1, 2, 30, 200, 1500, size // 3, size // 2, size - 1) if wide else (1, 200, size // 2)
    return [size - each for each in missing if 0 <= size - each < size]


def _pipe(found: IO[str] | None) -> IO[str]:
    assert found is not None
    return found
