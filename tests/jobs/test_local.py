"""Tests of jobs that processes of this machine run."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import pytest

from usdsplat.jobs import local
from usdsplat.jobs.job import Job, Parameter, Slot, Step
from usdsplat.jobs.local import LocalWorkers


def job_of(*commands):
    """A job with a step for each command, side by side."""
    steps = [Step(name=f"s{i}", command=tuple(words)) for i, words in enumerate(commands)]
    return Job(name="job", steps=tuple(steps))


def ran(job, count, retries=0, say=lambda text: None):
    """Yield the outcomes of a job."""
    with LocalWorkers([{"USDSPLAT_THREADS": "1"}] * count) as workers:
        yield from workers.run(job, retries=retries, say=say)


def test_each_task_is_run_once_and_gives_what_it_printed():
    """Oracle: `usdsplat --version`, and the error of an unknown command."""
    found = {each.task.step: each for each in ran(job_of(["--version"], ["no"]), 2)}
    assert found["s0"].is_done and found["s0"].result.out.startswith("usdsplat ")
    assert not found["s1"].is_done and found["s1"].result.status == 2
    assert found["s1"].result.reason.startswith("command: found 'no', expected one of ")


def test_a_task_that_fails_is_tried_again_and_those_after_it_are_not_begun():
    """Oracle: the messages, and the tasks by hand."""
    said = []
    steps = (
        Step(name="a", command=("no",)),
        Step(name="b", command=("--version",), after=("a",)),
        Step(name="c", command=("--version",)),
    )
    job = Job(name="job", steps=steps)
    found = {each.task.step: each for each in ran(job, 1, 2, said.append)}
    assert len(said) == 2 and all(text.endswith("; it is tried again") for text in said)
    assert found["a"].result.status == 2 and found["b"].result is None and found["c"].is_done


def test_an_answer_that_is_cut_off_is_none():
    """Oracle: by hand: a worker that is killed while it writes leaves the beginning of a line."""
    whole = json.dumps({"status": 0, "out": "abc", "err": ""})
    assert local._parsed(whole).out == "abc"
    assert all(local._parsed(whole[:end]) is None for end in range(len(whole)))


GARBLING = """
import sys, time
from usdsplat.jobs.forked import ForkedProcess
from usdsplat.jobs.local import ANSWER, LocalWorkers
from tests.jobs.test_local import job_of

def garbling():
    sys.stdin.readline()
    print(ANSWER + '{"status": 0, "ou a library', flush=True)
    print('t": "", "err": ""}', flush=True)
    time.sleep(600)
    return 0

said = []
with LocalWorkers([{}], lambda each: ForkedProcess(garbling, each)) as workers:
    (outcome,) = workers.run(job_of(["--version"]), retries=1, say=said.append)
print(*said, outcome.result.status)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="forks a worker")
def test_a_worker_whose_answer_cannot_be_read_is_replaced():
    """Oracle: by hand. A library breaks the first answer in two; that worker would live on, and
    never answer again."""
    done = subprocess.run(
        [sys.executable, "-c", GARBLING],
        capture_output=True, text=True, timeout=60, cwd=Path(__file__).parents[2],
    )  # fmt: skip
    found = "worker: found an answer that cannot be read, expected a line of JSON"
    assert done.stdout == f"s0: {found}; it is tried again 0\n", done.stderr


def children(pid):
    """The processes below a process, whichever of its threads started them."""
    mine = []
    with suppress(OSError):  # it has ended
        for path in list(Path(f"/proc/{pid}/task").glob("*/children")):
            with suppress(OSError):  # the thread has
                mine += map(int, path.read_text().split())
    return [*mine, *(below for each in mine for below in children(each))]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_a_worker_that_is_killed_is_replaced():
    """Oracle: all tasks are done once, although a worker is killed after the first one."""
    numbers = Parameter(name="n", values=tuple(map(str, range(6))))
    job = Job(
        name="job",
        steps=(Step(name="a", command=("--version", Slot("--n", "n")), space=(numbers,)),),
    )
    done, killed = Counter(), 0
    for outcome in ran(job, 1, 3):
        done[outcome.task] += outcome.is_done
        if not killed:
            for pid in children(os.getpid()):
                with suppress(OSError):  # it ends with the one that watches it
                    if b"worker" in Path(f"/proc/{pid}/cmdline").read_bytes():
                        os.kill(pid, signal.SIGKILL)
                        killed += 1
    assert killed and set(done.values()) == {1} and len(done) == 6


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_workers_end_with_the_process_that_started_them():
    """Oracle: no process is left soon after the client of a long job was killed."""
    code = (
        "from tests.jobs.test_local import job_of, ran;"
        "job = job_of(['--version'], ['worker'], ['worker']);"  # two that wait for ever
        "[print('begun', flush=True) for _ in ran(job, 2)]"
    )
    client = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, cwd=Path(__file__).parents[2]
    )
    assert client.stdout.readline().startswith(b"begun")
    below = children(client.pid)
    assert below
    client.kill()
    client.wait()
    deadline = time.monotonic() + 120
    while any(Path(f"/proc/{pid}").exists() for pid in below):
        assert time.monotonic() < deadline, "workers are left"
        time.sleep(0.05)
