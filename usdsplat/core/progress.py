"""How long work tells the outside how far it is, without knowing who listens."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Whoever shows progress: a terminal bar, a log line, a panel, or nobody."""

    def step(self, label: str, done: int, total: int) -> None:
        """Say that `done` of `total` units of the work called `label` are finished.

        Args:
            label: What is going on, a few words; a new label starts a new piece of work.
            done: Units finished [0..total].
            total: Units there are; 0 when unknown.
        """


class _Silent:
    """Nobody listens."""

    def step(self, label: str, done: int, total: int) -> None:
        pass


silent: Progress = _Silent()
"""The default listener: it does nothing."""
