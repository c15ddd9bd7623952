"""Exact k nearest neighbours of points with any distribution.

Uses a k-d tree without pointers: node 1 contains all points, node j the halves 2j and 2j + 1, split
at the median of its longest side. The leaves of the last level are runs of a few points. Equal
distances are sorted by index.

Source: Friedman, Bentley & Finkel 1977, "An algorithm for finding best matches in logarithmic
expected time".
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from usdsplat.kernels.jit import exact, parallel, serial
from usdsplat.kernels.launch import BlockArray, block_kernel

from .grid import squared_distance

DEPTH = 32
"""Largest number of levels of a tree."""
NONE, ONE = np.uint64(0), np.uint64(1)
"""Unsigned, as signed indices cost a test for negative values."""

# --- 1. mathematics ---------------------------------------------------------------------


@exact
def first_of(node, level, n):
    """Return the first point of a node of a level (0 is the root's).

    The first of node + 1 is the end.
    """
    return (np.int64(node) - (np.int64(1) << level)) * n >> level


@exact
def gap(x, low, high):
    """Return the distance to an interval: in float32 never more than the distance to any number in
    it."""
    return max(max(low - x, x - high), np.float32(0))


@exact
def box_distance(x, y, z, x0, y0, z0, x1, y1, z1):
    """Return the squared distance to a box: never more than `squared_distance` to a point in it."""
    dx, dy, dz = gap(x, x0, x1), gap(y, y0, y1), gap(z, z0, z1)
    return dx * dx + dy * dy + dz * dz


@exact
def goes_before(row, other):
    """Return whether `row` precedes `other`, at equal distances; -1 is no row."""
    return row < other or other < 0


# --- 2. CPU -----------------------------------------------------------------------------


@serial
def divide(points, index, axis, first, end, middle):
    """Partition points first..end - 1 around `middle`: none before it is greater than one after it.

    Source: Hoare 1961, "Algorithm 65: find".
    """
    left, right = np.int64(first), np.int64(end) - 1
    while left < right:
        pivot = points[np.uint64((left + right) // 2), axis]
        i, j = left, right
        while i <= j:
            while points[np.uint64(i), axis] < pivot:
                i += 1
            while pivot < points[np.uint64(j), axis]:
                j -= 1
            if i <= j:
                p, q = np.uint64(i), np.uint64(j)
                x, y, z, row = points[p, 0], points[p, 1], points[p, 2], index[p]
                points[p, 0], points[p, 1], points[p, 2] = points[q, 0], points[q, 1], points[q, 2]
                points[q, 0], points[q, 1], points[q, 2] = x, y, z
                index[p], index[q] = index[q], row
                i += 1
                j -= 1
        if middle <= j:
            right = j
        elif middle >= i:
            left = i
        else:
            break


@parallel(writes=("points", "index", "boxes"))
def plant(points, index, levels, boxes):
    """Build the tree: order the points, and compute the boxes of nodes.

    Args:
        points: Finite, (n, 3) f32, reordered in place.
        index: Reordered like `points`, (n,) i32.
        levels: Levels below the root, 2^levels <= n.
        boxes: Receives the box of each node, lower corner first: (2^(levels + 1), 6) f32.
    """
    n = np.int64(points.shape[0])
    for level in range(levels + 1):
        for node in prange(1 << level, 2 << level):
            first, end = first_of(node, level, n), first_of(node + 1, level, n)
            for a in range(3):
                low, high = points[first, a], points[first, a]
                for i in range(np.uint64(first), np.uint64(end)):
                    low, high = min(low, points[i, a]), max(high, points[i, a])
                boxes[node, a], boxes[node, 3 + a] = low, high
            if level < levels:
                axis = 0
                for a in range(1, 3):
                    if (
                        boxes[node, 3 + a] - boxes[node, a]
                        > boxes[node, 3 + axis] - boxes[node, axis]
                    ):
                        axis = a
                middle = first_of(2 * node + 1, level + 1, n)
                divide(points, index, axis, first, end, middle)


@block_kernel(
    over="order",
    writes=("indices", "distances"),
    scratch=(
        BlockArray(shape=(2, DEPTH), dtype=np.int64),
        BlockArray(shape=DEPTH, dtype=np.float32),
    ),
    exact=True,
)
def nearest(
    begin, until, stack, bounds, points, index, levels, boxes, queries, order, k, indices,
    distances,
):  # fmt: skip
    """Find the nearest points of each query.

    Args:
        stack, bounds: Scratch: node and level of those still to visit, and their distances.
        points, index, levels, boxes: From `plant`.
        queries: (m, 3) f32.
        order: Order in which queries are processed, with near ones together: (m,) i32.
        k: Number of points to find for each query.
        indices: Receives the `index` entries of the nearest points, nearest first, (m * k,) i32; -1
            if there are fewer.
        distances: Receives squared distances, (m * k,) f32; inf if there are fewer.
    """
    n = np.int64(points.shape[0])
    nodes, depths = stack[0], stack[1]
    for row in range(begin, until):
        q = order[row]
        base = np.uint64(q * k)
        last = base + np.uint64(k - 1)
        for c in range(base, last + ONE):
            indices[c] = -1
            distances[c] = np.inf
        x, y, z = queries[q, 0], queries[q, 1], queries[q, 2]
        if n == 0 or not math.isfinite(x + y + z):
            continue
        nodes[0], bounds[0], depths[0] = 1, np.float32(0), 0
        worst = np.float32(np.inf)
        top = NONE
        waiting = True
        while waiting:
            node, level = nodes[top], depths[top]
            if not bounds[top] > worst:
                while level < levels:
                    left = np.uint64(2 * node)
                    right = left + ONE
                    to_left = box_distance(
                        x, y, z, boxes[left, 0], boxes[left, 1], boxes[left, 2],
                        boxes[left, 3], boxes[left, 4], boxes[left, 5],
                    )  # fmt: skip
                    to_right = box_distance(
                        x, y, z, boxes[right, 0], boxes[right, 1], boxes[right, 2],
                        boxes[right, 3], boxes[right, 4], boxes[right, 5],
                    )  # fmt: skip
                    level += 1
                    swap = to_right < to_left
                    node = 2 * node + swap
                    far = max(to_left, to_right)
                    nodes[top], bounds[top], depths[top] = node + 1 - 2 * swap, far, level
                    top += np.uint64(far <= worst)
                first, end = first_of(node, level, n), first_of(node + 1, level, n)
                for i in range(np.uint64(first), np.uint64(end)):
                    d2 = squared_distance(x, y, z, points[i, 0], points[i, 1], points[i, 2])
                    if d2 > worst:
                        continue
                    me = index[i]
                    if d2 == worst and indices[last] >= 0 and me > indices[last]:
                        continue
                    c = last
                    while c > base and (
                        d2 < distances[c - ONE]
                        or (d2 == distances[c - ONE] and goes_before(me, indices[c - ONE]))
                    ):
                        distances[c] = distances[c - ONE]
                        indices[c] = indices[c - ONE]
                        c -= ONE
                    distances[c] = d2
                    indices[c] = me
                    worst = distances[last]
            waiting = top > NONE
            top -= np.uint64(waiting)
