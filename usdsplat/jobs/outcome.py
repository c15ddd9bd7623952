"""What became of a task, and how it is carried out in a process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from usdsplat.jobs.job import Task


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskResult:
    """The end of a command."""

    status: int
    """Exit status; 0 for success."""
    out: str = ""
    """What it wrote to stdout."""
    err: str = ""
    """What it wrote to stderr."""
    host: str = ""
    """Name of the machine."""

    @property
    def reason(self) -> str:
        """The last line of stderr, which explains an error."""
        lines = [line for line in self.err.splitlines() if line.strip()]
        return lines[-1].removeprefix("usdsplat: ") if lines else f"status {self.status}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """A task that has ended for good."""

    task: Task
    result: TaskResult | None
    """None if it was not begun, because a task before it failed."""

    @property
    def is_done(self) -> bool:
        """Whether the files of the task are written."""
        return self.result is not None and self.result.status == 0


Say = Callable[[str], None]
"""Receives a message about a task that is tried again."""
