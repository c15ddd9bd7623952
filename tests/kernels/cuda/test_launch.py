"""Tests of launches and arrays on a GPU, if there is one."""

from __future__ import annotations

import gc
import threading
import weakref
from typing import Any

import numpy as np
import pytest

from tests.devices import device_of
from usdsplat.core.errors import BackendError
from usdsplat.kernels.device import Device
from usdsplat.kernels.sort import gather


@pytest.fixture
def cuda() -> Device:
    return device_of("cuda")


VIEWS_OF = {
    "row": lambda a: a[1],
    "slice": lambda a: a[1:3],
    "slice of a row": lambda a: a[2][1:4],
    "shape": lambda a: a.reshape(2, 12),
    "slice of a shape": lambda a: a.reshape((24,))[5:9],
    "nothing": lambda a: a[:0],
    "type": lambda a: a.view(np.uint32),
}


@pytest.mark.parametrize("name", VIEWS_OF)
def test_views_hold_what_numpys_do(cuda: Any, name: str) -> None:
    """And are made once. Oracle: NumPy."""
    here = np.arange(24, dtype=np.float32).reshape(4, 6)
    there, view = cuda.move(here), VIEWS_OF[name]
    np.testing.assert_array_equal(cuda.fetch(view(there)), view(here))
    assert view(there) is view(there)


def test_a_number_is_read_by_the_host(cuda: Any) -> None:
    """Oracle: NumPy."""
    assert cuda.move(np.arange(24)).reshape(4, 6)[2][3] == 15


def test_a_view_outlives_its_array_and_memory_goes_with_the_last(cuda: Any) -> None:
    """Oracle: the values; and what numba-cuda counts as allocated."""
    import numba.cuda as driver

    def allocated() -> int:
        gc.collect()
        context = driver.current_context()
        context.deallocations.clear()
        return sum(each.size for each in context.memory_manager.allocations.values())

    before = allocated()
    there = cuda.move(np.arange(1 << 20, dtype=np.int32))
    part = there[2:4]
    gone = weakref.ref(there)
    del there
    assert allocated() - before >= 4 << 20
    assert gone() is None
    assert cuda.fetch(part).tolist() == [2, 3]
    del part
    assert allocated() <= before


def test_many_views_are_not_all_kept(cuda: Any) -> None:
    """Oracle: NumPy, and the number that is said."""
    from usdsplat.kernels.cuda.arrays import VIEWS

    there = cuda.move(np.arange(1000, dtype=np.int32))
    for k in range(3 * VIEWS):
        assert cuda.fetch(there[k : k + 1]).tolist() == [k]
    assert len(there._views) <= VIEWS


def test_small_arrays_are_the_same_by_what_they_hold(cuda: Any) -> None:
    """Oracle: identity, and the values after many others."""
    kept = cuda.keep(np.arange(5.0))
    assert cuda.keep(np.arange(5.0)) is kept
    assert cuda.keep(np.arange(5)) is not kept
    for k in range(600):
        cuda.keep(np.full(3, k))
    assert cuda.fetch(kept).tolist() == [0, 1, 2, 3, 4]


def test_another_thread_launches(cuda: Any) -> None:
    """One that has used no GPU before, with arrays that are there. Oracle: NumPy."""
    rows = np.arange(12, dtype=np.float32).reshape(4, 3)
    order = np.array([2, 0, 3], np.int32)
    given = cuda.move(order), cuda.move(rows), cuda.resident((3, 3), np.float32)
    thread = threading.Thread(target=cuda.run, args=(gather, *given))
    thread.start()
    thread.join()
    np.testing.assert_array_equal(cuda.fetch(given[2]), rows[order])


def test_threads_that_look_up_new_arrays_do_not_share_one(cuda: Any) -> None:
    """Oracle: the values."""
    wrong: list[int] = []

    def look_up(own: int) -> None:
        for k in range(500):
            number = own * 1000 + k
            if cuda.fetch(cuda.keep(np.full(4, number)))[0] != number:
                wrong.append(number)

    threads = [threading.Thread(target=look_up, args=(own,)) for own in range(4)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    assert not wrong


@pytest.mark.parametrize("size", [4, 100_000])
def test_a_driver_that_fails_is_a_sentence(
    cuda: Any, size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of small arrays as of large ones. Oracle: our error, on which the CPU takes over."""
    from numba import cuda as driver
    from numba.cuda.cudadrv.driver import CudaAPIError

    from usdsplat.kernels.cuda import transfers

    def fails(*args: Any, **options: Any) -> None:
        raise CudaAPIError(700, "CUDA_ERROR_ILLEGAL_ADDRESS")

    monkeypatch.setattr(driver, "to_device", fails)
    monkeypatch.setattr(transfers, "host_to_device", fails)
    with pytest.raises(BackendError, match="ILLEGAL_ADDRESS"):
        cuda.keep(np.random.default_rng().random(size))


def test_forms_are_told_apart_by_types(cuda: Any) -> None:
    """One kernel, of whose arguments one type after the other is another. Oracle: NumPy."""
    for row_type in (np.float32, np.float64, np.float32):
        for order_type in (np.int32, np.int64):
            rows = np.arange(12, dtype=row_type).reshape(4, 3)
            order = np.array([2, 0, 3], order_type)
            out = np.empty((3, 3), row_type)
            cuda.run(gather, order, rows, out)
            np.testing.assert_array_equal(out, rows[order])


def test_arguments_arrive_by_their_types(cuda: Any) -> None:
    """Python's numbers and NumPy's, tuples in tuples, an empty array and one with strides. Oracle:
    the same sum by Python."""
    from numba import cuda as driver

    from usdsplat.kernels.cuda.launch import Kernel

    @Kernel
    @driver.jit
    def add(a, b, c, d, arrays, out):
        (row, (empty, column)) = arrays
        out[0] = a + b + d + row[1] + column[1] + empty.shape[0]
        out[1] = 1 if c else 0

    table = cuda.move(np.arange(6, dtype=np.float64).reshape(2, 3))
    empty = cuda.resident(0, np.float32)
    out = cuda.resident(2, np.float64)
    for c in (True, False):
        args = (1 << 40, 0.5, c, np.float32(0.25), (table[1], (empty, table[:, 2])), out)
        add[1, 1, cuda.stream](*args)
        assert cuda.fetch(out).tolist() == [(1 << 40) + 0.75 + 4 + 5, float(c)]
