"""Carry out commands that another process sends, one after the other.

examples:
  usdsplat worker < tasks.jsonl
      run the command lines of a file, with one start of the program

notes:
  `usdsplat render --jobs` starts workers itself; this command is for other programs.
  Each line of stdin is a JSON object {"words": ["render", ...]}, a command line without the
  name of the program. Each line of stdout answers one: {"status": 0, "out": "...", "err": "..."},
  the exit status and what the command wrote. A line of another form is answered with status 2.
  The stage of one command stays open for the next. The worker ends after the last line.
"""

from __future__ import annotations

import importlib
import io
import json
import os
import platform
import queue
import signal
import sys
import threading
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from usdsplat.cli import console, forking
from usdsplat.cli.reporting import Reporter
from usdsplat.core import interrupt
from usdsplat.core.errors import UsageError
from usdsplat.jobs.local import ANSWER, GPU, MARKED
from usdsplat.jobs.outcome import TaskResult

if TYPE_CHECKING:
    from usdsplat.products.keeper import EngineKeeper

USES_USD = False
KEEPER = "usdsplat_keeper"
"""Attribute of a worker of Dask."""
ONE_AT_A_TIME = threading.Lock()
"""Held while a task of Dask runs: stdout and the folder belong to the process."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat worker`: none, since its commands have their own."""


def run(options: Options, reporter: Reporter) -> int:
    """Carry out the commands of stdin."""
    from usdsplat.kernels.cuda import support
    from usdsplat.products.keeper import EngineKeeper

    forking.release()
    if has_gpu := os.environ.get(MARKED) == GPU:
        support.begin()
    if "numba" not in sys.modules:  # a forked worker has what its tasks need
        for name in forking.DRAWING:  # now: whoever sends the first task may still plan
            importlib.import_module(name)
    if has_gpu and support.obstacle() is None:
        importlib.import_module("usdsplat.kernels.cuda.device")

    lines: queue.Queue[str | None] = queue.Queue()
    of_job = bool(os.environ.get(MARKED))
    threading.Thread(target=_read, args=(lines, of_job), name="usdsplat tasks", daemon=True).start()
    keeper = EngineKeeper()
    try:
        while (line := lines.get()) is not None:
            try:
                result = carried_out(_words(line), keeper)
            except UsageError as error:  # of the line; those of commands are results
                result = TaskResult(status=2, err=f"usdsplat: {error}\n")
            interrupt.check()  # what was interrupted has no result: another worker takes the task
            answer = {name: value for name, value in asdict(result).items() if name != "host"}
            console.say(f"{ANSWER if of_job else ''}{json.dumps(answer)}")
            lines.task_done()
    finally:
        keeper.close()
    return 0


def carried_out(words: Sequence[str], keeper: EngineKeeper) -> TaskResult:
    """Run a command in this process.

    Args:
        words: The command line without the name of the program.
        keeper: Keeps the stage open.
    """
    from usdsplat.cli.main import main

    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        status = main(words, keeper=keeper)
    return TaskResult(status=status, out=out.getvalue(), err=err.getvalue())


def run_on_dask_worker(words: Sequence[str], folder: str, *before: object) -> dict[str, Any]:
    """Run a command on a worker of Dask, which keeps its stage open, and return the result.

    Args:
        words: The command line without the name of the program.
        folder: Folder in which relative paths of the command line lie.
        before: Results of the tasks that had to be done before.

    Raises:
        TaskFailed: If the command fails.
    """
    from distributed import get_worker

    from usdsplat.jobs.dask_cluster import TaskFailed
    from usdsplat.products.keeper import EngineKeeper

    worker = get_worker()
    host = f"{platform.node()} ({worker.address})"
    with ONE_AT_A_TIME:
        try:
            os.chdir(folder)
        except OSError:
            reason = f"{folder}: found no such folder on this machine, expected a shared one"
            raise TaskFailed(tuple(words), 2, reason, host) from None
        if not hasattr(worker, KEEPER):
            setattr(worker, KEEPER, EngineKeeper())
        result = carried_out(words, getattr(worker, KEEPER))
    if result.status:
        raise TaskFailed(tuple(words), result.status, result.reason, host)
    return {**asdict(result), "host": host}


def _read(lines: queue.Queue[str | None], of_job: bool) -> None:
    """Read stdin to its end. Then interrupt the command of a job that has not ended: nobody waits
    for it any more."""
    try:
        for line in sys.stdin.buffer:
            lines.put(line.decode(errors="surrogateescape"))  # the answer shows other bytes
    finally:
        lines.put(None)  # without it, the worker would wait for ever
    if of_job and lines.unfinished_tasks > 1:
        os.kill(os.getpid(), signal.SIGTERM)


def _words(line: str) -> list[str]:
    """Return the command line in a line of stdin.

    Raises:
        UsageError: If it is not a JSON object with words.
    """
    try:
        words = json.loads(line)["words"]
    except (ValueError, KeyError, TypeError, RecursionError):  # the last one if deeply nested
        words = None
    if not isinstance(words, list) or not all(isinstance(word, str) for word in words):
        raise UsageError("stdin", repr(line[:80]), 'a line such as {"words": ["render", "a.usd"]}')
    return words
