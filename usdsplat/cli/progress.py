"""Progress listeners for stderr. On a terminal they show a bar with the time left, elsewhere plain
lines, which render managers and logs can read. Work that takes less than about a second is not
reported.

Both estimate the time left from the steps so far, without the time in which kernels were compiled.
Work that reports no steps is shown from another thread: its time so far, and if this machine did
such work before, the time that is left.
"""

from __future__ import annotations

import json
import math
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import IO, Any, cast

from usdsplat.cli import console
from usdsplat.core import interrupt
from usdsplat.core.errors import UsageError
from usdsplat.core.progress import Progress
from usdsplat.core.text import shown

BEAT = 0.5
"""Time between looks at work that reports no steps [s]."""
PATIENCE = 1.0
"""Time before progress of a task is shown [s]."""
INTERVALS = ((10.0, 1.0), (60.0, 10.0), (math.inf, 60.0))
"""Pairs (elapsed time of a task [s], interval of plain lines up to that time [s])."""


AUTO, JSON, OPENJD = STYLES = "auto", "json", "openjd"
"""Forms of progress."""


def checked_style(style: str) -> str:
    """Return a form of progress.

    Raises:
        UsageError: If it is unknown.
    """
    if style not in STYLES:
        raise UsageError("--progress", repr(style), f"one of {', '.join(STYLES)}")
    return style


@contextmanager
def listening(compiled: Callable[[], float] = lambda: 0.0, style: str = AUTO) -> Iterator[Progress]:
    """Yield a progress listener for stderr: a bar on a terminal, plain lines elsewhere.

    Another thread lets it show the time that passes. The bar is removed at the end.

    Args:
        style: One of STYLES.
        compiled: Returns the time spent on compiling kernels so far [s]. Kernels are compiled only
            once, so the estimate of the time left excludes it.
    """
    is_terminal = sys.stderr is not None and sys.stderr.isatty()
    listener: _Receiver
    if style in _FORMATS:
        listener = FormattedLines(compiled, _FORMATS[style])
    else:
        listener = Bar(compiled) if is_terminal else Lines(compiled)
    ended = threading.Event()

    def run() -> None:
        while not ended.wait(BEAT):
            listener.beat()

    thread = threading.Thread(target=run, name="usdsplat progress", daemon=True)
    thread.start()
    try:
        yield listener
    finally:
        ended.set()
        thread.join()
        listener.stop()


def duration(seconds: float) -> str:
    """Return a duration as text: 0:07, 12:30, 1:02:03."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


class _Task:
    """A task that is being reported.

    Args:
        label: Name of the task.
        done: Units that are finished as it is first reported.
        compiled: Returns the time spent on compiling kernels so far [s], which is left out.
        spent: Time that it has taken already [s].
    """

    def __init__(
        self, label: str, done: int, compiled: Callable[[], float], spent: float = 0.0
    ) -> None:
        self.label, self.first, self.last = label, done, done
        self.expected: float | None = None
        """Expected duration of a task without steps [s]; None if unknown."""
        self.has_steps = True
        self.started = self.printed = time.monotonic()
        self._compiled, self._then, self._spent = compiled, compiled(), spent

    @property
    def elapsed(self) -> float:
        """Time since the task was first reported [s]."""
        return time.monotonic() - self.started

    @property
    def worked(self) -> float:
        """Time that the task has taken, without compilation [s]."""
        return self._spent + max(self.elapsed - (self._compiled() - self._then), 0.0)


class _Receiver:
    """A progress listener, which may be asked from another thread to show the time that passes.

    Args:
        compiled: Returns the time spent on compiling kernels so far [s].
    """

    def __init__(self, compiled: Callable[[], float] = lambda: 0.0) -> None:
        self._compiled = compiled
        self._tasks: dict[str, _Task] = {}
        self._task = _Task("", 0, compiled)
        self._lock = threading.RLock()

    def step(self, label: str, done: int, total: int) -> None:
        """Implement `Progress.step`."""
        interrupt.check()
        with self._lock:
            known = self._tasks.get(label)
            if known is None or not known.has_steps or done < known.last:
                known = _Task(label, done, self._compiled)
            self._turn_to(known)
            known.last = done
            self._show(done, total)

    def expect(self, label: str, seconds: float | None, spent: float = 0.0) -> None:
        """Implement `TimedProgress.expect`."""
        with self._lock:
            task = _Task(label, 0, self._compiled, spent)
            task.has_steps, task.expected = False, seconds
            self._turn_to(task)

    def beat(self) -> None:
        """Show the time of a task without steps. It is called from another thread."""
        with self._lock:
            if self._task.label and not self._task.has_steps:
                self._show_time(self._task.worked, self._task.expected)

    def stop(self) -> None:
        """Show nothing any more."""

    def _turn_to(self, task: _Task) -> None:
        """Make a task the current one."""
        if task.label != self._task.label:
            self._left()
        self._tasks[task.label] = self._task = task

    def _left(self) -> None:
        """End what is shown of the current task."""

    def _show(self, done: int, total: int) -> None:
        """Show a step of the current task."""

    def _show_time(self, worked: float, expected: float | None) -> None:
        """Show the time of the current task, which has no steps."""


class Lines(_Receiver):
    """Progress listener that prints plain lines. The longer a task takes, the rarer they are."""

    def _show(self, done: int, total: int) -> None:
        task = self._task
        is_last = done == total and task.printed > task.started
        if self._is_due() or is_last:
            text = _amount(done, total, task.worked, task.first)
            self._print(f"{shown(task.label)}{text}")

    def _show_time(self, worked: float, expected: float | None) -> None:
        if self._is_due():
            self._print(f"{shown(self._task.label)} {_timed(worked, expected)}")

    def _is_due(self) -> bool:
        """Return whether the last line is long enough ago."""
        interval = next(each for until, each in INTERVALS if self._task.elapsed <= until)
        return time.monotonic() - self._task.printed >= interval

    def _print(self, text: str) -> None:
        self._task.printed = time.monotonic()
        console.tell(f"usdsplat: {text}")


class FormattedLines(Lines):
    """Progress listener that prints lines for programs.

    Args:
        compiled: See `listening`.
        line: Returns a line for a label, the finished units and their number, 0 if unknown.
    """

    def __init__(
        self, compiled: Callable[[], float], line: Callable[[str, float, float], str]
    ) -> None:
        super().__init__(compiled)
        self._line = line

    def _show(self, done: int, total: int) -> None:
        if self._is_due() or done == total:
            self._task.printed = time.monotonic()
            console.tell(self._line(shown(self._task.label), done, total))

    def _show_time(self, worked: float, expected: float | None) -> None:
        if self._is_due():
            self._task.printed = time.monotonic()
            part = 0 if expected is None else min(worked, 0.99 * expected)
            console.tell(self._line(shown(self._task.label), part, expected or 0))


def _json_line(label: str, done: float, total: float) -> str:
    return json.dumps({"progress": {"label": label, "done": done, "total": total}})


def _openjd_line(label: str, done: float, total: float) -> str:
    """Return lines that workers of Open Job Description take for progress and status."""
    status = f"openjd_status: {label}"
    return f"openjd_progress: {100 * done / total:.1f}\n{status}" if total else status


_FORMATS = {JSON: _json_line, OPENJD: _openjd_line}


class Bar(_Receiver):
    """Progress listener that shows a bar of `rich`, created on first use."""

    def __init__(self, compiled: Callable[[], float] = lambda: 0.0) -> None:
        super().__init__(compiled)
        self._rich: Any = None

    def stop(self) -> None:
        """Remove the bar."""
        with self._lock:
            self._left()

    def _left(self) -> None:
        if self._rich is not None:
            self._rich.stop()
            self._rich = None

    def _show(self, done: int, total: int) -> None:
        if total and done == total and self._rich is None:
            return
        self._update(done, total or None)

    def _show_time(self, worked: float, expected: float | None) -> None:
        # a bar that is full before the work is done would be wrong
        self._update(worked if expected is None else min(worked, 0.99 * expected), expected)

    def _update(self, done: float, total: float | None) -> None:
        if self._rich is None:
            if self._task.elapsed < PATIENCE:
                return
            self._rich = _rich_progress()
            self._rich.start()
            self._shown = self._rich.add_task(_literal(self._task.label), total=total)
        self._rich.update(self._shown, completed=done, total=total)


def _amount(done: int, total: int, worked: float, first: int = 0) -> str:
    """Return the progress and the time left as text, after `worked` seconds of work since `first`
    units were finished."""
    if not total:
        return f" {done}" if done else ""
    rest = ""
    if first < done < total:
        rest = f", {duration(worked * (total - done) / (done - first))} left"
    return f" {done}/{total} ({100 * done // total} %{rest})"


def _timed(worked: float, expected: float | None) -> str:
    """Return the time of work that cannot be divided as text."""
    if expected is None or expected <= 0:
        return f"{duration(worked)} so far"
    if worked >= expected:
        return f"{duration(worked)} so far, {duration(expected)} was expected"
    part = int(100 * worked / expected)
    return f"{duration(worked)} ({part} %, about {duration(expected - worked)} left)"


def _literal(label: str) -> str:
    """Return a label that `rich` shows as it is, although it may hold brackets."""
    from rich.markup import escape

    return escape(shown(label))


def _rich_progress() -> Any:
    """Return a progress bar on stderr that is removed at its end."""
    from rich.console import Console
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn
    from rich.progress import Progress as RichProgress
    from rich.progress import TimeRemainingColumn as Remaining

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), Remaining())
    return RichProgress(
        *columns, console=Console(file=cast(IO[str], console.Terminal())), transient=True
    )
