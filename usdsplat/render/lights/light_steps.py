"""Count the samples of lights, and end between two of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from usdsplat.core.cancel import CancelToken
from usdsplat.core.progress import phase


def unnoticed() -> None:
    """Do nothing after a sample of a light."""


@contextmanager
def counted(label: str, total: int, cancel: CancelToken) -> Iterator[Callable[[], None]]:
    """Announce a phase, and yield the function to call after each of its steps.

    Args:
        total: Number of steps; 0 announces nothing.
        cancel: Checked after each step.
    """
    if not total:
        yield unnoticed
        return
    done = 0
    with phase(label, total) as work:

        def step() -> None:
            nonlocal done
            done = min(done + 1, total)  # a dome also has peaks, which are not counted
            work.step(done)
            cancel.check()

        yield step
