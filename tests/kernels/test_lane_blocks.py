"""Blocks of 4x4 pixels as sixteen lanes."""

from __future__ import annotations

import numba
import numpy as np

from usdsplat.kernels import bins, lanes
from usdsplat.kernels.batch import load_fields
from usdsplat.kernels.lane_blocks import (
    ACROSS,
    BLOCKS,
    CHANNELS,
    MANY,
    SIDE,
    STATE,
    begin_tile,
    columns,
    lay_rows,
    load_stops,
    repeated,
    rows,
    store_tile,
    touched_rows,
    touched_splats,
    turned,
)
from usdsplat.kernels.project import HALF_HEIGHT, LOG_CUTOFF, LOG_OPACITY, RECORD, A, B, C, U, V

TILE = bins.TILE
LEFT, TOP = 32.0, 16.0
"""Of the tile that the splats are near [pixel]."""


@numba.njit
def reordered(x, out):
    lanes.store(out, np.uint64(0), repeated(lanes.place(x, np.uint64(3)), np.uint64(2)))
    lanes.store(out, np.uint64(16), turned(lanes.load(x, np.uint64(0))))
    lanes.store(out, np.uint64(32), columns(np.float32(8)))
    lanes.store(out, np.uint64(48), rows(np.float32(4)))


def test_lanes_go_down_the_columns_of_a_block():
    """Oracle: np.tile, and np.mgrid transposed."""
    x, out = np.arange(20, dtype=np.float32), np.zeros(64, np.float32)
    reordered(x, out)
    y_of, x_of = np.mgrid[:SIDE, :SIDE]
    np.testing.assert_array_equal(out[:16], np.tile([5, 6, 7, 8], 4))
    np.testing.assert_array_equal(out[16:32], x[:16].reshape(4, 4).T.ravel())
    np.testing.assert_array_equal(out[32:48], 8 + x_of.T.ravel())
    np.testing.assert_array_equal(out[48:], 4 + y_of.T.ravel())


def splats(count):
    """Ellipses of all directions and sizes in and around the tile at (LEFT, TOP)."""
    rng = np.random.default_rng(11)
    records = np.zeros((count, RECORD), np.float32)
    angle, sizes = rng.uniform(0, np.pi, count), 10 ** rng.uniform(-0.2, 1.5, (count, 2))
    turn = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], 1)
    turn = turn.reshape(-1, 2, 2)
    covariances = turn @ (sizes[:, :, None] ** 2 * np.eye(2)) @ turn.transpose(0, 2, 1)
    inverse, opacity = np.linalg.inv(covariances), rng.uniform(0.01, 1, count)
    records[:, U] = LEFT + rng.uniform(-10, 26, count)
    records[:, V] = TOP + rng.uniform(-10, 26, count)
    records[:, A], records[:, B] = -0.5 * inverse[:, 0, 0], -inverse[:, 0, 1]
    records[:, C], records[:, LOG_OPACITY] = -0.5 * inverse[:, 1, 1], np.log(opacity)
    records[:, HALF_HEIGHT] = np.sqrt(2 * np.log(255 * opacity) * covariances[:, 1, 1])
    return records


@numba.njit
def masks(records, lists, out, slopes):
    batch = np.ones(7 * MANY, np.float32)
    found = np.full(ACROSS * 2 * MANY, np.float32(7))
    count = len(lists)
    load_fields(records, lists, 0, count, np.float32(LEFT), np.float32(TOP), batch, MANY)
    touched_rows(batch, found, count)
    lay_rows(batch, slopes, count)
    for k in range(BLOCKS):
        for base in range(0, count, MANY // 2):
            part = lanes.place(found, np.uint64(k % ACROSS * 2 * MANY))
            some = touched_splats(part, base, np.float32(k // ACROSS * SIDE))
            for i in range(MANY // 2):
                if base + i < MANY:
                    out[k, base + i] = (some >> np.uint64(i)) & np.uint64(1)


def test_every_splat_is_found_in_the_blocks_where_it_contributes():
    """Oracle: its exponent in float64 at each pixel. Of blocks in which no pixel contributes,
    few are found: those whose pixels the margin reaches."""
    for count in (MANY, 37, 1):
        records = splats(count)
        out = np.zeros((BLOCKS, MANY), np.uint8)
        slopes = np.zeros(2 * TILE * MANY, np.float32)
        masks(records, np.arange(count, dtype=np.int32), out, slopes)
        y, x = np.mgrid[:TILE, :TILE]
        s = records.astype(np.float64)[:, :, None, None]
        dx, dy = x + LEFT - s[:, U], y + TOP - s[:, V]
        exponent = s[:, A] * dx * dx + s[:, B] * dx * dy + s[:, C] * dy * dy + s[:, LOG_OPACITY]
        is_in = exponent >= LOG_CUTOFF
        hit = is_in.reshape(count, ACROSS, SIDE, ACROSS, SIDE).any(axis=(2, 4))
        hit = hit.reshape(count, BLOCKS).T
        found = out[:, :count].astype(bool)
        assert hit.any() and found[hit].all()
        assert found.sum() <= 1.1 * hit.sum()
        assert not out[:, count:].any()
        laid = slopes.reshape(MANY, 2, TILE)[:count]
        by_row = np.arange(TILE) + TOP - s[:, V, :, 0]
        np.testing.assert_allclose(laid[:, 0], s[:, B, :, 0] * by_row / 8, rtol=1e-4, atol=1e-6)
        constant = s[:, C, :, 0] * by_row**2 + s[:, LOG_OPACITY, :, 0]
        np.testing.assert_allclose(laid[:, 1], constant / 8, rtol=1e-4, atol=1e-6)


@numba.njit
def through(state, live, image, depths, stop, grid, x0, x1, y0, y1):
    alive = begin_tile(state, live, x0, x1, y0, y1)
    extremes = load_stops(depths, 0, 0, grid[0], stop)
    for k in range(BLOCKS):
        for lane in range(TILE):
            for c in range(1, CHANNELS):
                state[k * STATE + c * TILE + lane] = 100 * c + k * TILE + lane
    store_tile(state, image, 0, 0, y0, y1, x0, x1)
    return alive, extremes


def test_pixels_of_a_tile_come_back_at_their_places():
    """Oracle: the numbers of blocks and lanes, put in order by NumPy; other pixels stay."""
    for x0, x1, y0, y1 in ((0, 16, 0, 16), (0, 16, 3, 9), (5, 7, 0, 16), (2, 13, 4, 5)):
        grid = bins.grid_of(0, 0, TILE, TILE)
        grid = grid.view(np.recarray) if numba.config.DISABLE_JIT else grid
        depths = np.arange(TILE * TILE, dtype=np.float32).reshape(TILE, TILE)
        state, live = np.zeros(BLOCKS * STATE, np.float32), np.zeros(BLOCKS, np.uint8)
        image = np.full((TILE, TILE * CHANNELS), -1, np.float32)
        stop = np.zeros(TILE * TILE, np.float32)
        alive, extremes = through(state, live, image, depths, stop, grid, x0, x1, y0, y1)
        inside = np.zeros((TILE, TILE), bool)
        inside[y0:y1, x0:x1] = True
        blocks = inside.reshape(ACROSS, SIDE, ACROSS, SIDE).transpose(0, 2, 3, 1)
        np.testing.assert_array_equal(live, blocks.any(axis=(2, 3)).ravel())
        assert alive == live.sum() and extremes == (0, TILE * TILE - 1)
        order = np.arange(TILE * TILE, dtype=np.float32).reshape(ACROSS, ACROSS, SIDE, SIDE)
        lane_of = order.transpose(0, 3, 1, 2).reshape(TILE, TILE)
        np.testing.assert_array_equal(stop[lane_of.astype(int)], depths)
        expected = np.full((TILE, TILE, CHANNELS), -1, np.float32)
        for c in range(1, CHANNELS):
            expected[inside, c - 1] = 100 * c + lane_of[inside]
        expected[inside, 3] = 0  # all light passes
        np.testing.assert_array_equal(image.reshape(expected.shape), expected)
