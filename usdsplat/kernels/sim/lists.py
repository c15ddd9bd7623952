"""Neighbour lists: for each point the points within its own radius, or within either's radius.

Points are sorted by cell. A slot is a point's index in this order, and lists contain slots,
ascending. A list that is too long keeps the nearest points by (squared distance, slot).

Source: Verlet 1967 for lists that stay valid for several steps.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from usdsplat.kernels.jit import exact, parallel, scalar, serial
from usdsplat.kernels.launch import kernel, reduction

from . import philox
from .grid import BLOCK, cell_of, key_of, span, squared_distance

ROOM = 2048
"""Largest number of hits kept before distant ones are dropped; more than twice the longest list."""
NONE, FULL = np.uint64(0), np.uint64(ROOM)
"""Numbers of hits; unsigned, as signed indices cost a test for negative values."""
MARGIN = 1.0 + 1e-6
"""Factor on the search radius in cells, for the rounding of distances."""
JITTER = np.float32(1e-4)
"""Distance by which coincident points are separated, relative to the radius."""
ULP = np.float32(4 * 2.0**-23)
"""Smallest such distance, relative to coordinates: four units in the last place."""

# --- 1. mathematics ---------------------------------------------------------------------


@scalar
def rank_of(d2, slot):
    """Return an integer (u64) that sorts by (d2, slot). d2 >= 0 as its bits (u32)."""
    return (np.uint64(d2) << np.uint64(32)) | np.uint64(slot)


@exact
def distance_gone(x, y, z, px, py, pz):
    """Return the distance of two points in float64: 0 if both are not finite, inf if only one
    is."""
    dx = np.float64(x) - np.float64(px)
    dy = np.float64(y) - np.float64(py)
    dz = np.float64(z) - np.float64(pz)
    d = math.sqrt(dx * dx + dy * dy + dz * dz)
    if math.isfinite(d):
        return d
    both = not (math.isfinite(x + y + z) or math.isfinite(px + py + pz))
    return 0.0 if both else np.inf


# --- 2. CPU -----------------------------------------------------------------------------


@serial
def smallest(values, count, k):
    """Return the k-th smallest (from 1) of the first `count` distinct values. They are reordered.

    Source: Hoare 1961, "Algorithm 65: find".
    """
    left, right, target = 0, count - 1, k - 1
    while left < right:
        pivot = values[(left + right) // 2]
        i, j = left, right
        while i <= j:
            while values[i] < pivot:
                i += 1
            while pivot < values[j]:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if target <= j:
            right = j
        elif target >= i:
            left = i
        else:
            break
    return values[target]


@serial
def keep_nearest(positions, slot, hits, count, k, ranks, distance):
    """Keep the k nearest of `count` hits, in their order.

    Args:
        positions: Position of each slot, (n, 3) f32.
        slot: The slot with these hits.
        hits: Slots, ascending, (>= count,) i32.
        ranks: Scratch, (>= 2 * count,) u64.
        distance: Scratch, (1,) f32.
    """
    bits = distance.view(np.uint32)
    for m in range(count):
        j = hits[m]
        distance[0] = squared_distance(
            positions[slot, 0], positions[slot, 1], positions[slot, 2],
            positions[j, 0], positions[j, 1], positions[j, 2],
        )  # fmt: skip
        ranks[m] = rank_of(bits[0], j)
        ranks[count + m] = ranks[m]
    limit = smallest(ranks, count, k)
    kept = 0
    for m in range(count):
        hits[kept] = hits[m]
        kept += ranks[count + m] <= limit


@parallel(writes=("found", "counts", "dropped"), gpu="sim.lists.search")
def search(positions, reach, widest, start, inverse, bits, k_max, begin, found, counts, dropped):
    """Find the neighbours of the slots from `begin` on, for as many blocks as `dropped` has
    entries.

    Args:
        positions: Position of each slot, (n, 3) f32.
        reach: Radius of each slot, (n,) f32; without neighbours if it is not a finite positive
            number.
        widest: 0 to find points within the point's own radius; the largest radius to find points
            within either's radius.
        start: First slot of each cell, from `sort_cells`.
        inverse, bits: Parameters of the grid.
        k_max: Longest list, <= 512.
        begin: First slot, a multiple of BLOCK.
        found: Receives neighbours, those of a block consecutively, from `k_max` times the index of
            its first row on: (blocks * BLOCK * k_max,) i32.
        counts: Receives lengths, (n,) i64.
        dropped: Receives the number of lists that were too long, (blocks,) i64.
    """
    n = positions.shape[0]
    bx, by, bz = bits
    for b in prange(dropped.shape[0]):
        hits = np.empty(ROOM, np.int32)
        ranks = np.empty(2 * ROOM, np.uint64)
        distance = np.empty(1, np.float32)
        out = b * BLOCK * k_max
        overflows = 0
        for i in range(begin + b * BLOCK, min(n, begin + (b + 1) * BLOCK)):
            x, y, z, h = positions[i, 0], positions[i, 1], positions[i, 2], reach[i]
            counts[i] = 0
            if not (math.isfinite(x + y + z) and math.isfinite(h) and h > 0):
                continue
            h2 = h * h
            far = np.float64(max(h, widest)) * MARGIN
            xa, xb, xc, xd = span(cell_of(x - far, inverse), cell_of(x + far, inverse), bx)
            ya, yb, yc, yd = span(cell_of(y - far, inverse), cell_of(y + far, inverse), by)
            za, zb, zc, zd = span(cell_of(z - far, inverse), cell_of(z + far, inverse), bz)
            m = NONE
            cut = False
            for p in range((zb - za) + (zd - zc)):
                wz = za + p if za + p < zb else zc + p - (zb - za)
                for q in range((yb - ya) + (yd - yc)):
                    wy = ya + q if ya + q < yb else yc + q - (yb - ya)
                    row = ((wz << by) | wy) << bx
                    for part in range(1 if xc == xd else 2):
                        j = np.uint64(start[np.uint64(row + (xa if part == 0 else xc))])
                        end = np.uint64(start[np.uint64(row + (xb if part == 0 else xd))])
                        while j < end:
                            stop = min(end, j + (FULL - m))
                            if widest > 0:
                                for c in range(j, stop):
                                    d2 = squared_distance(
                                        x, y, z, positions[c, 0], positions[c, 1], positions[c, 2]
                                    )
                                    limit = max(h2, reach[c] * reach[c])
                                    hits[m] = c
                                    m += np.uint64((d2 > 0) & (d2 < limit))
                            else:
                                for c in range(j, stop):
                                    d2 = squared_distance(
                                        x, y, z, positions[c, 0], positions[c, 1], positions[c, 2]
                                    )
                                    hits[m] = c
                                    m += np.uint64((d2 > 0) & (d2 < h2))
                            j = stop
                            if m == FULL:
                                keep_nearest(positions, i, hits, m, k_max, ranks, distance)
                                m = np.uint64(k_max)
                                cut = True
            if m > np.uint64(k_max):
                keep_nearest(positions, i, hits, m, k_max, ranks, distance)
                m = np.uint64(k_max)
                cut = True
            overflows += cut
            counts[i] = m
            for c in range(np.int64(m)):
                found[out + c] = hits[c]
            out += np.int64(m)
        dropped[b] = overflows


@parallel(writes=("neighbors",), gpu="sim.lists.pack")
def pack(found, k_max, blocks, rows, neighbors):
    """Close the gaps between blocks in the results of `search`.

    Args:
        found, k_max: See `search`. blocks: Number of blocks in `found`.
        rows: First entry of each of the m slots that were searched, (m + 1,) i64.
        neighbors: Receives all neighbours, (rows[m],) i32.
    """
    m = rows.shape[0] - 1
    for b in prange(blocks):
        source = b * BLOCK * k_max - rows[b * BLOCK]
        for e in range(rows[b * BLOCK], rows[min(m, (b + 1) * BLOCK)]):
            neighbors[e] = found[source + e]


@kernel(over="positions", writes=("out",))
def coincident(i, positions, radii, start, inverse, bits, out):
    """Find out whether another point is at the same position.

    Args:
        positions: Position of each slot, (n, 3) f32.
        radii: Radius of each slot, (n,) f32; of points without a positive one, none is found.
        start: First slot of each cell, from `sort_cells`.
        inverse, bits: Parameters of the grid.
        out: Receives it for each slot, (n,) bool.
    """
    x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
    out[i] = False
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z) and radii[i] > 0):
        return
    bx, by, bz = bits
    key = key_of(cell_of(x, inverse), cell_of(y, inverse), cell_of(z, inverse), bx, by, bz)
    for c in range(start[key], start[key + 1]):
        if positions[c, 0] == x and positions[c, 1] == y and positions[c, 2] == z and c != i:
            out[i] = True
            return


@kernel(over="positions", writes=("out",))
def separate(i, positions, support, seed, twins, out):
    """Copy points, and move those that coincide with others a little at random.

    Args:
        positions, support: Values of each row.
        seed: Seed of the random numbers.
        twins: Rows to move, (n,) bool.
        out: Receives positions, (n, 3) f32.
    """
    x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
    if twins[i]:
        u, v, w, _ = philox.uniforms(seed, philox.GRID, i, 0, 0)
        largest = max(max(abs(x), abs(y)), abs(z))
        size = np.float32(2) * max(JITTER * support[i], ULP * largest)
        half = np.float32(0.5)
        x, y, z = x + size * (u - half), y + size * (v - half), z + size * (w - half)
    out[i, 0], out[i, 1], out[i, 2] = x, y, z


@reduction(over="positions", by="max")
def drift(i, positions, built):
    """Return the largest distance [unit] that a point moved since lists were built.

    It is inf if a point became finite or not finite.

    Args:
        positions, built: Positions of each row now and then, (n, 3) f32.
    """
    return distance_gone(
        positions[i, 0], positions[i, 1], positions[i, 2], built[i, 0], built[i, 1], built[i, 2]
    )


@reduction(over="positions", by="any")
def stale(i, positions, support, built, built_support, skin, ratio, drift):
    """Return whether lists built for other positions may miss a neighbour now, or are much too
    long.

    Args:
        positions, support: Values of each row now.
        built, built_support: Values of each row when lists were built.
        skin: Fraction of the radius by which the search radius was increased.
        ratio: Ratio of radii, now to then, from which lists are rebuilt, > 1.
        drift: Largest distance that any point moved [unit], float64.
    """
    h, before = np.float64(support[i]), np.float64(built_support[i])
    d = distance_gone(
        positions[i, 0], positions[i, 1], positions[i, 2], built[i, 0], built[i, 1], built[i, 2]
    )
    is_short = h + d + drift > before * (1.0 + skin)
    return is_short | (h > before * ratio) | (before > h * ratio)
