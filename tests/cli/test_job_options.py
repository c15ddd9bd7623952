"""Tests of the processes that a job uses."""

from __future__ import annotations

import pytest

from usdsplat.cli.job_options import (
    FORM,
    JobOptions,
    check_jobs,
    environments,
    resources_of,
    resumed,
)
from usdsplat.core import system_memory
from usdsplat.core.errors import UsageError
from usdsplat.kernels import device
from usdsplat.kernels.cuda import support

GIB = 1 << 30


@pytest.fixture(autouse=True)
def machine(monkeypatch):
    """A machine of 12 cores and 8.5 GiB of free memory, without a GPU."""
    monkeypatch.setattr(device, "usual_threads", lambda: 12)
    monkeypatch.setattr(system_memory, "free", lambda: int(8.5 * GIB))
    monkeypatch.setattr(support, "gpu_count", lambda: 0)
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)


@pytest.mark.parametrize(
    ("limit", "count"), [(None, 8), (GIB // 2, 12), (3 * GIB, 2), (20 * GIB, 1)]
)
def test_auto_is_a_process_for_each_core_that_memory_holds(limit, count):
    """Oracle: by hand: 12 cores, which the processes share; 1 GiB each where there is no limit."""
    found = environments(JobOptions(jobs="auto"), device="cpu", threads=None, memory=limit)
    assert found == [{"USDSPLAT_THREADS": str(12 // count)}] * count
    assert len(environments(JobOptions(jobs="3"), device="cpu", threads=1, memory=limit)) == 3


def test_each_process_has_a_gpu(monkeypatch):
    """Oracle: by hand: two GPUs, of which processes take turns."""
    monkeypatch.setattr(support, "gpu_count", lambda: 2)
    found = environments(JobOptions(jobs="auto"), device="cuda", threads=None)
    assert [each["CUDA_VISIBLE_DEVICES"] for each in found] == ["0", "1"]
    found = environments(JobOptions(jobs="3"), device="cuda", threads=None)
    assert [each["CUDA_VISIBLE_DEVICES"] for each in found] == ["0", "1", "0"]


def test_the_command_that_goes_on():
    """Oracle: by hand: `lod` continues by itself."""
    words = ("render", "a b.usd", "--force", "--jobs", "2", "--resume")
    assert resumed(words) == "usdsplat render 'a b.usd' --jobs 2 --resume"
    assert resumed(("lod", "a.ply", "-o", "a.usda")) == "usdsplat lod a.ply -o a.usda"


def test_names_of_resources():
    """Oracle: by hand: the forms that `dask worker --resources` reads."""
    assert resources_of("A100=1,licence=0.5") == {"A100": 1.0, "licence": 0.5}
    assert resources_of("A100=1 MEMORY=16e9") == {"A100": 1.0, "MEMORY": 16e9}
    assert resources_of(None) == {}


@pytest.mark.parametrize(
    "text", ["A100", "=1", "A100=", "A100=0", "A100=inf", "A100=nan", "a=1,b", "", "a=1 a=2"]
)
def test_bad_resources(text):
    """Oracle: the sentence."""
    with pytest.raises(UsageError, match=f"expected {FORM}"):
        check_jobs(JobOptions(dask="local", resources=text))


def test_resources_without_dask_are_refused():
    """Oracle: the sentence."""
    with pytest.raises(UsageError, match="found it without --dask"):
        check_jobs(JobOptions(jobs="2", resources="A100=1"))
