"""Let several processes of this machine take over a long command, where that saves time.

A command without --jobs begins as one process, and measures its own work: how long a unit takes,
and how busy that keeps the cores. What is left would take several processes

    time left / speedup + start

With n processes on C cores, of which one process keeps the fraction b busy, the part s of its work
runs on one core (Amdahl's law), and the speedup follows:

    b = 1 / (s C + 1 - s)        speedup = n (s + (1 - s) / C) / (s + (1 - s) n / C)

With GPUs there is a process for each, and the cores may be the limit: speedup = min(n, 1 / b).
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

from usdsplat.cli.job_options import JobOptions
from usdsplat.cli.reporting import Reporter
from usdsplat.core.progress import Progress, TimedProgress

EFFICIENCY = 0.9
"""Fraction of the computed speedup that is expected, because processes share memory and disks."""
LOADING = 2.0
"""Time that a process takes to load the program [s]."""
MEASURED = 2.0
"""Shortest duration of a measurement that is used [s]."""
LEAST_SAVED, LEAST_PART = 10.0, 0.2
"""Least time that several processes must save [s], and least fraction of the remaining time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Capacity:
    """Cores, memory and GPUs of this machine, for the processes of a command."""

    cores: int
    free: int
    """Memory that is free [byte]; 0 if the system does not say."""
    peak: int
    """Peak memory of one process [byte]; 0 if the system does not say."""
    gpus: int = 0
    """Number of GPUs; 0 if the CPU does the work."""

    def processes(self, tasks: int) -> int:
        """Return the number of processes for a number of tasks; 1 if the memory is not known."""
        if not self.free or not self.peak:
            return 1
        return max(1, min(self.gpus or self.cores, tasks, self.free // self.peak))

    def speedup(self, processes: int, busy: float) -> float:
        """Return the speed of several processes as a multiple of that of one, at least 1.

        Args:
            processes: Their number.
            busy: Fraction of the cores that one process uses, above 0.
        """
        if self.gpus:
            return max(1.0, EFFICIENCY * min(processes, 1 / busy))
        share = processes / self.cores
        serial = 0.0 if self.cores == 1 else max(0.0, 1 / busy - 1) / (self.cores - 1)
        gain = processes * (serial + (1 - serial) / self.cores) / (serial + (1 - serial) * share)
        return max(1.0, EFFICIENCY * gain)


def capacity(device: str) -> Capacity:
    """Return the capacity of this machine now, for processes like this one, which uses a device."""
    from usdsplat.core.peak import peak_memory
    from usdsplat.core.system_memory import free
    from usdsplat.kernels.cuda.support import gpu_count
    from usdsplat.kernels.device import usual_threads

    gpus = gpu_count() if device == "cuda" else 0
    return Capacity(cores=usual_threads(), free=free(), peak=peak_memory(), gpus=gpus)


class WorthSharing(Exception):
    """Several processes should do the remaining work: ends that of this one.

    Attributes:
        processes: Their number.
    """

    def __init__(self, processes: int) -> None:
        super().__init__(f"{processes} processes")
        self.processes = processes


class _Reading(NamedTuple):
    """A step, and the times when it was taken."""

    done: int
    """Units finished."""
    clock: float
    """Time [s]."""
    cpu: float
    """Processor time of this process so far [s]."""
    compiled: float
    """Time spent on compiling kernels so far [s]."""


class Pace:
    """Measures the speed of a command that runs as one process, and passes on its progress.

    Args:
        progress: Receives the steps.
        of: Returns the capacity of the machine.
        label: The label whose steps are measured; None for all.
        first: First step of a label from which on it is measured. The work before the step 1 also
            prepares the others.
        compiled: Returns the time spent on compiling kernels so far [s]; such a time is no measure.
        clock: Returns the time [s].
        cpu: Returns the processor time of this process [s].
    """

    def __init__(
        self,
        progress: Progress,
        of: Callable[[], Capacity],
        *,
        label: str | None = None,
        first: int = 1,
        compiled: Callable[[], float] = lambda: 0.0,
        clock: Callable[[], float] = time.perf_counter,
        cpu: Callable[[], float] = time.process_time,
    ) -> None:
        self._progress, self._of, self._compiled = progress, of, compiled
        self._clock, self._cpu = clock, cpu
        self._created = clock()
        self._watched, self._first = label, first
        self._label, self._total = "", 0
        self._begun: _Reading | None = None
        self._last = _Reading(0, 0.0, 0.0, 0.0)
        self._start = 0.0

    def step(self, label: str, done: int, total: int) -> None:
        """Pass on a step, see `Progress`, and measure it."""
        self._progress.step(label, done, total)
        if label != (self._watched or label):
            return
        now = self._last = _Reading(done, self._clock(), self._cpu(), self._compiled())
        if label != self._label or total != self._total:
            self._label, self._total, self._begun = label, total, None
        is_stale = self._begun is not None and now.compiled > self._begun.compiled
        if done >= self._first and (self._begun is None or is_stale):
            self._begun = now
            self._start = self._start or LOADING + now.clock - self._created

    def expect(self, label: str, seconds: float | None, spent: float = 0.0) -> None:
        """Pass on the start of work without steps, see `TimedProgress`."""
        if isinstance(self._progress, TimedProgress):
            self._progress.expect(label, seconds, spent)
        else:
            self._progress.step(label, 0, 0)

    def processes(self, tasks: int, *, again: bool = False) -> int:
        """Return the number of processes that should do the remaining work; 1 for this one alone.

        Args:
            tasks: Number of tasks into which the work can be divided.
            again: Whether these tasks would repeat the finished work.
        """
        if self._begun is None or tasks < 2:
            return 1
        first, last = self._begun, self._last
        seconds, units = last.clock - first.clock, last.done - first.done
        if seconds < MEASURED or units <= 0:
            return 1
        unit = seconds / units
        left = unit * (self._total - last.done)
        if left < LEAST_SAVED:
            return 1
        here = self._of()
        count = here.processes(tasks)
        busy = min(1.0, max(last.cpu - first.cpu, 1e-3) / (seconds * here.cores))
        work = unit * self._total if again else left
        saved = left - (work / here.speedup(count, busy) + self._start)
        return count if saved > max(LEAST_SAVED, LEAST_PART * left) else 1


class SharedPace(Pace):
    """A pace that raises `WorthSharing` after a step with one label.

    Args:
        label: The label, whose units are tasks.
        progress, of, first, compiled: Those of `Pace`.
        again: Whether the tasks would repeat the finished work.
    """

    def __init__(
        self,
        label: str,
        progress: Progress,
        of: Callable[[], Capacity],
        *,
        first: int = 1,
        compiled: Callable[[], float] = lambda: 0.0,
        again: bool = False,
    ) -> None:
        super().__init__(progress, of, label=label, first=first, compiled=compiled)
        self._again = again

    def step(self, label: str, done: int, total: int) -> None:
        """Pass on a step, measure it, and decide.

        Raises:
            WorthSharing: If several processes should go on.
        """
        super().step(label, done, total)
        if label == self._watched:
            count = self.processes(total if self._again else total - done, again=self._again)
            if count > 1:
                raise WorthSharing(count)


def may_share(job: JobOptions, reporter: Reporter, *limits: object) -> bool:
    """Return whether a command may let other processes go on.

    A worker of a job or a task of a farm may not, nor a command whose work, memory or threads are
    limited.

    Args:
        job: Its options.
        reporter: Its reporter.
        limits: Values of its flags that limit it; None where one is not given.
    """
    from usdsplat.jobs.local import MARKED

    is_part = reporter.keeper is not None or reporter.is_of_farm or MARKED in os.environ
    is_limited = any(each is not None for each in limits) or reporter.findings.is_strict
    return not (job.is_asked or is_part or is_limited)


def shared(job: JobOptions, processes: int, reporter: Reporter) -> JobOptions:
    """Tell the user the number of processes that go on, and return the options of their job."""
    reporter.remark(f"{processes} processes go on, which takes less time; --jobs 1 keeps it to one")
    return replace(job, jobs=str(processes))
