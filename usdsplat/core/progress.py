"""Progress reports of long tasks, and the phases that they consist of.

A task that takes a `Progress` reports its own steps. Code below it, which has none, announces its
work as a phase:

    for sweep in steps("even spacing", sweeps):     # counts
        ...

    with phase("distances", total=slabs) as slab:   # the same, by hand
        ...
        slab.step(done)

    with phase("neighbours", work=len(points)):     # cannot be divided
        ...

Whoever runs the task decides who receives the phases of its thread, by `reporting`. A phase in a
phase is reported as "carriers: even spacing"; below a phase that counts steps, such as the frames
of a simulation, only once it has taken `PATIENCE`. The time left is estimated by the receiver from
the steps so far, or, for a phase that cannot be divided, from the rate at which this machine did
such work before, see `Rates`.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, runtime_checkable

from usdsplat.core import interrupt
from usdsplat.core.errors import UsdSplatError
from usdsplat.core.output import output_file

PATIENCE = 2.0
"""Time after which a phase below one that counts steps is reported [s]."""
_LEAST = 0.2
"""Duration of work from which its rate is remembered [s]."""
_BLEND = 0.3
"""Weight of the newest rate in the kept one."""


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


@runtime_checkable
class TimedProgress(Protocol):
    """A receiver that shows the time of work that cannot be divided, while it lasts."""

    def expect(self, label: str, seconds: float | None, spent: float = 0.0) -> None:
        """Report that a task has begun that reports no steps, or goes on.

        Args:
            label: The task; the next call of `step` or `expect` ends it.
            seconds: Its expected duration in all [s]; None if unknown.
            spent: Time that it has taken already [s].
        """


class _Silent:
    """A receiver that shows nothing."""

    def step(self, label: str, done: int, total: int) -> None:
        interrupt.check()


silent: Progress = _Silent()
"""The default receiver, which shows nothing."""


class Rates:
    """Rates at which this machine did the work of phases before [1/s], by name.

    Args:
        path: File that keeps them; None keeps nothing. A file that cannot be read counts as empty,
            and one that cannot be written is left.
        machine: What the rates are measured on, such as a device and its threads.
    """

    def __init__(self, path: Path | None = None, machine: str = "") -> None:
        self._path, self._machine = path, machine
        self._rates: dict[str, float] = {}
        self._changed = False
        if path is not None:
            with suppress(OSError, ValueError, AttributeError):
                known = json.loads(path.read_text(encoding="utf-8")).items()
                self._rates = {key: float(rate) for key, rate in known if 0 < rate < math.inf}

    def seconds(self, label: str, work: float) -> float | None:
        """Return the expected duration of some work [s]; None if it was never done here."""
        rate = self._rates.get(self._key(label))
        return work / rate if rate and work > 0 else None

    def note(self, label: str, work: float, seconds: float) -> None:
        """Remember how long some work took, unless it was too short to tell."""
        if work <= 0 or seconds < _LEAST:
            return
        key, rate = self._key(label), work / seconds
        before = self._rates.get(key, rate)
        self._rates[key] = before * (rate / before) ** _BLEND
        self._changed = True

    def save(self) -> None:
        """Write the file, if anything is new."""
        if self._path is None or not self._changed:
            return
        text = json.dumps(self._rates, indent=1, sort_keys=True)
        with suppress(OSError, UsdSplatError):
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with output_file(self._path) as output, output.open() as file:
                file.write(text.encode())
        self._changed = False

    def _key(self, label: str) -> str:
        return f"{self._machine}: {label}" if self._machine else label


@dataclass(slots=True, eq=False)
class Phase:
    """A piece of work that has begun."""

    label: str
    total: int
    work: float
    """Amount of work of a phase without steps; 0 if it is unknown."""
    _phases: Phases | None = None
    _is_shown: bool = True
    _began: float = 0.0
    _nested: float = 0.0

    def step(self, done: int) -> None:
        """Report that `done` of `total` steps are finished.

        Raises:
            Interrupted: If the process was asked to end, see `core.interrupt`.
        """
        if self._phases is None:
            interrupt.check()
        else:
            self._phases.report(self, done)


@dataclass(slots=True, eq=False)
class Phases:
    """The phases of one task, and their receiver."""

    progress: Progress
    rates: Rates
    now: Callable[[], float]
    """Returns a time without compilation of kernels [s]."""
    spent: dict[str, float] = field(default_factory=dict)
    """Time of each phase without those in it, and without compilation of kernels [s]."""
    _open: list[Phase] = field(default_factory=list)

    def begin(self, label: str, total: int, work: float) -> Phase:
        """Open a phase below those that are open."""
        outer = self._open[-1] if self._open else None
        name = label if outer is None or outer.total else f"{outer.label}: {label}"
        is_shown = outer is None or (outer._is_shown and not outer.total)
        made = Phase(name, total, work, self, is_shown, self.now())
        self._open.append(made)
        self._announce(made)
        return made

    def abandon(self) -> None:
        """Remove the innermost phase after an error in it; its time is not kept."""
        self._open.pop()

    def end(self, phase: Phase) -> None:
        """Close the innermost phase."""
        self._open.pop()
        whole = self.now() - phase._began
        own = max(whole - phase._nested, 0.0)
        self.spent[phase.label] = self.spent.get(phase.label, 0.0) + own
        if not phase.total:
            self.rates.note(phase.label, phase.work, whole)
        if self._open:
            self._open[-1]._nested += whole
            if phase._is_shown:
                self._announce(self._open[-1])

    def report(self, phase: Phase, done: int) -> None:
        """Report a step of a phase."""
        is_late = not phase._is_shown and self.now() - phase._began > PATIENCE
        if phase._is_shown or is_late:
            self.progress.step(phase.label, done, phase.total)
        else:
            interrupt.check()

    def _announce(self, phase: Phase) -> None:
        """Report that a phase begins, or goes on after one in it."""
        interrupt.check()
        if not phase._is_shown:
            return
        if phase.total or not isinstance(self.progress, TimedProgress):
            self.progress.step(phase.label, 0, phase.total)
            return
        seconds = self.rates.seconds(phase.label, phase.work)
        self.progress.expect(phase.label, seconds, self.now() - phase._began)


_current: ContextVar[Phases | None] = ContextVar("usdsplat phases", default=None)


@contextmanager
def reporting(
    progress: Progress,
    *,
    rates: Rates | None = None,
    compiled: Callable[[], float] = lambda: 0.0,
) -> Iterator[Mapping[str, float]]:
    """Report the phases of this thread to a receiver while the context lasts.

    Args:
        progress: The receiver.
        rates: Rates of earlier work; they are saved at the end.
        compiled: Returns the time spent on compiling kernels so far [s], which counts to no phase.

    Yields:
        Time of each phase so far [s], without those in it.
    """
    phases = Phases(progress, rates or Rates(), lambda: time.monotonic() - compiled())
    token = _current.set(phases)
    try:
        yield phases.spent
        phases.rates.save()
    finally:
        _current.reset(token)


@contextmanager
def phase(label: str, total: int = 0, *, work: float = 0.0) -> Iterator[Phase]:
    """Announce a phase of the task that runs in this thread; without `reporting` it is silent.

    Args:
        label: The work in a few words, such as "even spacing".
        total: Number of steps, which the phase reports; 0 if it cannot be divided.
        work: Amount of work of a phase that cannot be divided, in any unit that its duration is
            proportional to, such as the number of splats; 0 if that is unknown.

    Raises:
        Interrupted: If the process was asked to end, see `core.interrupt`.
    """
    phases = _current.get()
    if phases is None:
        interrupt.check()
        yield Phase(label, total, work)
        return
    made = phases.begin(label, total, work)
    try:
        yield made
    except GeneratorExit:  # of `steps`, whose loop was left
        phases.end(made)
        raise
    except BaseException:
        phases.abandon()
        raise
    phases.end(made)


def steps(label: str, total: int) -> Iterator[int]:
    """Iterate over the steps of a phase, 0 to total - 1, and report each; the loop may be left.

    Args:
        label: As for `phase`.
        total: Number of steps.
    """
    with phase(label, total) as made:
        for number in range(total):
            yield number
            made.step(number + 1)
