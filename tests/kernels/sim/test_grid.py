"""Tests of the uniform grid: order of cells."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.kernels.devices import open_device
from usdsplat.kernels.sim import grid
from usdsplat.kernels.sim.grid import FAR

pytestmark = pytest.mark.usefixtures("on_device")

BITS = (4, 3, 5)


def sort(keys, bits, chunks, threads=None):
    """(start, order) of keys."""
    n = len(keys)
    moved, rows, order = (np.empty(n, np.int32) for _ in range(3))
    start = np.empty((1 << bits) + 1, np.int32)
    histogram = np.empty((chunks, 1 << grid.TOP_BITS), np.int64)
    open_device(threads=threads).run(
        grid.sort_cells, keys, bits, histogram, moved, rows, start, order
    )
    return start, order


@pytest.mark.parametrize("bits", [6, 11, 12, 17])
@pytest.mark.parametrize("chunks", [1, 5])
def test_order_is_a_stable_sort_and_starts_are_a_scan(bits, chunks) -> None:
    """Oracle: NumPy's stable argsort, and the cumulative sum of its histogram."""
    drawn = np.random.default_rng(bits).integers(0, 1 << bits, 20_000)
    keys = np.where(drawn % 3 == 0, drawn % 7, drawn).astype(np.int32)  # some cells are crowded
    start, order = sort(keys, bits, chunks)
    np.testing.assert_array_equal(order, np.argsort(keys, kind="stable"))
    counts = np.bincount(keys, minlength=1 << bits)
    np.testing.assert_array_equal(start, np.concatenate([[0], np.cumsum(counts)]))


def test_nothing_is_sorted_into_empty_cells() -> None:
    """Oracle: closed form."""
    start, order = sort(np.empty(0, np.int32), 8, 1)
    assert len(order) == 0
    assert not start.any()


def test_keys_wrap_on_each_axis() -> None:
    """Oracle: the remainder of whole numbers, in Python's own arithmetic."""
    points = np.random.default_rng(2).uniform(-40, 40, (3000, 3)).astype(np.float32)
    keys = np.empty(len(points), np.int32)
    open_device().run(grid.keys, points, 1 / 0.7, BITS, keys)
    x, y, z = (np.floor(points.astype(np.float64) / 0.7).astype(int) % (1 << np.array(BITS))).T
    np.testing.assert_array_equal(keys, x + (y << BITS[0]) + (z << BITS[0] + BITS[1]))


def test_points_far_away_or_not_finite_have_a_cell() -> None:
    """Oracle: closed form: the last cell that is told apart; rows of the table."""
    far = np.float32(3e38)
    points = np.array([[far, 0, 0], [-far, 0, 0], [np.nan, 0, 0], [0, np.inf, 0]], np.float32)
    keys = np.empty(4, np.int32)
    open_device().run(grid.keys, points, 1.0, BITS, keys)
    np.testing.assert_array_equal(keys, [int(FAR) % 16, int(-FAR) % 16, 2, 3])


def test_the_box_about_points_leaves_out_what_is_not_finite() -> None:
    """Oracle: NumPy, of the finite rows."""
    points = np.random.default_rng(3).normal(size=(3000, 3)).astype(np.float32)
    sound = points.copy()
    points[::100, 1] = np.nan
    points[50::100, 2] = np.inf
    lower, upper = np.empty((3, 3)), np.empty((3, 3))
    open_device().run(grid.bounds, points, lower, upper)
    kept = sound[np.isfinite(points).all(axis=1)]
    np.testing.assert_array_equal(lower.min(axis=0), kept.min(axis=0))
    np.testing.assert_array_equal(upper.max(axis=0), kept.max(axis=0))
