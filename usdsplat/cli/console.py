"""How a command talks: results on stdout, progress and remarks on stderr.

On a terminal progress is a bar with the time left; elsewhere it is plain lines, which render
managers and logs can read. Work that takes less than about a second is not mentioned.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from usdsplat.core.progress import Progress

PATIENCE = 1.0
"""Seconds before anything is said about a piece of work."""
INTERVALS = ((10.0, 1.0), (60.0, 10.0), (math.inf, 60.0))
"""Until so many seconds of a piece of work have passed, a plain line every so many."""


@contextmanager
def progress(compiled: Callable[[], float] = lambda: 0.0) -> Iterator[Progress]:
    """Yield a listener that shows progress the way stderr can; when it ends the bar is gone.

    Args:
        compiled: Says how long kernels have been compiled so far [s]: that happens once, and counts
            for nothing where the time left is estimated.
    """
    if not sys.stderr.isatty():
        yield Lines(compiled)
        return
    bar = Bar()
    try:
        yield bar
    finally:
        bar.stop()


def remark(text: str) -> None:
    """Tell the user something that is neither a result nor an error."""
    print(f"usdsplat: {text}", file=sys.stderr)


PICTURES = "compiling kernels, once for each kind of picture; it takes up to half a minute"


def announce_compilation(text: str = PICTURES) -> Callable[[str], None]:
    """Return what to call as each kernel is compiled; it says `text` the first time only."""
    spoken = False

    def announce(kernel: str) -> None:
        nonlocal spoken
        if not spoken:
            spoken = True
            remark(text)

    return announce


def print_json(value: Any) -> None:
    """Print a result for machines: one JSON value on stdout, null for numbers that are not finite.

    Stages may hold such numbers anywhere, and JSON has no word for them.
    """
    print(json.dumps(_with_null(value), indent=2, allow_nan=False))


def _with_null(value: Any) -> Any:
    """A value of which JSON can hold every number."""
    if isinstance(value, dict):
        return {key: _with_null(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_with_null(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def duration(seconds: float) -> str:
    """A time span as people say it: 0:07, 12:30, 1:02:03."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


class Lines:
    """Progress as plain lines, the fewer the longer the work takes, so that logs stay short."""

    def __init__(self, compiled: Callable[[], float] = lambda: 0.0) -> None:
        self._label = ""
        self._compiled = compiled
        self._compiled_before = compiled()
        self._started = self._printed = time.monotonic()

    def step(self, label: str, done: int, total: int) -> None:
        now = time.monotonic()
        if label != self._label:
            self._label, self._started, self._printed = label, now, now
            self._compiled_before = self._compiled()
        is_last = done == total and self._printed > self._started
        elapsed = now - self._started
        interval = next(seconds for until, seconds in INTERVALS if elapsed <= until)
        if now - self._printed < interval and not is_last:
            return
        self._printed = now
        worked = max(elapsed - (self._compiled() - self._compiled_before), 0.0)
        print(f"usdsplat: {label}{_amount(done, total, worked)}", file=sys.stderr)


class Bar:
    """Progress as a bar of rich's, made when it is first needed."""

    def __init__(self) -> None:
        self._label = ""
        self._started = time.monotonic()
        self._rich: Any = None

    def step(self, label: str, done: int, total: int) -> None:
        now = time.monotonic()
        if label != self._label:
            self.stop()
            self._label, self._started = label, now
        if self._rich is None:
            if now - self._started < PATIENCE or (total and done == total):
                return
            self._rich = _rich_progress()
            self._rich.start()
            self._task = self._rich.add_task(label, total=total or None)
        self._rich.update(self._task, completed=done, total=total or None)

    def stop(self) -> None:
        """Take the bar away."""
        if self._rich is not None:
            self._rich.stop()
            self._rich = None


def _amount(done: int, total: int, worked: float) -> str:
    """How far it is, after so many seconds of work, and how long it will still take."""
    if not total:
        return f" {done}" if done else ""
    left = f", {duration(worked * (total - done) / done)} left" if 0 < done < total else ""
    return f" {done}/{total} ({100 * done // total} %{left})"


def _rich_progress() -> Any:
    """A bar on stderr that leaves nothing behind."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn
    from rich.progress import TimeRemainingColumn as Remaining

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), Remaining())
    return Progress(*columns, console=Console(stderr=True), transient=True)
