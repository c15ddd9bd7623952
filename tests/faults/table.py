"""Write `build/faults.md`: what each command leaves at each fault.

python -m tests.faults.table
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from queue import SimpleQueue

from tests.faults.harness import COMMANDS, Command, Runner, Verdict, compile_shim, faults, limits
from tests.faults.inputs import write_inputs

TARGET = Path(__file__).parents[2] / "build" / "faults.md"
RUNNERS = 3
"""Commands that are tried at a time; a run waits for the disk for most of its time."""
FAULTS = {
    "enospc": "full disk from a write on",
    "once": "one failing call",
    "lost": "writes that fail when the file is closed",
    "kill": "SIGKILL, then the same command again",
    "stop": "SIGINT",
    "at": "limited size of files",
}


@dataclass(frozen=True, slots=True)
class Row:
    """The runs of a command with one kind of fault."""

    command: str
    kind: str
    verdicts: tuple[Verdict, ...]

    @property
    def wrong(self) -> list[Verdict]:
        """Runs that are not clean."""
        return [verdict for verdict in self.verdicts if not verdict.is_clean]

    def line(self) -> str:
        """Return the row as Markdown."""
        statuses = Counter(verdict.status for verdict in self.verdicts)
        shown = ", ".join(f"{status} ({count})" for status, count in sorted(statuses.items()))
        lost, litter, talk = (
            sum(bool(getattr(verdict, name)) for verdict in self.verdicts)
            for name in ("lost", "litter", "talk")
        )
        cells = (self.command, self.kind, len(self.verdicts), shown, lost, litter, talk)
        return "| " + " | ".join(map(str, cells)) + " |"


def rows(runners: Sequence[Runner]) -> list[Row]:
    """Run every command with all chosen faults, as many commands at a time as there are runners."""
    free: SimpleQueue[Runner] = SimpleQueue()
    for runner in runners:
        free.put(runner)

    def tried(command: Command) -> list[Row]:
        runner = free.get()
        try:
            return _rows_of(runner, command)
        finally:
            free.put(runner)

    with ThreadPoolExecutor(len(runners)) as pool:
        return [row for each in pool.map(tried, COMMANDS) for row in each]


def _rows_of(runner: Runner, command: Command) -> list[Row]:
    """Run a command with all chosen faults."""
    calls = runner.calls(command)
    targets = [runner.out / name for name in command.targets]
    sizes = [path.stat().st_size for path in targets if path.is_file()]
    verdicts = [runner.judge(command, fault) for fault in faults(calls, wide=True)]
    if len(targets) == 1:
        verdicts += [runner.judge(command, limit=each) for each in limits(sizes[0], wide=True)]
    print(command.name, len(verdicts), "runs", file=sys.stderr, flush=True)
    by_kind = groupby(verdicts, lambda verdict: verdict.fault.split()[0])
    return [Row(command.name, FAULTS[kind], tuple(group)) for kind, group in by_kind]


@contextmanager
def several_runners(folder: Path, shim: Path) -> Iterator[list[Runner]]:
    """Runners, each in a folder of its own."""
    with ExitStack() as stack:
        runners = []
        for number in range(RUNNERS):
            place = folder / f"runner{number}"
            place.mkdir()
            write_inputs(place)
            runners.append(Runner(place, shim))
            stack.callback(runners[-1].close)
        yield runners


def write(found: list[Row]) -> None:
    """Write the table."""
    lines = [
        "# What commands leave when writing fails",
        "",
        "Lost: status 0 without the whole result, or an earlier file that is neither unchanged nor",
        "replaced by a whole one. Litter: other files than the results. Talk: not one sentence.",
        "",
        "| command | fault | runs | status (runs) | lost | litter | talk |",
        "| --- | --- | ---: | --- | ---: | ---: | ---: |",
        *(row.line() for row in found),
    ]
    for row in found:
        lines += [f"\n- {row.command}: {verdict}" for verdict in row.wrong]
    TARGET.parent.mkdir(exist_ok=True)
    TARGET.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> int:
    """Write the table and return the exit status: 1 if a run is not clean."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shim = compile_shim(folder)
        if shim is None:
            print("tests.faults.table: found no C compiler on Linux", file=sys.stderr)
            return 2
        with several_runners(folder, shim) as runners:
            found = rows(runners)
    write(found)
    print(TARGET)
    return int(any(row.wrong for row in found))


if __name__ == "__main__":
    sys.exit(main())
