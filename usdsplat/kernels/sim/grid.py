"""Uniform grid without bounds: points sorted by cell.

Cells are counted from the origin and wrapped on each axis, so that every domain has a table of the
same size, in which consecutive cells along x are adjacent. Distant cells may share a table entry;
searches separate their points by distance tests. Points that are not finite are distributed over
all cells and have no neighbours.

Source: Green 2008, "CUDA particles"; Hoetzlein 2014, "Fast fixed-radius nearest neighbors". The
wrapping replaces the hash of Teschner et al. 2003.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from usdsplat.kernels.jit import exact, parallel
from usdsplat.kernels.launch import kernel

BLOCK = 1024
"""Rows of a work item. Results do not depend on the number of threads."""
TOP_BITS = 11
"""Bits of a key that the first level sorts by. Its histogram fits a core's cache."""
FAR = 2.0**30
"""Distance from the origin, in cells, beyond which all points are in one cell."""

# --- 1. mathematics ---------------------------------------------------------------------


@exact
def cell_of(x, inverse):
    """Return the cell (i64) of a finite coordinate x; inverse: 1 / edge [1/unit], float64."""
    return np.int64(math.floor(min(max(np.float64(x) * inverse, -FAR), FAR)))


@exact
def key_of(cx, cy, cz, bx, by, bz):
    """Return the entry of a cell in a table of 2^bx by 2^by by 2^bz, x fastest."""
    one = np.int64(1)
    x, y, z = cx & ((one << bx) - 1), cy & ((one << by) - 1), cz & ((one << bz) - 1)
    return (((z << by) | y) << bx) | x


@exact
def span(first, last, bits):
    """Return the wrapped cells of an axis from `first` to `last`, each once, ascending.

    The result (a, b, c, d) means the cells from a to b - 1, followed by those from c to d - 1.
    """
    size = np.int64(1) << bits
    if last - first + 1 >= size:
        return np.int64(0), size, size, size
    a, b = first & (size - 1), last & (size - 1)
    if a <= b:
        return a, b + 1, size, size
    return np.int64(0), b + 1, a, size


@exact
def squared_distance(x, y, z, px, py, pz):
    """Return the squared distance of two points in float32, with the same bits on every device."""
    dx, dy, dz = px - x, py - y, pz - z
    return dx * dx + dy * dy + dz * dz


# --- 2. CPU -----------------------------------------------------------------------------


@parallel(writes=("lower", "upper"), gpu="sim.grid.bounds")
def bounds(positions, lower, upper):
    """Compute the smallest and largest coordinates of the finite points of each block.

    Args:
        positions: (n, 3) f32.
        lower, upper: Receive (blocks, 3) f64; +inf and -inf for a block without finite points.
    """
    n = positions.shape[0]
    for b in prange(lower.shape[0]):
        for a in range(3):
            lower[b, a], upper[b, a] = np.inf, -np.inf
        for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
            if math.isfinite(positions[i, 0] + positions[i, 1] + positions[i, 2]):
                for a in range(3):
                    lower[b, a] = min(lower[b, a], positions[i, a])
                    upper[b, a] = max(upper[b, a], positions[i, a])


@kernel(over="positions", writes=("out",))
def keys(i, positions, inverse, bits, out):
    """Compute the table entry of each point's cell.

    Args:
        positions: (n, 3) f32.
        inverse: 1 / edge of a cell [1/unit], float64.
        bits: Bits of each axis, x first; three integers, sum <= 24.
        out: Receives table entries, (n,) i32.
    """
    bx, by, bz = bits
    last = (np.int64(1) << (bx + by + bz)) - 1
    x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
    if math.isfinite(x) and math.isfinite(y) and math.isfinite(z):
        key = key_of(cell_of(x, inverse), cell_of(y, inverse), cell_of(z, inverse), bx, by, bz)
        out[i] = key
    else:
        out[i] = i & last


@parallel(writes=("histogram", "moved", "rows", "start", "order"), gpu="sim.grid.sort_cells")
def sort_cells(entry, bits, histogram, moved, rows, start, order):
    """Sort rows by key, stably, by counting in two levels.

    Args:
        entry: Keys below 2^bits, (n,) i32.
        bits: Bits of a key, <= 24.
        histogram: Scratch, (chunks, 2^TOP_BITS) i64; the result does not depend on the number of
            chunks.
        moved, rows: Scratch, (n,) i32 each.
        start: Receives the first slot of each key and, last, n: (2^bits + 1,) i32.
        order: Receives the row of each slot, (n,) i32.
    """
    n = entry.shape[0]
    chunks = histogram.shape[0]
    low = max(bits - TOP_BITS, 0)
    buckets = 1 << (bits - low)
    for t in prange(chunks):
        for d in range(buckets):
            histogram[t, d] = 0
        for i in range(n * t // chunks, n * (t + 1) // chunks):
            histogram[t, entry[i] >> low] += 1
    total = 0
    for d in range(buckets):
        for t in range(chunks):
            here = histogram[t, d]
            histogram[t, d] = total
            total += here
    for t in prange(chunks):
        for i in range(n * t // chunks, n * (t + 1) // chunks):
            d = entry[i] >> low
            to = histogram[t, d]
            histogram[t, d] = to + 1
            moved[to] = entry[i]
            rows[to] = i
    for d in prange(buckets):
        first = np.int64(0) if d == 0 else histogram[chunks - 1, d - 1]
        end = histogram[chunks - 1, d]
        base, top = d << low, (d + 1) << low
        for key in range(base, top):
            start[key] = 0
        for i in range(first, end):
            start[moved[i]] += 1
        total = first
        for key in range(base, top):
            here = start[key]
            start[key] = total
            total += here
        for i in range(first, end):
            to = start[moved[i]]
            start[moved[i]] = to + 1
            order[to] = rows[i]
        for key in range(top - 1, base, -1):
            start[key] = start[key - 1]
        start[base] = first
    start[1 << bits] = n


@kernel(over="order", writes=("rank", "sorted_positions", "sorted_support"))
def to_slots(s, order, positions, support, rank, sorted_positions, sorted_support):
    """Copy the data that searches read, in the order of slots.

    Args:
        order: Row of each slot, (n,) i32.
        positions: (n, 3) f32.
        support: (n,) f32.
        rank: Receives the slot of each row, (n,) i32.
        sorted_positions, sorted_support: Receive the values of each slot.
    """
    i = order[s]
    rank[i] = s
    for a in range(3):
        sorted_positions[s, a] = positions[i, a]
    sorted_support[s] = support[i]
