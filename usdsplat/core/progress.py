"""Progress reports of long tasks."""

from __future__ import annotations

from typing import Protocol

from usdsplat.core import interrupt


class Progress(Protocol):
    """A receiver of progress: a progress bar, a log or a panel."""

    def step(self, label: str, done: int, total: int) -> None:
        """Report that `done` of `total` units of the task `label` are finished.

        Args:
            label: The task in a few words; a new label starts a new task.
            done: Units finished [0..total].
            total: Number of units; 0 if unknown.

        Raises:
            Interrupted: If the process was asked to end, see `core.interrupt`.
        """


class _Silent:
    """A receiver that shows nothing."""

    def step(self, label: str, done: int, total: int) -> None:
        interrupt.check()


silent: Progress = _Silent()
"""The default receiver, which shows nothing."""
