"""Run a job with Dask: on a cluster of this process, or on a scheduler at an address.

Tasks are sent as words of a command line, the folder in which they are to be read, and the
reference to a function; nothing else is pickled. Dask repeats tasks whose workers die, as often as
its setting `distributed.scheduler.allowed-failures` says. Tasks of a client that dies are
cancelled.

Source: the documentation of `distributed`.
"""

from __future__ import annotations

import logging
import os
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from usdsplat import __version__
from usdsplat.core import interrupt
from usdsplat.core.errors import BackendError, UsageError
from usdsplat.jobs.job import Job, Task
from usdsplat.jobs.outcome import Outcome, TaskResult

if TYPE_CHECKING:
    from distributed import Client, SpecCluster

LOCAL = "local"
LOOPBACK = "127.0.0.1"
INSTALL = "pip install 'usdsplat[farm]'"
PATIENCE = 15.0
"""Time to wait for a scheduler and a worker [s]."""
BEAT = 0.2
"""Time between looks at signals [s]."""

RunTask = Callable[..., dict[str, Any]]
"""Function that a worker calls with the words of a task and the folder in which they are read, and
with the results of the tasks before it. It returns the fields of a `TaskResult`, or raises a
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


@dataclass(frozen=True, slots=True, kw_only=True)
class DaskCluster:
    """Where tasks are run."""

    address: str
    """Address of a scheduler, such as "tcp://host:8786" or "tls://host:8786", or "local". TLS is
    configured as `distributed` documents it."""
    environments: Sequence[Mapping[str, str]]
    """Variables of each worker of a local cluster."""
    retries: int = 1
    """How often a task that fails is tried again."""


def run_on_dask(job: Job, cluster: DaskCluster, run_task: RunTask) -> Iterator[Outcome]:
    """Run a job, and yield each task when it has ended. Closing the iterator cancels the others.

    Raises:
        BackendError: If Dask is not installed, or there is no scheduler or no suitable worker.
        Interrupted: If the process was asked to end.
    """
    with ExitStack() as stack:
        client = _connected(cluster, stack)
        from distributed import CancelledError, Future

        needs = job.needs()
        futures: dict[Task, Any] = {}
        run = uuid.uuid4().hex[:8]
        for number, (task, before) in enumerate(needs.items()):
            futures[task] = client.submit(
                run_task,
                task.words,
                os.getcwd(),
                *(futures[each] for each in before),
                key=f"usdsplat-{run}-{number}",
                retries=cluster.retries,
                priority=len(before),  # tiles are joined as soon as they are drawn
                pure=False,
            )
        submitted = [future.key for future in futures.values()]
        try:
            yield from _ended(futures)
        except (CancelledError, OSError) as error:
            expected = "one that runs; --resume goes on"
            raise BackendError(
                f"--dask {cluster.address}", "a scheduler that ended", expected
            ) from error
        finally:
            with suppress(Exception):  # the scheduler may be gone
                client.cancel([Future(key, client) for key in submitted])


def _connected(cluster: DaskCluster, stack: ExitStack) -> Client:
    try:
        from distributed import Client
    except ImportError as error:
        raise BackendError("--dask", "no package distributed", INSTALL) from error
    where = f"--dask {cluster.address}"
    if cluster.address == LOCAL:
        client = stack.enter_context(Client(stack.enter_context(_local_cluster(cluster))))
    else:
        if "://" not in cluster.address:
            raise UsageError("--dask", repr(cluster.address), "local, or tcp://HOST:PORT")
        try:
            client = stack.enter_context(Client(cluster.address, timeout=PATIENCE))
        except (OSError, ValueError, TypeError) as error:  # TypeError: tls without its settings
            found = f"no scheduler ({str(error).splitlines()[0]})"
            raise BackendError(where, found, "one that runs") from error
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError as error:
        raise BackendError(where, "a scheduler without workers", "a worker") from error
    _check_workers(client, where)
    return client


def _local_cluster(cluster: DaskCluster) -> SpecCluster:
    """Start a scheduler, which only this machine reaches, and a process for each environment."""
    from distributed import Nanny, Scheduler, SpecCluster

    # Dask would pause and kill workers by the memory that their stages take
    options = {"nthreads": 1, "memory_limit": 0, "silence_logs": logging.CRITICAL}
    workers = {
        number: {"cls": Nanny, "options": {**options, "host": LOOPBACK, "env": dict(each)}}
        for number, each in enumerate(cluster.environments)
    }
    scheduler = {"cls": Scheduler, "options": {"host": LOOPBACK, "dashboard": False, "port": 0}}
    return SpecCluster(workers=workers, scheduler=scheduler, silence_logs=logging.CRITICAL)


def _check_workers(client: Client, where: str) -> None:
    """Raise an error if a worker has no usdsplat, or another version."""
    try:
        versions = client.run(_version)
    except Exception as error:
        expected = "pip install 'usdsplat[farm]' on each"
        raise BackendError(where, f"a worker without usdsplat ({error})", expected) from error
    for address, version in versions.items():
        if version != __version__:
            found = f"usdsplat {version} on the worker {address}"
            raise BackendError(where, found, f"usdsplat {__version__}")


def _version() -> str:
    return __version__


def _ended(futures: dict[Task, Any]) -> Iterator[Outcome]:
    """Yield tasks as they end."""
    from distributed import wait

    left = {future.key: (task, future) for task, future in futures.items()}
    futures.clear()  # Dask repeats tasks whose results are still wanted when their worker dies
    while left:
        interrupt.check()
        try:
            waiting = [future for _, future in left.values()]
            done = wait(waiting, timeout=BEAT, return_when="FIRST_COMPLETED").done
        except TimeoutError:
            continue
        waiting.clear()
        while done:
            future = done.pop()
            if future.status == "lost":  # it is computed again
                continue
            task, _ = left.pop(future.key)
            outcome = Outcome(task=task, result=_result(future, task))
            del future
            yield outcome


def _result(future: Any, task: Task) -> TaskResult | None:
    """Return the result of a future; None if a task before it failed."""
    if future.status == "finished":
        return TaskResult(**future.result())
    error = future.exception() if future.status == "error" else None
    if isinstance(error, TaskFailed):
        if tuple(error.words) != task.words:
            return None  # the error of a task before it
        return TaskResult(status=error.status, err=error.reason, host=error.host)
    reason = " ".join(str(error).split()) if error is not None else future.status
    return TaskResult(status=2, err=reason, host="the cluster")
