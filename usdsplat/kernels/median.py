"""Find the splat at which half of a pixel's own coverage is reached, for depth and ids.

A visible surface is part of the coverage: the pixel is then fully covered, and half of the coverage
may be reached at the surface, which other arrays describe.

The coverage of a pixel is known only when it is finished. The lists are therefore walked a second
time, with the same arithmetic and without colour. Each pixel ends at the splat at which half is
reached.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from .batch import FIELDS, LOOK, load_batch, load_occluder_depth, look
from .bins import TILE
from .blend import END, alpha_at
from .jit import parallel, scalar
from .launch import kernel
from .project import DEPTH
from .ray_hit import CENTER, GX, GY, HX, HY, HZ, REACH, ray_hit_at, row_at

ROW = 3 * TILE
"""Floats of one row of a tile's state: transmittance; transmittance to reach; index in the list,
from 1, of the splat at which it is reached. The index is an int32 stored in the bits of a float,
which are only copied."""
NONE = np.int32(-1)


# --- 1. mathematics: one splat over one row of 16 pixels --------------------------------


@scalar
def pass_row(state, row, u, a, slope, rest, place):
    """Apply one splat to row `row` of a tile's state. Store `place` in the pixels whose
    transmittance falls to the value to reach."""
    at = np.uint64(row * ROW)
    for x in range(TILE):
        j = at + np.uint64(x)
        alpha = alpha_at(np.float32(x) - u, a, slope, rest)
        t = state[j]
        left = t - alpha * t
        goes_on = left >= END
        passed = goes_on and left <= state[j + np.uint64(TILE)] and alpha > np.float32(0)
        state[j] = left if goes_on and not passed else -abs(t)
        mark = state[j + np.uint64(2 * TILE)]
        state[j + np.uint64(2 * TILE)] = place if passed else mark


@scalar
def pass_row_before(state, stop, row, u, a, slope, rest, place, ray_hit, dy, is_parallel):
    """Apply `pass_row`, but skip the pixels whose ray hit is behind `stop`."""
    at = np.uint64(row * ROW)
    behind = np.uint64(row * TILE)
    first, second, third = row_at(ray_hit[HX], ray_hit[HY], ray_hit[HZ], dy)
    gx, gy, center, reach = ray_hit[GX], ray_hit[GY], ray_hit[CENTER], ray_hit[REACH]
    for x in range(TILE):
        j = at + np.uint64(x)
        dx = np.float32(x) - u
        depth = ray_hit_at(dx, gx, gy, first, second, third, center, reach, is_parallel)
        alpha = alpha_at(dx, a, slope, rest)
        alpha = alpha if depth <= stop[behind + np.uint64(x)] else np.float32(0)
        t = state[j]
        left = t - alpha * t
        goes_on = left >= END
        passed = goes_on and left <= state[j + np.uint64(TILE)] and alpha > np.float32(0)
        state[j] = left if goes_on and not passed else -abs(t)
        mark = state[j + np.uint64(2 * TILE)]
        state[j + np.uint64(2 * TILE)] = place if passed else mark


# --- 2. CPU ----------------------------------------------------------------------------


@parallel(writes=("ranks",), gpu="median.median")
def median(
    records, starts, lists, grid, ray_hits, occluder_depth, is_parallel, image, covered, part, ranks
):
    """Find the splat at which part of every pixel's coverage is reached, after `blend` has
    finished.

    Args:
        records, starts, lists, grid, ray_hits, occluder_depth, is_parallel, image: Arguments and
            result of `blend`.
        covered: 1 where a surface is visible behind the splats, shape (y1 - y0, x1 - x0) u8; or
            empty without surfaces.
        part: Fraction of the coverage: 0.5, or 0 for the first splat that contributes.
        ranks: Receives rows of `records`, NONE without a splat, shape (y1 - y0, x1 - x0) i32.
    """
    for tile in prange(starts.shape[0] - 1):
        g = grid[0]
        left = g.left + tile % g.columns * TILE
        top = g.top + tile // g.columns * TILE
        state = np.zeros(TILE * ROW, np.float32)
        for y in range(max(0, g.y0 - top), min(TILE, g.y1 - top)):
            for x in range(max(0, g.x0 - left), min(TILE, g.x1 - left)):
                whole = image[top + y - g.y0, left + x - g.x0, 3]
                if whole > np.float32(0):
                    if covered.shape[0] > 0 and covered[top + y - g.y0, left + x - g.x0] == 1:
                        whole = np.float32(1)
                    state[y * ROW + x] = np.float32(1)
                    state[y * ROW + TILE + x] = np.float32(1) - whole * part
        live = np.zeros(TILE, np.uint8)
        batch = np.ones(FIELDS * LOOK, np.float32)
        rows = np.empty(2 * LOOK, np.float32)
        counter = np.empty(1, np.int32)
        least, most = np.float32(np.inf), np.float32(np.inf)
        stop = np.empty(TILE * TILE, np.float32)
        if occluder_depth.shape[0] > 0:
            least, most = load_occluder_depth(occluder_depth, top, left, g, stop)
        begin, end = starts[tile], starts[tile + 1]
        for first in range(begin, end, LOOK):
            if look(state, ROW, live) == 0:
                break
            count = min(LOOK, end - first)
            load_batch(records, lists, first, count, np.float32(left), np.float32(top), batch, rows)
            for i in range(count):
                u, v = batch[i], batch[LOOK + i]
                a, b, c = batch[2 * LOOK + i], batch[3 * LOOK + i], batch[4 * LOOK + i]
                log_opacity = batch[5 * LOOK + i]
                counter[0] = first - begin + i + 1
                place = counter.view(np.float32)[0]
                if least < np.float32(np.inf):
                    ray_hit = ray_hits[lists[first + i]]
                    if ray_hit[CENTER] - ray_hit[REACH] > most:
                        continue
                    if ray_hit[CENTER] + ray_hit[REACH] > least:
                        for y in range(np.int64(rows[i]), np.int64(rows[LOOK + i])):
                            if live[y]:
                                dy = np.float32(y) - v
                                pass_row_before(
                                    state, stop, y, u, a, b * dy, c * dy * dy + log_opacity,
                                    place, ray_hit, dy, is_parallel,
                                )  # fmt: skip
                        continue
                for y in range(np.int64(rows[i]), np.int64(rows[LOOK + i])):
                    if live[y]:
                        dy = np.float32(y) - v
                        pass_row(state, y, u, a, b * dy, c * dy * dy + log_opacity, place)
        places = state.view(np.int32)
        for y in range(max(0, g.y0 - top), min(TILE, g.y1 - top)):
            for x in range(max(0, g.x0 - left), min(TILE, g.x1 - left)):
                mark = places[y * ROW + 2 * TILE + x]
                rank = lists[begin + mark - 1] if mark > 0 else NONE
                ranks[top + y - g.y0, left + x - g.x0] = rank


@kernel(over="ranks", writes=("depth", "ids"), axes=2)
def resolve(y, x, ranks, records, order, sources, first_slots, labels, depth, ids):
    """Write depth of the centre and ids of the median splats.

    Args:
        ranks: Result of `median`, shape (h, w) i32.
        records: Depth-ordered splats; order: their slots; sources: each slot's row in its field.
        first_slots: First slot of each drawn instance, ascending, shape (m,) i64.
        labels: (prim, instance) of each drawn instance, shape (m, 2) i32.
        depth: Receives planar depth [scene unit], +inf where nothing is, shape (h, w) f32.
        ids: Receives (prim, instance, element, row of the appearance in `first_slots`), -1 where
            nothing is, shape (4, h, w) i32.
    """
    rank = ranks[y, x]
    if rank < 0:
        depth[y, x] = np.float32(np.inf)
        for k in range(4):
            ids[k, y, x] = NONE
    else:
        depth[y, x] = records[rank, DEPTH]
        slot = order[rank]
        drawn = np.searchsorted(first_slots, slot, side="right") - 1
        ids[0, y, x], ids[1, y, x] = labels[drawn, 0], labels[drawn, 1]
        ids[2, y, x] = sources[slot]
        ids[3, y, x] = drawn


@kernel(over="rows", writes=("elements",), axes=2)
def number_elements(y, x, rows, first, elements):
    """Add the element id of the first splat of its appearance to each element id.

    Args:
        rows: Row of the appearance in `first`, -1 where no splat is, shape (h, w) i32.
        first: Element ids, shape (m,) i32.
        elements: Changed in place, shape (h, w) i32.
    """
    if rows[y, x] >= 0:
        elements[y, x] += first[rows[y, x]]


@kernel(over="ranks", writes=("depth",), axes=2)
def hold_depth(y, x, ranks, depths, most, depth):
    """Replace the depths of splats by `depths`, and limit them to `most`, if these are given.

    Args:
        ranks: Result of `median`, shape (h, w) i32.
        depths: New depths, (h, w) f32, or empty.
        most: Upper limits of depths, (h, w) f32, or empty.
        depth: Changed in place, (h, w) f32.
    """
    if ranks[y, x] >= 0:
        if depths.shape[0] > 0:
            depth[y, x] = depths[y, x]
        if most.shape[0] > 0:
            depth[y, x] = min(depth[y, x], most[y, x])
