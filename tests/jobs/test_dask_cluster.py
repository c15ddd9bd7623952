"""Tests of what tasks ask of the workers of Dask; `tests/cli/test_job_failures` has clusters."""

from __future__ import annotations

import time
import uuid
from types import SimpleNamespace

import pytest

from usdsplat import __version__
from usdsplat.core.errors import BackendError
from usdsplat.jobs import dask_cluster
from usdsplat.jobs.dask_cluster import DaskWorkers, TaskFailed, _result
from usdsplat.jobs.frames import render_job
from usdsplat.jobs.job import Job, Parameter, Step

GIB = 1 << 30


def needed(resources, *, uses_gpu=True, memory=4 * GIB, asked=None):
    """What the first task of a job asks of workers that declare resources."""
    workers = DaskWorkers("tcp://somewhere:1", [], lambda words, folder: {}, resources=asked)
    workers._resources = list(resources)
    job = render_job(
        ("render",), (1.0,), name="a", chunk=1, tiling=None, uses_gpu=uses_gpu, memory=memory
    )
    return workers._needed(job.tasks()[0], job)


@pytest.mark.parametrize(
    ("resources", "expected"),
    [
        ([{}], {}),
        ([{"GPU": 1}, {}], {"GPU": 1}),
        ([{"MEMORY": 8 * GIB}], {"MEMORY": 4 * GIB}),
        ([{"GPU": 1, "MEMORY": 8 * GIB, "OTHER": 1}], {"GPU": 1, "MEMORY": 4 * GIB}),
    ],
    ids=str,
)
def test_tasks_take_the_resources_that_workers_declare(resources, expected):
    """Oracle: by hand: what no worker declares is not asked for."""
    assert needed(resources) == expected
    assert needed(resources, uses_gpu=False, memory=None) == {}


def test_tasks_take_the_resources_that_the_user_names():
    """Oracle: by hand: these are asked for in any case, and come first."""
    workers = [{"A100": 2, "licence": 1}, {"GPU": 4}]
    assert needed(workers, uses_gpu=False, asked={"A100": 0.5}) == {"A100": 0.5}
    assert needed(workers, asked={"GPU": 2}) == {"GPU": 2}
    with pytest.raises(BackendError, match="--resources 'licence=2'"):
        needed(workers, uses_gpu=False, asked={"licence": 2})


@pytest.mark.parametrize(
    "resources", [[{"MEMORY": GIB}], [{"GPU": 1}, {"MEMORY": 8 * GIB}]], ids=str
)
def test_a_need_that_no_worker_meets_is_an_error(resources):
    """Oracle: the sentence: nothing is submitted that would wait for ever."""
    with pytest.raises(BackendError, match="found no worker that meets the needs of a task"):
        needed(resources)


class Ended:
    """A future of Dask that has ended: with an error, or with a result that got lost with its
    worker, whereupon the task is done again."""

    key = "mine"

    def __init__(self, status, error):
        self.status, self._error = status, error

    def result(self, timeout):
        raise self._error

    def exception(self):
        return self._error


@pytest.mark.parametrize("status", ["error", "finished"])
def test_each_kind_of_failure_is_one_sentence_with_its_machine(status):
    """Oracle: by hand. A failure of another task is none of this one's."""
    distributed = pytest.importorskip("distributed")
    task = render_job(("render",), (1.0,), name="a", chunk=1, tiling=None).tasks()[0]

    def result(error):
        return _result(Ended(status, error), task)

    found = result(TaskFailed(task.words, 1, "a.usd: found nothing", "b (tcp://b:1)"))
    assert (found.status, found.reason, found.host) == (1, "a.usd: found nothing", "b (tcp://b:1)")
    assert result(TaskFailed(("other",), 2, "", "")) is None
    last = SimpleNamespace(address="tcp://b:1")
    killed = result(distributed.KilledWorker("mine", last, 3))
    assert killed.host == "tcp://b:1" and killed.status == 2
    assert killed.reason == "worker: found 4 workers that died, expected one that does not"
    assert result(distributed.KilledWorker("other", last, 3)) is None
    other = result(ValueError("two\nlines"))
    assert (other.status, other.reason) == (2, "two lines")
    if status == "error":
        assert result(TimeoutError("of a task")).reason == "of a task"
        assert result(OSError("a stale file")).reason == "a stale file"
    else:
        with pytest.raises(TimeoutError):  # it is being done again
            result(TimeoutError())
        with pytest.raises(OSError, match="no scheduler"):
            result(OSError("no scheduler"))


class Cluster:
    """A scheduler and workers in this process; names of workers begin with their version."""

    def __init__(self, monkeypatch):
        distributed = pytest.importorskip("distributed")
        monkeypatch.setattr(dask_cluster, "ROUND", 0.05)
        monkeypatch.setattr(dask_cluster, "DESERTED", 0.3)
        monkeypatch.setattr(dask_cluster, "_described", described)
        self._local = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
        server = {"cls": distributed.Scheduler, "options": {**self._local, "port": 0}}
        self._made = distributed.SpecCluster(scheduler=server, silence_logs=50)
        self._worker, self._all = distributed.Worker, []
        self.address = self._made.scheduler_address

    def start(self, version=__version__, **options):
        """Let a worker join."""

        async def started():
            name = f"{version} {uuid.uuid4().hex}"  # each is unique
            place = {**self._local, "name": name, "nthreads": 1}
            return await self._worker(self.address, **place, **options)

        self._all.append(self._made.sync(started))
        return self._all[-1]

    def end(self, worker):
        """Let a worker leave."""
        self._all.remove(worker)
        self._made.sync(worker.close)

    def close(self):
        for worker in list(self._all):
            self.end(worker)
        self._made.close()


def described(dask_worker):
    """What a worker tells, or raises without the package."""
    version = dask_worker.name.split()[0]
    if version == "none":
        raise ModuleNotFoundError("No module named 'usdsplat'")
    return version, dict(dask_worker.state.total_resources)


@pytest.fixture
def cluster(monkeypatch):
    made = Cluster(monkeypatch)
    yield made
    made.close()


def run_task(words, folder, *before):
    """Take a moment; fail at once where the version is another one."""
    distributed = pytest.importorskip("distributed")
    worker = distributed.get_worker()
    if worker.name.split()[0] != __version__:
        raise TaskFailed(words, 2, "another version", worker.address)
    time.sleep(0.1)
    return {"status": 0, "host": worker.address}


def tasks(name, count, **options):
    values = tuple(map(str, range(count)))
    return Step(name=name, command=(name,), space=(Parameter(name="n", values=values),), **options)


@pytest.mark.parametrize("version", ["0.1", "none"])
def test_a_worker_that_joins_with_another_version_gets_no_task(cluster, version):
    """Oracle: all tasks are done, by the good worker; the other one, which is always idle, would
    fail each. One sentence names it."""
    good, told = cluster.start(), []
    with DaskWorkers(cluster.address, [], run_task) as workers:
        bad = cluster.start(version)
        job = Job(name="a", steps=(tasks("draw", 10),))
        ended = list(workers.run(job, retries=0, say=told.append))
    assert len(ended) == 10 and all(each.is_done for each in ended)
    assert {each.result.host for each in ended} == {good.address}
    (sentence,) = told
    assert bad.address in sentence and sentence.endswith("; it gets no task")


def test_workers_that_join_later_do_tasks(cluster):
    """Oracle: all tasks are done, though the only worker of the beginning leaves."""
    first = cluster.start()
    with DaskWorkers(cluster.address, [], run_task) as workers:
        running = workers.run(Job(name="a", steps=(tasks("draw", 6),)), retries=0)
        ended = [next(running)]
        cluster.end(first)
        second = cluster.start()
        ended += running
    assert len(ended) == 6 and all(each.is_done for each in ended)
    assert ended[-1].result.host == second.address


def test_a_job_goes_on_while_workers_are_at_other_tasks(cluster):
    """Oracle: all tasks are done: the worker of some left, and is replaced after more than the time
    in which a job without any work is given up."""
    cluster.start()
    gpu = cluster.start(resources={"GPU": 1})
    steps = (tasks("draw", 40), tasks("join", 4, uses_gpu=True))
    with DaskWorkers(cluster.address, [], run_task) as workers:
        running = workers.run(Job(name="a", steps=steps), retries=0)
        ended = [next(running)]
        cluster.end(gpu)
        ended += (next(running) for _ in range(15))
        cluster.start(resources={"GPU": 1})
        ended += running
    assert len(ended) == 44 and all(each.is_done for each in ended)
