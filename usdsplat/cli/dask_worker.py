"""Be a worker of the cluster that `--dask local` starts, in a process that was forked for it."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import sys
import threading

from usdsplat.cli.worker import ONE_AT_A_TIME
from usdsplat.core import interrupt
from usdsplat.jobs.dask_local import SETTINGS, WORKER

GRACE = 1.5
"""Time for a task to remove its unfinished files [s]."""


def serve() -> int:
    """Work for the scheduler whose address is the first line of stdin, until it ends or stdin does.

    Returns:
        Exit status.
    """
    import dask

    nowhere = os.open(os.devnull, os.O_WRONLY)  # results of tasks are returned, not printed
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    dask.config.set(SETTINGS)
    address = sys.stdin.readline().strip()
    threading.Thread(target=_watch, name=interrupt.WATCHER, daemon=True).start()
    asyncio.run(_served(address))
    return 0


async def _served(address: str) -> None:
    from distributed import Worker

    async with Worker(address, **WORKER) as worker:
        await worker.finished()


def _watch() -> None:
    """Wait until the process that forked this one dies, or wants no more; then end this one, and
    let the task that it is at remove its files."""
    sys.stdin.read()
    interrupt.receive(signal.SIGTERM)
    ONE_AT_A_TIME.acquire(timeout=GRACE)
    os._exit(128 + signal.SIGTERM)
