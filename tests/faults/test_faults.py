"""Tests that no command loses a file, leaves another one, or ends with a traceback while writing
fails.

Oracle of all: the four statements of `harness`, and the result of the same command without a fault.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.faults import table
from tests.faults.harness import COMMANDS, KILLED, OLD, Command, Runner, faults, limits

BY_NAME = {command.name: command for command in COMMANDS}
LIMITED = ["render o.exr", "render o.exr --deep", "render o.png", "convert to o.usdc",
           "convert to o.usda", "convert to o.usdz", "convert to o.ply"]  # fmt: skip
"""Commands of one file, for the tests with a true limit."""


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_a_fault_loses_nothing(runner: Runner, command: Command) -> None:
    """Oracle: as above, for a full disk, an error, an interrupt and a kill at chosen writes."""
    calls = runner.calls(command)
    verdicts = [runner.judge(command, fault) for fault in faults(calls, wide=False)]
    assert [verdict for verdict in verdicts if not verdict.is_clean] == []
    statuses = {verdict.status for verdict in verdicts}
    assert statuses >= {2, KILLED}, "no fault had an effect"


@pytest.mark.parametrize("name", LIMITED)
def test_the_last_bytes_do_not_fit(runner: Runner, name: str) -> None:
    """Oracle: as above, with the kernel's own limit on the size of a file: status 2, and the
    earlier file. One missing byte of an EXR once gave status 0."""
    command = BY_NAME[name]
    runner.calls(command)
    size = (runner.out / command.targets[0]).stat().st_size
    for limit in limits(size, wide=False):
        verdict = runner.judge(command, limit=limit)
        assert verdict.is_clean and verdict.status == 2, verdict
        assert (runner.out / command.targets[0]).read_bytes() == OLD
    assert runner.judge(command, limit=size + 64).status == 0


def test_a_killed_simulation_is_resumed(runner: Runner) -> None:
    """Oracle: the files of a simulation without a fault, byte for byte."""
    command = BY_NAME["simulate"]
    calls = runner.calls(command)
    expected = contents(runner.out)
    resumed = replace(
        command,
        arguments=tuple("--resume" if word == "--force" else word for word in command.arguments),
    )
    for number in (len(calls) // 3, 2 * len(calls) // 3, len(calls) - 2):
        runner.start(command)
        assert runner.run(command, ("kill", number)).status == KILLED
        ended = runner.run(resumed)
        assert ended.status == 0, ended.said
        assert contents(runner.out) == expected


def contents(folder: Path) -> dict[str, bytes]:
    """All files below a folder."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_the_table_is_clean(runner: Runner, tmp_path: Path) -> None:
    """Oracle: as above, for about 60 faults of each command; the table is written too."""
    with table.several_runners(tmp_path, runner.shim) as runners:
        rows = table.rows(runners)
    table.write(rows)
    assert [row.wrong for row in rows if row.wrong] == []
