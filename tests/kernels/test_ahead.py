"""Tests of compilation by other processes."""

from __future__ import annotations

import multiprocessing
import time

import numpy as np
import pytest

from usdsplat.core.errors import BackendError
from usdsplat.kernels import ahead, jit, sort, store, total
from usdsplat.kernels.compiling import on_compile
from usdsplat.kernels.launch import kernel

PATIENCE = 60.0
"""[s] For a machine with much else to do."""
KERNELS = [
    ("total.clear", "(int64,int64) (f4:3C)"),
    ("total.add", "(int64,int64) (f4:3C,f4:3C)"),
]

pytestmark = pytest.mark.usefixtures("folder")


@pytest.fixture
def compiled_here(monkeypatch):
    """Names of what Numba compiles in this process."""
    names: list[str] = []
    with on_compile(names.append):
        yield names


def test_who_needs_what_is_being_compiled_waits_for_it(folder, compiled_here):
    """Oracle: NumPy's sum; this process is told of one thing that it waits for, and keeps nothing
    itself: there is one entry for each kernel."""
    image = np.random.default_rng(3).random((5, 4, 3), np.float32)
    out = image.copy()
    with ahead.compiling(KERNELS, jobs=1):
        assert len(jit.COMING) == 2
        again = kernel(over="total", writes=("total",), axes=2)(total.add.function)
        again.on_cpu((out, image))
        kept = [path for path in folder.rglob("*") if path.stat().st_size > 5000]
    assert compiled_here == ["add"]
    np.testing.assert_array_equal(out, image + image)
    assert not jit.COMING
    assert len(kept) == 2


def test_machine_code_of_a_process_that_runs_nothing_runs_here(compiled_here, monkeypatch):
    """Oracle: NumPy's stable argsort; nothing is compiled here."""
    steps = "take_keys", "count_digits", "move_by_digit"
    tasks = [task for task in ahead.tasks("cpu") if task.name in [f"sort.{s}" for s in steps]]
    assert len(tasks) == len(steps) and ahead.compile_all(tasks, jobs=1) == []
    count, chunks = 4000, 3
    keys = np.random.default_rng(5).integers(0, 50, count).astype(np.float32)
    visible = np.arange(count, dtype=np.int32)
    work = np.empty((2, count), np.uint32), np.empty((2, count), np.int32)
    histogram = np.empty((chunks, sort.DIGITS), np.int64)
    for name in steps:
        monkeypatch.setattr(sort, name, jit.parallel(getattr(sort, name).py_func))
    half = sort.depth_order(visible, count, keys, chunks, work, histogram)
    np.testing.assert_array_equal(work[1][half], np.argsort(keys, kind="stable"))
    assert compiled_here == []


def test_what_is_not_done_in_the_end_is_left_out(folder):
    """Oracle: no process is left, and of two kernels that one process would compile in turn the
    second is not kept."""
    heavy = [task for task in ahead.tasks("cpu") if task.name in ("blend.blend", "shade.shade")]
    assert len(heavy) == 2
    with ahead.compiling([(task.name, task.types) for task in heavy], jobs=1):
        (worker,) = multiprocessing.active_children()
    deadline = time.monotonic() + PATIENCE  # who joins it beside its pool may miss its end
    while worker.is_alive():
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert not multiprocessing.active_children()
    assert len([path for path in folder.rglob("*") if path.stat().st_size > 5000]) < 2


def test_nothing_is_begun_where_nothing_can_be_kept(folder):
    """Oracle: no process, and the reason for the user; a file is in the folder's place."""
    folder.write_text("")
    with ahead.compiling(KERNELS, jobs=1):
        assert not jit.COMING and not multiprocessing.active_children()
    assert store.refusal() == f"{folder}: not a directory"
    tasks = [task for task in ahead.tasks("cpu") if task.name == "total.clear"]
    assert ahead.compile_all(tasks, jobs=1) == [(tasks[0], store.refusal())]


class Killer:
    """Who ends the processes, as a system without memory does it, when the first kernel is done."""

    def step(self, label: str, done: int, total: int) -> None:
        for child in multiprocessing.active_children():
            child.kill()


def test_a_process_that_is_ended_is_one_sentence():
    """Oracle: the error's parts."""
    tasks = [task for task in ahead.tasks("cpu") if task.name.startswith("total.")]
    with pytest.raises(BackendError, match="compile: found a process that was killed"):
        ahead.compile_all(tasks, jobs=1, progress=Killer())
