"""Start a scheduler of Dask and its workers on this machine."""

from __future__ import annotations

import logging
import subprocess
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from typing import Any, Self

from usdsplat.jobs.forked import ForkedProcess
from usdsplat.jobs.local import PATIENCE, Fork

LOOPBACK = "127.0.0.1"
SERVER: dict[str, Any] = {
    "host": LOOPBACK,
    "dashboard": False,
    "dashboard_address": f"{LOOPBACK}:0",
}
"""Options of all processes. Without an address, Dask would serve its state to the network."""
WORKER = {**SERVER, "nthreads": 1, "memory_limit": 0}
"""Options of the workers. Dask would pause and kill them by the memory that their stages take."""
SETTINGS = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
}
"""Settings of Dask that spare CPU time: what they leave out is for a dashboard."""
GRACE = 1.0
"""Time for workers to end by themselves [s]."""


class LocalCluster:
    """A scheduler, which only this machine reaches, and its workers, a context manager.

    Args:
        environments: Variables of each worker.
        fork: Forks a worker, which reads the scheduler's address from stdin; None starts all.
    """

    def __init__(self, environments: Sequence[Mapping[str, str]], fork: Fork | None) -> None:
        self._environments, self._fork = environments, fork
        self._forked: list[ForkedProcess] = []

    def __enter__(self) -> Self:
        import dask
        from distributed import Nanny, Scheduler, SpecCluster

        with ExitStack() as stack:
            stack.callback(self._end)
            if self._fork is not None:  # before the cluster starts threads
                with suppress(OSError):  # too many processes, or too little memory: these must do
                    for each in self._environments:
                        self._forked.append(self._fork(each))
            stack.enter_context(dask.config.set(SETTINGS))
            options = {**WORKER, "silence_logs": logging.CRITICAL}
            started = [
                {"cls": Nanny, "options": {**options, "env": dict(each)}}
                for each in self._environments
            ]
            cluster = SpecCluster(
                workers={} if self._forked else dict(enumerate(started)),
                worker=started[0],
                scheduler={"cls": Scheduler, "options": {**SERVER, "port": 0}},
                silence_logs=logging.CRITICAL,
            )
            self.cluster = stack.enter_context(cluster)
            for forked in self._forked:
                with suppress(OSError):  # it has ended, and is replaced
                    forked.stdin.write(f"{cluster.scheduler_address}\n")
                    forked.stdin.flush()
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def replace_dead(self) -> None:
        """Start a worker for each forked one that has died. Dask itself replaces the others."""
        dead = sum(each.poll() is not None for each in self._forked)
        if dead > len(self.cluster.worker_spec):
            self.cluster.scale(dead)

    def _end(self) -> None:
        """Wait for the end of the forked workers, to which the scheduler has said that it ends."""
        deadline = time.monotonic() + GRACE
        for each in self._forked:
            with suppress(subprocess.TimeoutExpired):
                each.wait(max(0.0, deadline - time.monotonic()))
        for each in self._forked:  # those that are at a task end by this
            with suppress(OSError):
                each.stdin.close()
        deadline = time.monotonic() + PATIENCE
        for each in self._forked:
            try:
                each.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                each.kill()
                each.wait()
            each.stdout.close()
