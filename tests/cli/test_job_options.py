"""Tests of the processes that a job uses."""

from __future__ import annotations

import pytest

from usdsplat.cli.job_options import JobOptions, environments, resumed
from usdsplat.kernels import device
from usdsplat.kernels.cuda import support
from usdsplat.render import memory

GIB = 1 << 30


@pytest.fixture(autouse=True)
def machine(monkeypatch):
    """A machine of 12 cores and 8.5 GiB of free memory, without a GPU."""
    monkeypatch.setattr(device, "usual_threads", lambda: 12)
    monkeypatch.setattr(memory, "free", lambda: int(8.5 * GIB))
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
