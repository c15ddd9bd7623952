"""Run a job with processes of this machine.

Each worker is a process `usdsplat worker`, which is given one task after the other as a line of
JSON and answers with one. It is forked from this process where the caller can, else started. It
keeps stages and devices open between tasks. A worker that dies, or whose answer cannot be read, is
replaced, and its task is tried again.
"""

from __future__ import annotations

import json
import os
import platform
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Self

from usdsplat.core import interrupt
from usdsplat.jobs.forked import ForkedProcess
from usdsplat.jobs.job import Job, Task
from usdsplat.jobs.outcome import Outcome, Say, TaskResult

BEAT = 0.2
"""Time between looks at signals [s]."""
PATIENCE = 5.0
"""Time for a worker to end after SIGTERM [s]."""
ANSWER = "usdsplat-answer: "
"""Beginning of a worker's answer; all else on its streams are messages of libraries."""
MARKED = "USDSPLAT_JOB_WORKER"
"""Variable of workers of a job: they mark answers with ANSWER, and end with their parent. It is GPU
for those that get a GPU, which they open before they have a task."""
GPU = "gpu"
GPUS = "CUDA_VISIBLE_DEVICES"
"""Variable with the GPUs that a process may use."""
_LINES = 20
"""Lines of a worker that died which are kept."""
_GARBLED = "worker: found an answer that cannot be read, expected a line of JSON"
_Process = subprocess.Popen[str] | ForkedProcess
Fork = Callable[[Mapping[str, str]], ForkedProcess]
"""Forks a worker with these variables, in addition to those of this process."""


class LocalWorkers:
    """Processes of this machine, a context manager. They start at once, so that they load the
    program while the caller plans the job, and end with the context.

    Args:
        environments: Variables of each process, in addition to those of this one.
        fork: Forks the first process of each worker; None starts all of them. Those that replace
            others are always started.
    """

    def __init__(self, environments: Sequence[Mapping[str, str]], fork: Fork | None = None) -> None:
        self._processes = [_WorkerProcess(each, fork) for each in environments]

    def __enter__(self) -> Self:
        for each in self._processes:
            with suppress(OSError):  # the first task says why
                each.opened()
        return self

    def __exit__(self, *_: object) -> None:
        for each in self._processes:
            each.end()
        for each in self._processes:
            each.wait()

    def __len__(self) -> int:
        """Return the number of processes."""
        return len(self._processes)

    def run(self, job: Job, *, retries: int = 1, say: Say = lambda text: None) -> Iterator[Outcome]:
        """Run a job, and yield each task when it has ended.

        Args:
            job: The job.
            retries: How often a task that fails is tried again.
            say: Receives a message on each task that is tried again.

        Raises:
            Interrupted: If the process was asked to end.
        """
        plan = _Plan(job, retries, say)
        left = len(plan.needs)
        try:
            for each in self._processes:
                threading.Thread(target=each.serve, args=(plan,), daemon=True).start()
            while left:
                interrupt.check()
                try:
                    outcome = plan.ended.get(timeout=BEAT)
                except queue.Empty:
                    continue
                left -= 1
                yield outcome
        finally:
            plan.close()


class _Plan:
    """The tasks of a job, which threads take and give back."""

    def __init__(self, job: Job, retries: int, say: Say) -> None:
        self.needs = job.needs()
        self.waiting = list(self.needs)
        self.ended: queue.Queue[Outcome] = queue.Queue()
        self._retries, self._say = retries, say
        self._tries: dict[Task, int] = {}
        self._done: set[Task] = set()
        self._failed: set[Task] = set()
        self._changed = threading.Condition()
        self._is_closed = False

    def take(self) -> Task | None:
        """Wait for a task that can begin, and return it; None if there will be no more."""
        with self._changed:
            while not self._is_closed:
                # those that others had to precede come first: tiles are joined when they are drawn
                for task in sorted(self.waiting, key=lambda task: not self.needs[task]):
                    if all(each in self._done for each in self.needs[task]):
                        self.waiting.remove(task)
                        return task
                if not self.waiting and len(self._done) + len(self._failed) == len(self.needs):
                    return None
                self._changed.wait()
            return None

    def give(self, task: Task, result: TaskResult) -> None:
        """Take the result of a task. It waits again if it failed and may be tried again."""
        with self._changed:
            if self._is_closed:
                return
            tried = self._tries[task] = self._tries.get(task, 0) + 1
            if result.status != 0 and tried <= self._retries:
                self._say(f"{task.name}: {result.reason}; it is tried again")
                self.waiting.insert(0, task)
            elif result.status == 0:
                self._done.add(task)
                self.ended.put(Outcome(task=task, result=result))
            else:
                self._failed.add(task)
                self.ended.put(Outcome(task=task, result=result))
                self._drop_dependents()
            self._changed.notify_all()

    def close(self) -> None:
        """Let no further task begin."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()

    def _drop_dependents(self) -> None:
        """Give up the tasks that wait for one that failed."""
        while True:
            lost = [t for t in self.waiting if not self._failed.isdisjoint(self.needs[t])]
            if not lost:
                return
            for task in lost:
                self.waiting.remove(task)
                self._failed.add(task)
                self.ended.put(Outcome(task=task, result=None))


class _WorkerProcess:
    """A process `usdsplat worker`, which is replaced if it dies.

    Args:
        environment: Its variables, in addition to those of this process.
        fork: See `LocalWorkers`.
    """

    def __init__(self, environment: Mapping[str, str], fork: Fork | None) -> None:
        self._environment = {**environment, MARKED: GPU if GPUS in environment else "1"}
        self._fork = fork
        self._process: _Process | None = None
        self._lock = threading.Lock()
        self._is_over = False

    def end(self) -> None:
        """Ask the process to end; a task that it is at leaves no file."""
        with self._lock:
            self._is_over = True
            if self._process is not None and self._process.poll() is None:
                with suppress(OSError):
                    self._process.send_signal(signal.SIGTERM)
                if self._process.stdin is not None:
                    with suppress(OSError):
                        self._process.stdin.close()

    def wait(self) -> None:
        """Wait for the end of the process, and kill it if it takes long."""
        process = self._process
        if process is not None:
            try:
                process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def serve(self, plan: _Plan) -> None:
        """Give tasks to the process until there are no more."""
        while (task := plan.take()) is not None:
            try:
                result = self._done_by_process(task)
            except Exception as error:  # such as a process that cannot be started
                reason = " ".join(str(error).split()) or type(error).__name__
                result = TaskResult(status=2, err=f"worker: {reason}", host=platform.node())
            plan.give(task, result)

    def _done_by_process(self, task: Task) -> TaskResult:
        process = self.opened()
        if process is None:
            return TaskResult(status=130, err="interrupted")
        assert process.stdin is not None and process.stdout is not None
        others: list[str] = []
        try:
            process.stdin.write(json.dumps({"words": task.words}) + "\n")
            process.stdin.flush()
            for line in process.stdout:
                before, mark, answer = line.partition(ANSWER)  # a library may have written before
                if mark and (result := _parsed(answer)) is not None:
                    return result
                others = [*others[-_LINES:], line if not mark else before]
                if mark and answer.endswith("\n"):  # it lives, but does not answer again
                    process.kill()
                    process.wait()
                    return TaskResult(status=2, err=_GARBLED, host=platform.node())
        except BrokenPipeError:
            pass
        status = process.wait()
        if status < 0:
            others.append(f"worker: ended by {_signal(-status)}")
        elif not others:
            others.append(f"worker: ended with status {status}")
        return TaskResult(status=status or 2, err="".join(others), host=platform.node())

    def opened(self) -> _Process | None:
        """Return the process, started if there is none; None after `end`."""
        with self._lock:
            if self._is_over:
                return None
            fork, self._fork = self._fork, None
            if fork is not None:
                self._process = fork(self._environment)
            elif self._process is None or self._process.poll() is not None:
                self._process = subprocess.Popen(
                    [sys.executable, "-m", "usdsplat", "worker"],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT,
                    env={**os.environ, **self._environment},
                    encoding="utf-8",
                    errors="surrogateescape",
                    start_new_session=True,  # Ctrl-C reaches this process only, which ends them
                )
            return self._process


def _parsed(answer: str) -> TaskResult | None:
    """Return the result that an answer holds; None if the worker died while it wrote it, or if
    something else wrote into it."""
    try:
        return TaskResult(**json.loads(answer), host=platform.node())
    except (ValueError, TypeError):
        return None


def _signal(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
