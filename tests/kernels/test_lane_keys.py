"""Tests of sorting the keys of sixteen pixels at once."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from usdsplat.kernels.lane_keys import (
    FAR,
    LINE,
    aligned,
    depths_of,
    look_up,
    place_of,
    sort_rows,
    store_keys,
)
from usdsplat.kernels.lanes import load, store


@njit
def sort_all(depths, table, keys, found, looked_up):
    """Sort `depths`, and look their places up in `table`, 16 numbers of each place."""
    count = depths.shape[0] // 16
    for i in range(count):
        at = np.uint64(16 * i)
        store_keys(keys, at, load(depths, at), i)
    sort_rows(keys, count)
    for i in range(count):
        at = np.uint64(16 * i)
        store(found, at, depths_of(keys, at))
        store(looked_up, at, look_up(keys, at, table, 16, 0, 1))


@pytest.mark.parametrize("count", [0, 1, 2, 3, 5, 16, 17, 100, 257])
def test_columns_are_sorted_by_depth_then_by_place(count: int) -> None:
    """Of both signs, with many ties and some FAR. Oracle: np.argsort(kind="stable")."""
    rng = np.random.default_rng(count)
    depths = (rng.integers(-9, 40, (count, 16)) / 8).astype(np.float32)
    depths[rng.random(depths.shape) < 0.2] = FAR
    table = rng.random((count, 16), np.float32)
    keys = np.empty(16 * count, np.int64)
    found, looked_up = np.empty_like(depths), np.empty_like(depths)
    sort_all(depths.ravel(), table.ravel(), keys, found.reshape(-1), looked_up.reshape(-1))
    order = np.argsort(depths, axis=0, kind="stable")
    np.testing.assert_array_equal(found, np.take_along_axis(depths, order, axis=0))
    np.testing.assert_array_equal(looked_up, np.take_along_axis(table, order, axis=0))
    places = [place_of(key) for key in keys.tolist()]
    np.testing.assert_array_equal(places, order.ravel())


def test_aligned_arrays_begin_with_a_line() -> None:
    """Oracle: the address that NumPy gives."""

    @njit
    def sliced(array, count):
        return aligned(array, count)

    for first in range(9):
        part = sliced(np.zeros(200, np.int64)[first:], 100)
        assert part.ctypes.data % LINE == 0 and len(part) == 100
