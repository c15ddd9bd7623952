"""Tests of what tasks ask of the workers of Dask; `tests/cli/test_job_failures` has clusters."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from usdsplat.core.errors import BackendError
from usdsplat.jobs.dask_cluster import DaskWorkers, TaskFailed, _result
from usdsplat.jobs.frames import render_job

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
