"""Fork the workers of a job; `forking.prepared` says whether that is safe."""

from __future__ import annotations

from collections.abc import Mapping

from usdsplat.cli import forking
from usdsplat.cli.supervise import begin_anew, leave_command
from usdsplat.jobs.forked import ForkedProcess


def worker(environment: Mapping[str, str]) -> ForkedProcess:
    """Fork a process that runs `usdsplat worker`.

    Args:
        environment: Its variables, in addition to those of this process.

    Raises:
        OSError: If there are too many processes, or too little memory.
    """
    return ForkedProcess(lambda: begin_anew(["worker"]), environment)


def dask_worker(environment: Mapping[str, str]) -> ForkedProcess:
    """Fork a worker of Dask, which reads the address of its scheduler from stdin.

    Arguments and errors are those of `worker`. Source: `cli.dask_worker.serve`.
    """
    from usdsplat.cli.dask_worker import serve

    def begin() -> int:
        leave_command()
        forking.release()
        return serve()

    return ForkedProcess(begin, environment)
