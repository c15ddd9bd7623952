"""Launches and arrays of a GPU, where there is one."""

from __future__ import annotations

import gc
import threading
import weakref
from typing import Any

import numpy as np
import pytest

from tests.devices import device_of
from usdsplat.kernels.device import Device
from usdsplat.kernels.sort import gather


@pytest.fixture
def cuda() -> Device:
    return device_of("cuda")


def test_views_hold_what_numpys_do(cuda: Any) -> None:
    """Oracle: NumPy."""
    here = np.arange(24, dtype=np.float32).reshape(4, 6)
    there = cuda.move(here)
    for view in (
        lambda a: a[1],
        lambda a: a[1:3],
        lambda a: a[2][1:4],
        lambda a: a.reshape(2, 12),
        lambda a: a.reshape((24,))[5:9],
        lambda a: a[:0],
    ):
        np.testing.assert_array_equal(cuda.fetch(view(there)), view(here))
        np.testing.assert_array_equal(cuda.fetch(view(there)), view(here))  # the kept one
    assert there[1] is there[1]
    assert there.reshape(-1)[3] == 3


def test_a_view_outlives_its_array_and_memory_goes_with_the_last(cuda: Any) -> None:
    """Oracle: the values; and a weak reference."""
    there = cuda.move(np.arange(6, dtype=np.int32))
    part = there[2:4]
    gone = weakref.ref(there)
    del there
    gc.collect()
    assert gone() is None
    assert cuda.fetch(part).tolist() == [2, 3]


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


@pytest.mark.parametrize("order_type", [np.int32, np.int64])
@pytest.mark.parametrize("row_type", [np.float32, np.float64, np.float32])
def test_forms_are_told_apart_by_types(cuda: Any, order_type: type, row_type: type) -> None:
    """One kernel, of whose arguments one type after the other is another. Oracle: NumPy."""
    rows = np.arange(12, dtype=row_type).reshape(4, 3)
    order = np.array([2, 0, 3], order_type)
    out = np.empty((3, 3), row_type)
    cuda.run(gather, order, rows, out)
    np.testing.assert_array_equal(out, rows[order])
