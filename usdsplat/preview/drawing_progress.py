"""Publish the progress of a picture that takes long, such as the samples of a light."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from usdsplat.core.progress import reporting
from usdsplat.preview.values import Busy, Event

PATIENCE = 0.2
"""Time after which a picture is said to take long [s]."""
INTERVAL = 0.1
"""Least time between two reports [s]."""


class _Reports:
    """A receiver of progress that publishes it."""

    def __init__(self, publish: Callable[[Event], None]) -> None:
        self._publish = publish
        self._next = time.monotonic() + PATIENCE
        self._what = ""

    def step(self, label: str, done: int, total: int) -> None:
        """Publish how much is done, unless it was published just now; work that reports no steps
        is published when it begins."""
        now = time.monotonic()
        if now >= self._next or not total:
            self._next, self._what = now + INTERVAL, label
            self._publish(Busy(what=label, done=done, total=total, of_picture=True))

    def end(self) -> None:
        """Publish that nothing is going on."""
        if self._what:
            self._publish(Busy(what="", of_picture=True))


@contextmanager
def telling_phases(publish: Callable[[Event], None]) -> Iterator[None]:
    """Publish, within the context, the phases of a picture that takes long."""
    reports = _Reports(publish)
    try:
        with reporting(reports):
            yield
    finally:
        reports.end()
