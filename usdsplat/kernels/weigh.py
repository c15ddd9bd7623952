"""Weigh the prims that contribute to each pixel, in the order of centres, for Cryptomatte.

`walk` does this for any order and any holdout. Here, as in `blend`, 16 pixels are processed at a
time, and each row of a tile has one row of weights for each prim in the tile's list.

Source: Friedman & Jones 2015, "Fully automatic ID mattes with support for motion blur and
transparency".
"""

from __future__ import annotations

import numpy as np
from numba import prange

from .batch import FIELDS, LOOK, behind_surfaces, lay_row, load_batch, load_occluder_depth
from .bins import TILE
from .blend import END, alphas_at, is_alive, ray_hits_at
from .jit import parallel, scalar
from .lanes import choose, load, lowest_bit, ramp, size, store
from .ray_hit import CENTER, GX, GY, HX, HY, HZ, REACH, row_at

RANKS = 6
"""Minimum number of prims kept for a pixel."""
NONE = np.int32(-1)


# --- 1. mathematics: one pixel ----------------------------------------------------------


@scalar
def strongest(table, first, count, names, ids, weights, row, column):
    """Write the prims with the largest weights in one pixel, in descending order, and clear their
    weights.

    Args:
        table: Weights; those of the pixel are at `first`, `first` + TILE, and so on.
        count: Number of prims.
        names: Number of each prim.
        ids, weights: Receive the prims of the pixel in `row` and `column`.
    """
    for rank in range(ids.shape[2]):
        best, most = NONE, np.float32(0)
        for j in range(count):
            here = table[first + j * TILE]
            if here > most:
                best, most = np.int32(j), here
        ids[row, column, rank] = names[best] if best >= 0 else NONE
        weights[row, column, rank] = most
        if best >= 0:
            table[first + best * TILE] = np.float32(0)


# --- 2. CPU ----------------------------------------------------------------------------


@scalar
def number_prims(labels, lists, begin, n, known, local, names):
    """Number the prims of a tile in the order of its list. Return how many there are.

    Args:
        labels: Number of each splat's prim.
        lists: The tile's list is its `n` entries from `begin` on.
        known: Initially NONE, one entry for each prim of the scene.
        local: Receives the number of each entry's prim within the tile.
        names: Receives the prim of each of these numbers.
    """
    prims = 0
    for k in range(n):
        label = labels[lists[begin + k]]
        if known[label] < 0:
            known[label], names[prims] = prims, label
            prims += 1
        local[k] = known[label]
    return prims


@parallel(writes=("ids", "weights"), gpu="weigh.weigh")
def weigh(
    records, labels, prims, starts, lists, grid, ray_hits, occluder_depth, is_parallel, ids, weights
):  # fmt: skip
    """Find the prims that contribute most to each pixel of a band.

    Args:
        records, starts, lists, grid, ray_hits, occluder_depth, is_parallel: See `blend.blend`.
        labels: Number of each splat's prim, shape (n,) i32.
        prims: Number of prims.
        ids, weights: Receive the prims with the largest weights, and these weights, shape (h, w,
            ranks) i32 and f32; NONE and 0 if there are fewer.
    """
    for tile in prange(starts.shape[0] - 1):
        g = grid[0]
        left = g.left + tile % g.columns * TILE
        top = g.top + tile // g.columns * TILE
        xs, one = ramp(), np.uint64(1)
        x0, x1 = max(0, g.x0 - left), min(TILE, g.x1 - left)
        y0, y1 = max(0, g.y0 - top), min(TILE, g.y1 - top)
        begin, end = starts[tile], starts[tile + 1]
        local = np.empty(end - begin, np.int32)
        names = np.empty(end - begin, np.int32)
        known = np.full(prims, NONE, np.int32)
        count = number_prims(labels, lists, begin, end - begin, known, local, names)
        table = np.zeros(TILE * TILE * count, np.float32)
        through = np.empty(TILE * TILE, np.float32)
        inside = (xs >= np.float32(x0)) & (xs < np.float32(x1))
        live = np.zeros(TILE, np.uint8)
        for y in range(y0, y1):
            store(through, np.uint64(y * TILE), choose(inside, np.float32(1), np.float32(0)))
            live[y] = 1
        alive = y1 - y0
        least, most = np.float32(np.inf), np.float32(np.inf)
        stop = np.empty(TILE * TILE, np.float32)
        if occluder_depth.shape[0] > 0:
            least, most = load_occluder_depth(occluder_depth, top, left, g, stop)
        batch = np.ones(FIELDS * LOOK, np.float32)
        rows = np.empty(2 * LOOK, np.float32)
        slopes = np.empty(2 * LOOK, np.float32)
        for first in range(begin, end, LOOK):
            if alive == 0:
                break
            size_of = min(LOOK, end - first)
            load_batch(
                records, lists, first, size_of, np.float32(left), np.float32(top), batch, rows
            )  # fmt: skip
            there = ~np.uint64(0) >> np.uint64(64 - size_of)
            mixed = np.uint64(0)
            if least < np.float32(np.inf):
                hidden, mixed = behind_surfaces(ray_hits, lists, first, size_of, least, most)
                there &= ~hidden
            for y in range(y0, y1):
                if live[y] == 0:
                    continue
                touched = lay_row(batch, rows, np.float32(y), slopes) & there
                t = load(through, np.uint64(y * TILE))
                while touched != np.uint64(0):
                    i = lowest_bit(touched)
                    touched &= touched - one
                    dx = xs - batch[i]
                    alpha = alphas_at(
                        dx, batch[i + np.uint64(2 * LOOK)], slopes[i], slopes[i + np.uint64(LOOK)]
                    )
                    if (mixed >> i) & one:
                        k = np.uint64(lists[first + np.int64(i)])
                        dy = np.float32(y) - batch[i + np.uint64(LOOK)]
                        d0, d1, d2 = row_at(
                            ray_hits[k, HX], ray_hits[k, HY], ray_hits[k, HZ], dy
                        )  # fmt: skip
                        depth = ray_hits_at(
                            dx, ray_hits[k, GX], ray_hits[k, GY], d0, d1, d2, ray_hits[k, CENTER],
                            ray_hits[k, REACH], is_parallel,
                        )  # fmt: skip
                        behind = load(stop, np.uint64(y * TILE))
                        alpha = choose(depth <= behind, alpha, np.float32(0))
                    weight = alpha * t
                    remains = t - weight
                    goes_on = remains >= END
                    t = choose(goes_on, remains, -size(t))
                    at = np.uint64((y * count + local[first - begin + np.int64(i)]) * TILE)
                    total = load(table, at) + choose(goes_on, weight, np.float32(0))
                    store(table, at, total)
                store(through, np.uint64(y * TILE), t)
                goes_on_at_all = is_alive(t)
                live[y] = goes_on_at_all
                alive -= 1 - goes_on_at_all
        for y in range(y0, y1):
            for x in range(x0, x1):
                strongest(
                    table, y * count * TILE + x, count, names, ids, weights, top + y - g.y0,
                    left + x - g.x0,
                )  # fmt: skip
