"""The k nearest of n points, however unevenly they are spread.

A k-d tree without pointers: node 1 has all points, node j the halves 2j and 2j + 1, cut at the
median of its longest side; the last level has leaves of a few points that lie one after the other.
Exact; equal distances go by index.

Source: Friedman, Bentley & Finkel 1977, "An algorithm for finding best matches in logarithmic
expected time".
"""

from __future__ import annotations

import numpy as np
from numba import prange

from usdsplat.kernels.jit import exact, parallel, serial

from .grid import BLOCK, squared_distance

DEPTH = 32
"""Levels of a tree, at most."""

# --- 1. mathematics ---------------------------------------------------------------------


@exact
def first_of(node, level, n):
    """First point of a node of a level (0 is the root's); that of node + 1 is where it ends."""
    return (np.int64(node) - (np.int64(1) << level)) * n >> level


@exact
def gap(x, low, high):
    """From x to an interval: never more, in float32, than to any number in it."""
    return max(max(low - x, x - high), np.float32(0))


@exact
def box_distance(x, y, z, x0, y0, z0, x1, y1, z1):
    """Squared distance to a box: never more than `squared_distance` to a point in it."""
    dx, dy, dz = gap(x, x0, x1), gap(y, y0, y1), gap(z, z0, z1)
    return dx * dx + dy * dy + dz * dz


# --- 2. CPU -----------------------------------------------------------------------------


@serial
def divide(points, index, axis, first, end, middle):
    """Order points first..end - 1 so that none before `middle` is beyond one after it.

    Source: Hoare 1961, "Algorithm 65: find".
    """
    left, right = first, end - 1
    while left < right:
        pivot = points[(left + right) // 2, axis]
        i, j = left, right
        while i <= j:
            while points[i, axis] < pivot:
                i += 1
            while pivot < points[j, axis]:
                j -= 1
            if i <= j:
                for a in range(3):
                    points[i, a], points[j, a] = points[j, a], points[i, a]
                index[i], index[j] = index[j], index[i]
                i += 1
                j -= 1
        if middle <= j:
            right = j
        elif middle >= i:
            left = i
        else:
            break


@parallel
def plant(points, index, levels, boxes):
    """Order points as the tree has them.

    Args:
        points: Finite, (n, 3) f32, are reordered.
        index: Likewise, (n,) i32.
        levels: Below the root, 2^levels <= n.
        boxes: Receives the box of each node, lower corner first: (2^(levels + 1), 6) f32.
    """
    n = np.int64(points.shape[0])
    for level in range(levels + 1):
        for node in prange(1 << level, 2 << level):
            first, end = first_of(node, level, n), first_of(node + 1, level, n)
            for a in range(3):
                low, high = points[first, a], points[first, a]
                for i in range(first, end):
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


@parallel
def nearest(points, index, levels, boxes, queries, order, indices, distances):
    """Find the nearest of each query.

    Args:
        points, index, levels, boxes: As `plant` left them.
        queries: (m, 3) f32.
        order: In which queries are taken, near ones together: (m,) i32.
        indices: Receives the entries of `index` of the nearest, nearest first, (m, k) i32; -1 where
            there are no more.
        distances: Receives squared distances, (m, k) f32; inf where there are no more.
    """
    n = np.int64(points.shape[0])
    m, k = indices.shape
    for b in prange((m + BLOCK - 1) // BLOCK):
        nodes = np.empty(DEPTH, np.int64)
        bounds = np.empty(DEPTH, np.float32)
        depths = np.empty(DEPTH, np.int64)
        for row in range(b * BLOCK, min(m, (b + 1) * BLOCK)):
            q = order[row]
            for c in range(k):
                indices[q, c] = -1
                distances[q, c] = np.inf
            x, y, z = queries[q, 0], queries[q, 1], queries[q, 2]
            if n == 0 or not np.isfinite(x + y + z):
                continue
            nodes[0], bounds[0], depths[0] = 1, np.float32(0), 0
            top = 1
            while top > 0:
                top -= 1
                node, level = nodes[top], depths[top]
                if bounds[top] > distances[q, k - 1]:
                    continue
                while level < levels:
                    left, right = 2 * node, 2 * node + 1
                    to_left = box_distance(
                        x, y, z, boxes[left, 0], boxes[left, 1], boxes[left, 2],
                        boxes[left, 3], boxes[left, 4], boxes[left, 5],
                    )  # fmt: skip
                    to_right = box_distance(
                        x, y, z, boxes[right, 0], boxes[right, 1], boxes[right, 2],
                        boxes[right, 3], boxes[right, 4], boxes[right, 5],
                    )  # fmt: skip
                    level += 1
                    node = left if to_left <= to_right else right
                    nodes[top] = right if to_left <= to_right else left
                    bounds[top] = max(to_left, to_right)
                    depths[top] = level
                    top += 1
                for i in range(first_of(node, level, n), first_of(node + 1, level, n)):
                    d2 = squared_distance(x, y, z, points[i, 0], points[i, 1], points[i, 2])
                    if d2 > distances[q, k - 1]:
                        continue
                    me = index[i]
                    last = indices[q, k - 1]
                    if d2 == distances[q, k - 1] and last >= 0 and me > last:
                        continue
                    c = k - 1
                    while c > 0 and (
                        d2 < distances[q, c - 1]
                        or (
                            d2 == distances[q, c - 1]
                            and (me < indices[q, c - 1] or indices[q, c - 1] < 0)
                        )
                    ):
                        distances[q, c] = distances[q, c - 1]
                        indices[q, c] = indices[q, c - 1]
                        c -= 1
                    distances[q, c] = d2
                    indices[q, c] = me
