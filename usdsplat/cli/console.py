"""Print results to stdout, progress and remarks to stderr.

On a terminal, progress is a bar with the time left. Elsewhere it is plain lines, which render
managers and logs can read. Work that takes less than about a second is not reported.
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
"""Time before progress of a task is shown [s]."""
INTERVALS = ((10.0, 1.0), (60.0, 10.0), (math.inf, 60.0))
"""Pairs (elapsed time of a task [s], interval of plain lines up to that time [s])."""


@contextmanager
def progress(compiled: Callable[[], float] = lambda: 0.0) -> Iterator[Progress]:
    """Yield a progress listener for stderr: a bar on a terminal, plain lines elsewhere.

    The bar is removed at the end.

    Args:
        compiled: Returns the time spent on compiling kernels so far [s]. Kernels are compiled only
            once, so the estimate of the time left excludes it.
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
    """Print a message to the user that is neither a result nor an error."""
    print(f"usdsplat: {text}", file=sys.stderr)


PICTURES = "compiling kernels, once for each kind of picture; it takes up to half a minute"


def announce_compilation(text: str = PICTURES) -> Callable[[str], None]:
    """Return a function to call for each compiled kernel; it prints `text` the first time only."""
    spoken = False

    def announce(kernel: str) -> None:
        nonlocal spoken
        if not spoken:
            spoken = True
            remark(text)

    return announce


def print_json(value: Any) -> None:
    """Print a value as JSON to stdout, with null for numbers that are not finite.

    Stages may contain such numbers anywhere, and JSON cannot represent them.
    """
    print(json.dumps(_with_null(value), indent=2, allow_nan=False))


def _with_null(value: Any) -> Any:
    """Return a value with None for every number that JSON cannot hold."""
    if isinstance(value, dict):
        return {key: _with_null(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_with_null(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def duration(seconds: float) -> str:
    """Return a duration as text: 0:07, 12:30, 1:02:03."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


class Lines:
    """Progress listener that prints plain lines. The longer a task takes, the rarer they are."""

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
    """Progress listener that shows a bar of `rich`, created on first use."""

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
        """Remove the bar."""
        if self._rich is not None:
            self._rich.stop()
            self._rich = None


def _amount(done: int, total: int, worked: float) -> str:
    """Return the progress and the time left as text, after `worked` seconds of work."""
    if not total:
        return f" {done}" if done else ""
    left = f", {duration(worked * (total - done) / done)} left" if 0 < done < total else ""
    return f" {done}/{total} ({100 * done // total} %{left})"


def _rich_progress() -> Any:
    """Return a progress bar on stderr that is removed at its end."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn
    from rich.progress import TimeRemainingColumn as Remaining

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), Remaining())
    return Progress(*columns, console=Console(stderr=True), transient=True)
