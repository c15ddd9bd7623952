"""Tests of the order of a field's splats in memory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.render.rendering import random_cloud
from usdsplat.core import morton
from usdsplat.kernels import curve, sort
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.project import BLOCK
from usdsplat.render.spatial_order import LEAST, SpatialOrder, StorageOrder, laid_out


def test_a_cloud_is_laid_out_the_second_time_it_is_drawn():
    """Oracle: written down by hand."""
    device, cloud = open_device("cpu"), random_cloud(1, n=LEAST)
    spatial_order = SpatialOrder()
    first, second, third = (spatial_order.of(device, cloud) for _ in range(3))
    assert first.rows.size == first.boxes.size == 0 and first.positions is cloud.positions
    assert second is third and spatial_order.is_made
    other = replace(cloud, positions=cloud.positions.copy())
    assert spatial_order.of(device, other).positions is other.positions
    few = random_cloud(2, n=LEAST - 1)
    assert [spatial_order.of(device, few).rows.size for _ in range(3)] == [0, 0, 0]


def test_the_orders_of_a_view_at_rest_and_of_its_movements_are_kept():
    """Oracle: identity, written down by hand: the last splats and the most keep their order, so
    that a change of the budget costs one order and a movement none."""
    device, most = open_device("cpu"), random_cloud(1, n=2 * LEAST)
    some, fewer = (random_cloud(seed, n=LEAST + seed) for seed in (2, 3))
    spatial_order = SpatialOrder()
    for cloud in (most, some):  # an order is computed when splats are projected again
        spatial_order.of(device, cloud)
        spatial_order.of(device, cloud)
    part, whole = spatial_order.of(device, some), spatial_order.of(device, most)
    assert spatial_order.of(device, most) is whole and spatial_order.is_made
    assert spatial_order.of(device, some) is part
    assert spatial_order.of(device, fewer).rows.size == 0 and not spatial_order.is_made
    assert spatial_order.of(device, most) is whole
    spatial_order.forget()
    assert spatial_order.of(device, most).rows.size == 0


def test_rows_say_where_each_splat_was():
    """Oracle: NumPy's own indexing; strays and what is nowhere are there too."""
    cloud = random_cloud(3, n=LEAST + 77)
    cloud.positions[5], cloud.positions[9] = 1e30, np.nan
    laid = laid_out(open_device("cpu"), cloud)
    np.testing.assert_array_equal(np.sort(laid.rows), np.arange(len(cloud)))
    for name in ("positions", "rotations", "scales", "opacities"):
        np.testing.assert_array_equal(getattr(laid, name), getattr(cloud, name)[laid.rows])


def test_blocks_are_small():
    """Oracle: splats that fill a cube evenly: a block of n of m has about n / m of it."""
    rng = np.random.default_rng(4)
    cloud = random_cloud(4, n=64 * BLOCK)
    cloud.positions[:] = rng.uniform(-1, 1, cloud.positions.shape)
    boxes = laid_out(open_device("cpu"), cloud).boxes
    assert np.median(np.prod(2 * boxes[:, 3:6], axis=1)) < 3 * 8 / 64


def test_codes_are_those_of_the_core():
    """Oracle: `core.morton`, which spreads 64 bits; cells are whole numbers here."""
    rng = np.random.default_rng(5)
    cells = rng.integers(0, curve.CELLS, (500, 3))
    cells[0], cells[1] = 0, curve.CELLS - 1
    out = np.zeros(len(cells), np.uint32)
    positions = np.float32(cells + 0.5)
    open_device("cpu").run(curve.codes, positions, np.zeros(3), np.ones(3), out)
    order = np.argsort(out, kind="stable")
    exact = np.float32(cells * ((1 << morton.BITS) // curve.CELLS))
    np.testing.assert_array_equal(order, morton.order(exact))


@pytest.mark.parametrize("equal", [1, 3, 1000])
def test_ties_go_by_appearance_and_row(equal):
    """Oracle: np.lexsort."""
    rng = np.random.default_rng(6)
    n = 3000
    first_slots = np.int64([0, 1000, 2500])
    sources = np.concatenate([rng.permutation(k) for k in (1000, 1500, 500)]).astype(np.int32)
    keys = np.float32(np.arange(n) // equal)[rng.permutation(n)]
    device, visible = open_device("cpu"), np.arange(n, dtype=np.int32)
    work = np.zeros((2, n), np.uint32), np.zeros((2, n), np.int32)
    half = device.run(
        sort.depth_order, visible, n, keys, 3, work, np.zeros((3, sort.DIGITS), np.int64)
    )
    order = work[1][half]
    device.run(sort.settle, work[0][half], order, n, sources, first_slots, np.zeros(n, np.int64))
    appearance = np.searchsorted(first_slots, visible, side="right")
    np.testing.assert_array_equal(order, np.lexsort([sources, appearance, keys]))


def test_arrays_in_the_order_of_rows_are_dropped_with_their_splats():
    """Oracle: the arrays of the cloud that is asked for, after a change."""
    order, device = StorageOrder(), open_device("cpu")
    before, after = (random_cloud(seed) for seed in (1, 2))
    assert order.of(device, before).positions is before.positions
    order.forget()
    assert order.of(device, after).positions is after.positions
