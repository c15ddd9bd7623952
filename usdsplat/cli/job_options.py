"""Define the options of commands that can run as jobs, and run them."""

from __future__ import annotations

import json
import math
import os
import shlex
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, fields
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

from usdsplat.cli import console, forked_workers, forking
from usdsplat.cli.arguments import option
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.core import interrupt
from usdsplat.core.errors import JobError, StrictError, UsageError
from usdsplat.core.wording import counted
from usdsplat.jobs.local import GPUS

if TYPE_CHECKING:
    from usdsplat.core.findings import Findings
    from usdsplat.jobs.dask_cluster import DaskWorkers
    from usdsplat.jobs.job import Job
    from usdsplat.jobs.local import LocalWorkers
    from usdsplat.jobs.outcome import Outcome

AUTO = "auto"
FORM = "NAME=N,... with numbers above 0, each name once"
"""Form of --resources."""
COLD = 24
"""Default of --chunk for a farm [frame]. Each task there opens its input anew, so it has many."""
USUAL_MEMORY = 1 << 30
"""Memory that a process is expected to take where no limit is given [byte]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobOptions:
    """Divide the work into tasks, see docs/farm.md."""

    jobs: Annotated[str | None, option("N|auto", excludes="--dask")] = None
    """number of processes of this machine; auto: one for each GPU, or for each core, but no more
    than its free memory holds; default: one, and for render, convert and wedges auto from
    when that saves time, see docs/farm.md"""
    dask: Annotated[str | None, option("ADDRESS|local", excludes="--openjd")] = None
    """let a Dask scheduler run the tasks, such as tcp://host:8786; local starts one here"""
    openjd: Annotated[Path | None, option("FOLDER", excludes="--jobs")] = None
    """write the tasks as an Open Job Description bundle, and run nothing"""
    chunk: Annotated[int | None, option("N")] = None
    """frames of a task; default: as many as keep the processes busy, fewer towards the end"""
    retries: Annotated[int, option("N")] = 1
    """how often a task that fails is tried again"""
    resources: Annotated[str | None, option("NAME=N,...")] = None
    """with --dask: further resources that a task takes, by the names that workers declare"""

    @property
    def is_asked(self) -> bool:
        """Whether the command is to run as a job."""
        return any(each is not None for each in (self.jobs, self.dask, self.openjd))

    @property
    def is_here(self) -> bool:
        """Whether processes of this machine run the tasks."""
        return self.jobs is not None or self.dask == "local"


def check_jobs(options: JobOptions, *, frameless: str = "") -> None:
    """Raise an error for options that have no effect or are out of range.

    Args:
        options: The options of a command.
        frameless: Name of the command, if its tasks have no frames, which --chunk counts.

    Raises:
        UsageError: If there is one.
    """
    if frameless and options.chunk is not None:
        found = f"--chunk with {frameless}"
        raise UsageError("--chunk", found, "no such flag: its tasks have no frames")
    if not options.is_asked:
        for each in fields(options):
            if getattr(options, each.name) != each.default:
                found = f"no --jobs, --dask or --openjd with --{each.name}"
                raise UsageError(f"--{each.name}", found, "one of them")
    if options.chunk is not None and options.chunk < 1:
        raise UsageError("--chunk", str(options.chunk), "1 or more frames")
    if options.retries < 0:
        raise UsageError("--retries", str(options.retries), "0 or more")
    if options.resources is not None and options.dask is None:
        raise UsageError("--resources", "it without --dask", "--dask ADDRESS")
    resources_of(options.resources)


def resources_of(text: str | None) -> dict[str, float]:
    """Return the amounts of resources in a text such as "A100=1,licence=0.5".

    Raises:
        UsageError: If it has another form.
    """
    found: dict[str, float] = {}
    for part in (text or "").replace(",", " ").split():
        name, _, text_of_amount = part.partition("=")
        try:
            amount = float(text_of_amount)
        except ValueError:
            amount = math.nan
        if not name or name in found or not 0 < amount < math.inf:
            raise UsageError("--resources", repr(part), FORM)
        found[name] = amount
    if text is not None and not found:
        raise UsageError("--resources", repr(text), FORM)
    return found


def resumed(arguments: Sequence[str]) -> str:
    """Return the command that continues another one: with --resume, if it has such a flag."""
    words = [word for word in arguments if word not in ("--force", "--resume")]
    more = ["--resume"] if words[:1] in (["render"], ["simulate"]) else []
    return shlex.join(["usdsplat", *words, *more])


def of_task(reporting: ReportingOptions) -> ReportingOptions:
    """Return the options with which a task reports: its findings are in what it prints."""
    return ReportingOptions(quiet=True, strict=reporting.strict)


def environments(
    options: JobOptions, *, device: str, threads: int | None, memory: int | None = None
) -> list[dict[str, str]]:
    """Return the variables of each process of this machine. They share its cores and its GPUs.

    Args:
        options: The options of the command.
        device: Name of the device; "auto" for a GPU if there is one.
        threads: Threads of each process; None shares the cores evenly.
        memory: Memory that a process may take [byte]; None for `USUAL_MEMORY`.

    Raises:
        UsageError: If the number of processes is out of range.
    """
    from usdsplat.core.system_memory import free
    from usdsplat.kernels.cuda.support import gpu_count
    from usdsplat.kernels.device import usual_threads

    cores = usual_threads()
    gpus = [] if device == "cpu" else _visible_gpus(gpu_count())
    text = options.jobs or AUTO
    if text == AUTO:
        count = len(gpus) or cores
        if available := free():
            count = max(1, min(count, available // (memory or USUAL_MEMORY)))
    else:
        most = 8 * (os.cpu_count() or 1)
        count = int(text) if text.isdecimal() and len(text) < 6 else 0
        if not 1 <= count <= most:
            raise UsageError("--jobs", repr(text), f"1 to {most}, or auto")
    each = {"USDSPLAT_THREADS": str(threads or max(1, cores // count))}
    if not gpus:
        return [dict(each) for _ in range(count)]
    return [{**each, GPUS: gpus[i % len(gpus)]} for i in range(count)]


def _visible_gpus(count: int) -> list[str]:
    """Return the GPUs as values of the variable GPUS."""
    named = os.environ.get(GPUS)
    return named.split(",")[:count] if named else [str(i) for i in range(count)]


class JobRunner:
    """What runs the tasks of a command: processes that start with the context, or Dask.

    Args:
        options: How tasks are run.
        reporter: Receives progress and findings.
        environments: See `environments`.
        modules: Names of modules that all tasks need.
    """

    def __init__(
        self,
        options: JobOptions,
        reporter: Reporter,
        environments: Sequence[Mapping[str, str]],
        modules: Sequence[str] = (),
    ) -> None:
        self._options, self._reporter = options, reporter
        self._environments, self._modules = environments, modules
        self._stack = ExitStack()
        self._workers: LocalWorkers | DaskWorkers | None = None

    def __enter__(self) -> Self:
        """Start the processes, or connect to the cluster.

        Raises:
            BackendError: See `DaskWorkers`.
        """
        if self._options.dask is not None:
            from usdsplat.cli.worker import run_on_dask_worker
            from usdsplat.jobs.dask_cluster import LOCAL, DaskWorkers

            is_here = self._options.dask == LOCAL and find_spec("distributed") is not None
            modules = (*self._modules, "distributed", "usdsplat.cli.dask_worker")
            fork = forked_workers.dask_worker if is_here and self._can_fork(modules) else None
            made = DaskWorkers(
                self._options.dask,
                self._environments,
                run_on_dask_worker,
                fork=fork,
                resources=resources_of(self._options.resources),
            )
            self._workers = self._stack.enter_context(made)
        elif self._options.openjd is None:
            from usdsplat.jobs.local import LocalWorkers

            fork = forked_workers.worker if self._can_fork(self._modules) else None
            self._workers = self._stack.enter_context(LocalWorkers(self._environments, fork))
        forking.release()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def __len__(self) -> int:
        """Return the number of workers; 0 if a farm runs the tasks."""
        return 0 if self._workers is None else len(self._workers)

    def run(
        self, job: Job, *, findings: Findings | None = None
    ) -> Generator[dict[str, Any], None, None]:
        """Run a job, print the findings of its tasks, and yield the JSON objects that they print.
        Closing the iterator ends the job.

        Args:
            job: The job.
            findings: Receives the findings instead of those of the command, which prints them.

        Raises:
            JobError: After all others have ended, if a task failed.
        """
        from usdsplat.core.findings import Finding

        told = self._reporter.findings if findings is None else findings
        total = len(job.tasks())
        failed: list[Outcome] = []
        label = f"{job.name}, task"
        go_on = resumed(self._reporter.arguments)
        with interrupt.advising(f"go on with: {go_on}"), self._reporter.progress() as progress:
            progress.step(label, 0, total)
            for done, outcome in enumerate(self._outcomes(job), 1):
                progress.step(label, done, total)
                if not outcome.is_done or outcome.result is None:
                    failed.append(outcome)
                    if outcome.result is not None:
                        where = f"{outcome.task.name} on {outcome.result.host}"
                        console.complain(f"{where}: {outcome.result.reason}")
                    continue
                printed = json.loads(outcome.result.out)
                found = (Finding(**each) for each in printed.pop("findings"))
                told.extend(found)
                yield printed
        if failed and all(each.result is None or each.result.status == 1 for each in failed):
            raise StrictError("--strict", f"findings in {job.name}", "none; nothing is written")
        if failed:
            count = f"{len(failed)} of {counted(total, 'task')} that failed"
            raise JobError(job.name, count, f"none; the others are done, go on with: {go_on}")

    def _can_fork(self, modules: Sequence[str]) -> bool:
        """Return whether workers can be forked now, see `forking`. The driver of GPUs, which was
        asked for their number, does not work in a process that was forked then."""
        uses_gpus = any(GPUS in each for each in self._environments)
        return not uses_gpus and forking.prepared(modules)

    def _outcomes(self, job: Job) -> Iterator[Outcome]:
        assert self._workers is not None  # the caller writes a bundle for a farm
        say = self._reporter.remark
        return self._workers.run(job, retries=self._options.retries, say=say)
