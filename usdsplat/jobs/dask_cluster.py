"""Run a job with Dask: on a cluster of this process, or on a scheduler at an address.

Tasks are sent as words of a command line, the folder in which they are to be read, and the
reference to a function; nothing else is pickled. They go only to workers that were found to have
our version, which declare the resource OURS then. Dask repeats tasks whose workers die, as often as
its setting `distributed.scheduler.allowed-failures` says. Tasks of a client that dies are
cancelled.

Source: the documentation of `distributed`.
"""

from __future__ import annotations

import logging
import os
import time
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING, Any, Self

from usdsplat import __version__
from usdsplat.core import interrupt
from usdsplat.core.errors import BackendError, UsageError
from usdsplat.jobs.dask_local import LocalCluster
from usdsplat.jobs.job import Job, Task
from usdsplat.jobs.local import Fork
from usdsplat.jobs.outcome import Outcome, Say, TaskResult

if TYPE_CHECKING:
    from distributed import Client

LOCAL = "local"
INSTALL = "pip install 'usdsplat[farm]'"
PATIENCE = 15.0
"""Time to wait for a scheduler and a worker [s]."""
DESERTED = 60.0
"""Time after which a job is given up none of whose tasks runs, while no worker meets the needs of
one that is left [s]: others may be started meanwhile."""
BEAT = 0.2
"""Time between looks at signals [s]."""
ROUND = 5.0
"""Time between looks at the workers [s]."""
OURS = f"usdsplat {__version__}"
"""Resource of workers with our version, which each task takes: they do one at a time."""
GPU, MEMORY = "GPU", "MEMORY"
"""Resources that workers may declare: a number of GPUs, and bytes. Tasks that need them are sent to
workers that have them, as soon as one worker declares them."""

Needs = Mapping[str, float]
"""Resource -> amount that a task takes of it."""

RunTask = Callable[..., dict[str, Any]]
"""Function that a worker calls with the words of a task, the folder in which they are read, and
the results of the tasks before it. It returns the fields of a `TaskResult`, or raises a
`TaskFailed`."""


class TaskFailed(Exception):
    """A task that did not succeed.

    Args:
        words: Its command line.
        status: Exit status.
        reason: Why, in one line.
        host: Name of the machine.
    """

    def __init__(self, words: tuple[str, ...], status: int, reason: str, host: str) -> None:
        super().__init__(words, status, reason, host)
        self.words, self.status, self.reason, self.host = words, status, reason, host


class DaskWorkers:
    """The workers of a cluster, a context manager that connects to them.

    Args:
        address: Address of a scheduler, such as "tcp://host:8786" or "tls://host:8786", or "local".
            TLS is configured as `distributed` documents it.
        environments: Variables of each worker of a local cluster.
        run_task: What workers do with a task.
        fork: Forks the first workers of a local cluster, see `LocalCluster`.
        resources: Amounts of resources that each task takes beside GPU and MEMORY.
    """

    def __init__(
        self,
        address: str,
        environments: Sequence[Mapping[str, str]],
        run_task: RunTask,
        *,
        fork: Fork | None = None,
        resources: Mapping[str, float] | None = None,
    ) -> None:
        self._address, self._environments, self._run_task = address, environments, run_task
        self._fork, self._asked = fork, dict(resources or {})
        self._local: LocalCluster | None = None
        self._where = f"--dask {address}"
        self._stack = ExitStack()
        self._resources: list[Needs] = []
        self._refused: set[str] = set()

    def __enter__(self) -> Self:
        """Connect to the cluster.

        Raises:
            BackendError: If Dask is not installed, or there is no scheduler or no suitable worker.
        """
        with ExitStack() as stack:
            self._client = self._connected(stack)
            self._resources = self._checked()
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def __len__(self) -> int:
        """Return the number of workers that were there at the beginning."""
        return len(self._resources)

    def run(self, job: Job, *, retries: int, say: Say = lambda text: None) -> Iterator[Outcome]:
        """Run a job, and yield each task when it has ended. Closing the iterator cancels the
        others.

        Args:
            job: The job.
            retries: How often a task that fails is tried again.
            say: Receives a message on each worker that joins and cannot do tasks.

        Raises:
            BackendError: If the scheduler or all workers end, or no worker has what a task needs,
                at the beginning or for long.
            Interrupted: If the process was asked to end.
        """
        from distributed import CancelledError

        client, run = self._client, uuid.uuid4().hex[:8]
        needs = job.needs()
        resources = {task: self._needed(task, job) for task in needs}
        ours = {OURS: 1.0} if self._local is None else {}
        futures: dict[Task, Any] = {}
        for number, (task, before) in enumerate(needs.items()):
            futures[task] = client.submit(
                self._run_task,
                task.words,
                os.getcwd(),
                *(futures[each] for each in before),
                key=f"usdsplat-{run}-{number}",
                retries=retries,
                priority=len(before),  # tiles are joined as soon as they are drawn
                resources={**resources[task], **ours},
                pure=False,
            )
        left = {future.key: (task, future) for task, future in futures.items()}
        futures.clear()  # Dask repeats tasks whose results are still wanted when their worker dies
        try:
            yield from self._ended(left, resources, say)
        except (CancelledError, OSError) as error:
            raise BackendError(
                self._where, "a scheduler that ended", "one that runs; --resume goes on"
            ) from error
        finally:
            with suppress(Exception):  # the scheduler may be gone
                for _, future in left.values():  # Dask forgets tasks that nobody wants
                    future.release()

    # --- private ---------------------------------------------------------------------------

    def _connected(self, stack: ExitStack) -> Client:
        try:
            from distributed import Client
        except ImportError as error:
            raise BackendError("--dask", "no package distributed", INSTALL) from error
        stack.enter_context(_quiet())
        place: Any = self._address
        count = 1
        if self._address == LOCAL:
            self._local = stack.enter_context(LocalCluster(self._environments, self._fork))
            place, count = self._local.cluster, len(self._environments)  # they share a loop
        elif "://" not in self._address:
            raise UsageError("--dask", repr(self._address), "local, or tcp://HOST:PORT")
        try:
            client = stack.enter_context(Client(place, timeout=PATIENCE))
        except (OSError, ValueError, TypeError) as error:  # TypeError: tls without its settings
            found = f"no scheduler ({str(error).splitlines()[0]})"
            raise BackendError(self._where, found, "one that runs") from error
        try:
            client.wait_for_workers(count, timeout=PATIENCE)
        except TimeoutError as error:
            if not client.nthreads():
                raise BackendError(self._where, "a scheduler without workers", "one") from error
        return client

    def _checked(self) -> list[Needs]:
        """Return the resources of each worker, and let all get tasks.

        Raises:
            BackendError: If a worker has no usdsplat, or another version.
        """
        try:
            told = self._client.run(_described, on_error="return")
            for address, answer in told.items():
                if unfit := _unfit(address, answer):
                    raise BackendError(self._where, *unfit)
            if self._local is None:
                self._client.run(_admit)
        except BackendError:
            raise
        except Exception as error:  # such as a connection that is lost
            found = f"workers that do not answer ({error})"
            raise BackendError(self._where, found, "some") from error
        return [answer[1] for answer in told.values()]

    def _fit(self, say: Say) -> list[Needs]:
        """Return the resources of each worker that gets tasks. Let those that joined get some."""
        there = self._client.scheduler_info(n_workers=-1)["workers"]
        if self._local is not None:
            return [each["resources"] for each in there.values()]
        fit = [each["resources"] for each in there.values() if OURS in each["resources"]]
        joined = [address for address, each in there.items() if OURS not in each["resources"]]
        if not joined:
            return fit
        told = self._client.run(_described, workers=joined, on_error="return")
        for address, answer in told.items():
            if isinstance(answer, OSError):  # it has left, or is asked again
                continue
            if unfit := _unfit(address, answer):
                found, expected = unfit
                message = f"{self._where}: found {found}, expected {expected}; it gets no task"
                if message not in self._refused:
                    self._refused.add(message)
                    say(message)
                continue
            self._client.run(_admit, workers=[address], on_error="return")
            fit.append(answer[1])
        return fit

    def _needed(self, task: Task, job: Job) -> dict[str, float]:
        """Return the resources of a worker that a task takes."""
        needed: dict[str, float] = {GPU: 1.0} if task.uses_gpu else {}
        if job.memory is not None:
            needed[MEMORY] = float(job.memory)
        declared = {name for each in self._resources for name in each}
        needed = {name: amount for name, amount in needed.items() if name in declared}
        needed |= self._asked
        if lacking := _lacking([needed], self._resources):
            raise BackendError(self._where, *lacking)
        return needed

    def _ended(
        self, left: dict[str, tuple[Task, Any]], needs: Mapping[Task, Needs], say: Say
    ) -> Iterator[Outcome]:
        """Yield tasks as they end, and remove them.

        Args:
            left: Pairs of a task and its future by the future's key.
            needs: Resources that each task takes beside OURS.
            say: See `run`.
        """
        from distributed import wait

        seen = looked = time.monotonic()
        while left:
            interrupt.check()
            if time.monotonic() - looked > ROUND:
                looked = time.monotonic()
                if self._local is not None:
                    self._local.replace_dead()
                lacking = _lacking([needs[task] for task, _ in left.values()], self._fit(say))
                if not lacking or self._is_busy(left):
                    seen = looked
                elif looked - seen > DESERTED:
                    found, expected = lacking
                    raise BackendError(self._where, found, f"{expected}; --resume goes on")
            try:
                waiting = [future for _, future in left.values()]
                done = wait(waiting, timeout=BEAT, return_when="FIRST_COMPLETED").done
            except TimeoutError:
                continue
            waiting.clear()
            outcomes = []  # results are kept by workers, which may die while the caller works
            while done:
                future = done.pop()
                if future.status == "lost":  # it is computed again
                    continue
                try:
                    result = _result(future, left[future.key][0])
                except TimeoutError:  # its worker died just now
                    continue
                task, _ = left.pop(future.key)
                del future
                outcomes.append(Outcome(task=task, result=result))
            yield from outcomes

    def _is_busy(self, left: Mapping[str, object]) -> bool:
        """Return whether a worker is at one of the tasks with these keys."""
        return any(key in left for keys in self._client.processing().values() for key in keys)


def _lacking(needs: Sequence[Needs], workers: Sequence[Needs]) -> tuple[str, str] | None:
    """Return what was found and what was expected, if no worker can run one of some tasks.

    Args:
        needs: Resources that each task takes.
        workers: Resources that each worker declares.
    """
    if not workers:
        return "a cluster whose workers all ended", "a worker"
    for needed in needs:
        if not any(all(each.get(n, 0) >= a for n, a in needed.items()) for each in workers):
            asked = ", ".join(f"{name}={amount:.15g}" for name, amount in needed.items())
            return "no worker that meets the needs of a task", f"one with --resources {asked!r}"
    return None


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep the client's messages from the terminal: what they tell of is said in one sentence."""
    known = logging.Logger.manager.loggerDict  # Dask sets levels of its own for some
    loggers = [logging.getLogger(name) for name in known if name.split(".")[0] == "distributed"]
    levels = [log.level for log in loggers]
    for log in loggers:
        log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for log, level in zip(loggers, levels, strict=True):
            log.setLevel(level)


def _unfit(address: str, answer: Any) -> tuple[str, str] | None:
    """Return what was found and what was expected, if a worker cannot do tasks.

    Args:
        address: Its address.
        answer: What `_described` returned or raised there.
    """
    if isinstance(answer, BaseException):
        found = f"a worker without usdsplat, {address} ({' '.join(str(answer).split())})"
        return found, f"{INSTALL} on each"
    if answer[0] != __version__:
        return f"usdsplat {answer[0]} on the worker {address}", f"usdsplat {__version__}"
    return None


def _described(dask_worker: Any) -> tuple[str, dict[str, float]]:
    """Return the version of usdsplat, and the resources that a worker declares."""
    return __version__, dict(dask_worker.state.total_resources)


async def _admit(dask_worker: Any) -> None:
    """Let a worker get tasks: declare OURS. A scheduler assigns tasks that had no worker only when
    one joins or goes on after a pause."""
    from distributed.core import Status

    if OURS in dask_worker.state.total_resources:
        return
    await dask_worker.set_resources(**{OURS: 1.0})
    if dask_worker.status == Status.running:
        dask_worker.status = Status.paused
        dask_worker.status = Status.running


def _result(future: Any, task: Task) -> TaskResult | None:
    """Return the result of a future that has ended; None if a task before it failed.

    Raises:
        TimeoutError: If the result is lost, and the task runs again.
        OSError: If the scheduler ended.
    """
    if future.status == "cancelled":
        return TaskResult(status=2, err=future.status, host="the cluster")
    try:
        return TaskResult(**future.result(timeout=ROUND))
    except OSError:
        if future.status != "error":  # of the connection, not of the task
            raise
    except Exception as error:
        return _failure(error, future.key, task)
    return _failure(future.exception(), future.key, task)


def _failure(error: BaseException, key: str, task: Task) -> TaskResult | None:
    """Return the result of a task that ended with an error; None if it is one of a task before."""
    from distributed import KilledWorker

    if isinstance(error, TaskFailed):
        if tuple(error.words) != task.words:
            return None
        return TaskResult(status=error.status, err=error.reason, host=error.host)
    if isinstance(error, KilledWorker):
        if error.task != key:
            return None
        reason = f"found {error.allowed_failures + 1} workers that died, expected one that does not"
        return TaskResult(status=2, err=f"worker: {reason}", host=error.last_worker.address)
    return TaskResult(status=2, err=" ".join(str(error).split()), host="the cluster")
