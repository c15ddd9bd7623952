"""Carriers: points with a minimum distance between them, and interpolation of a pattern from them.

Source: Lagae & Dutre 2008 on Poisson disks by dart throwing.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from usdsplat.kernels.jit import parallel, scalar
from usdsplat.kernels.launch import kernel
from usdsplat.kernels.sim.grid import squared_distance
from usdsplat.kernels.sim.laplacian import falloff
from usdsplat.kernels.sim.philox import CARRIERS, uniforms

ZERO, ONE = np.float32(0), np.float32(1)
TURN = np.float32(2 * math.pi)
AROUND = np.array(
    sorted(
        ((x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)),
        key=lambda step: sum(map(abs, step)),
    )
)
"""A cell and its neighbours, the nearest first: most points that are too close are in the first."""
BLOCK = 1 << 9
"""Number of rows that a thread takes at once."""
BATCH = 1 << 12
"""Number of points in the first batch of `throw`; each later one is twice as large."""


# --- 1. mathematics: one point ----------------------------------------------------------


@scalar
def bucket(x, y, z, mask):
    """Return the hash table entry of cell (x, y, z); several cells may share one. Those of a block
    of 4 x 4 x 4 cells are beside each other in memory."""
    mixed = ((x >> 2) * 73856093) ^ ((y >> 2) * 19349663) ^ ((z >> 2) * 83492791)
    mixed = (mixed ^ (mixed >> 15)) << 6
    return (mixed + ((x & 3) << 4) + ((y & 3) << 2) + (z & 3)) & mask


@scalar
def is_free(i, positions, size, nearest, head, following):
    """Return whether no kept point is closer to point `i` than the root of `nearest`."""
    px, py, pz = positions[i, 0], positions[i, 1], positions[i, 2]
    cx, cy, cz = math.floor(px * size), math.floor(py * size), math.floor(pz * size)
    for step in range(27):
        x, y, z = cx + AROUND[step, 0], cy + AROUND[step, 1], cz + AROUND[step, 2]
        j = head[bucket(x, y, z, len(head) - 1)]
        while j >= 0:
            if squared_distance(
                px, py, pz, positions[j, 0], positions[j, 1], positions[j, 2]
            ) < nearest:  # fmt: skip
                return False
            j = following[j]
    return True


# --- 2. loops ---------------------------------------------------------------------------


@kernel(over="ids", writes=("out", "priority"))
def scatter(i, centres, long, short, ids, first, seed, out, priority):
    """Draw points evenly over ellipses, the first point of each at its centre.

    centres, long, short: float32 (n, 3), centres and half axes of the ellipses. ids: int64 (n,).
    first: int64 (n + 1,), first row of `out` of each ellipse; each has at least one row.
    out: float32 (first[n], 3), receives points. priority: float32 (first[n],), receives random
    numbers, in [0, 1) for centres and in [1, 2) for other points.
    """
    for e in range(first[i], first[i + 1]):
        a, b, c, _ = uniforms(seed, CARRIERS, ids[i], 0, e - first[i])
        away = ZERO if e == first[i] else np.float32(math.sqrt(a))
        along = away * np.float32(math.cos(TURN * b))
        across = away * np.float32(math.sin(TURN * b))
        for axis in range(3):
            out[e, axis] = centres[i, axis] + along * long[i, axis] + across * short[i, axis]
        priority[e] = c if e == first[i] else ONE + c


@parallel(writes=("head", "following", "kept"))
def throw(positions, priority, order, distance, head, following, kept):
    """Keep, in the given order, each point that is at least `distance` from all points kept before.

    Of a batch of points, all threads first drop those that are too close to points of earlier
    batches, row by row, since neighbours in space often are neighbours in memory. One thread looks
    at the few that are left, in order.

    positions: float32 (n, 3). priority: float32 (n,). order: int64 (n,), the rows by ascending
    priority.
    head: int32 (2^b,), b at least 6, initially -1, and following: int32 (n,): scratch, linked lists
    of the kept points of each cell.
    kept: bool (n,), initially False, receives the result.
    """
    size = 1.0 / np.float64(distance)
    nearest = np.float32(distance * distance)
    free = np.ones(len(order), np.bool_)
    first, batch, above = 0, BATCH, np.float32(-1)
    while first < len(order):
        last = min(first + batch, len(order))
        below = priority[order[last - 1]]
        for block in prange((len(order) + BLOCK - 1) // BLOCK):
            for i in range(block * BLOCK, min((block + 1) * BLOCK, len(order))):
                if above < priority[i] <= below:
                    free[i] = is_free(i, positions, size, nearest, head, following)
        for e in range(first, last):
            i = order[e]
            if free[i] and is_free(i, positions, size, nearest, head, following):
                kept[i] = True
                x = math.floor(positions[i, 0] * size)
                y = math.floor(positions[i, 1] * size)
                z = math.floor(positions[i, 2] * size)
                own = bucket(x, y, z, len(head) - 1)
                following[i] = head[own]
                head[own] = i
        first, batch, above = last, 2 * batch, below


@kernel(over="near", writes=("weights",))
def bind(i, points, positions, near, reach, widen, weights):
    """Compute the interpolation weights of the nearest `positions` for each of `points`. Weights
    are values of the kernel K; rows sum to 1.

    points: float32 (n, 3). positions: float32 (c, 3). near: int32 (n, m), rows of `positions`, by
    ascending distance, -1 after the last.
    reach: distance of the nearest position from which all weights are zero. widen: radius of K as a
    multiple of the distance of the last position. weights: float32 (n, m), receives weights.
    """
    m = near.shape[1]
    first, last = np.float32(np.inf), ZERO
    for e in range(m):
        weights[i, e] = ZERO
        j = near[i, e]
        if j >= 0:
            square = squared_distance(
                points[i, 0], points[i, 1], points[i, 2],
                positions[j, 0], positions[j, 1], positions[j, 2],
            )  # fmt: skip
            weights[i, e] = square
            first, last = min(first, square), max(last, square)
    counted = first <= reach * reach
    scale = ONE / (last * widen * widen) if last > ZERO else ZERO
    total = ZERO
    for e in range(m):
        weight = ZERO
        if counted and near[i, e] >= 0:
            weight = falloff(weights[i, e] * scale)
        weights[i, e] = weight
        total += weight
    for e in range(m):
        weights[i, e] = weights[i, e] / total if counted else ZERO


@kernel(over="near", writes=("out",))
def read(i, near, weights, uv, out):
    """Interpolate u and v at points; (1, 0) if all weights are zero.

    near: int32 (n, m). weights: float32 (n, m). uv: float32 (c, 2). out: float32 (n, 2), receives u
    and v.
    """
    m = near.shape[1]
    u, v = ONE, ZERO
    for e in range(m):
        if weights[i, e] > ZERO:
            u += weights[i, e] * (uv[near[i, e], 0] - ONE)
            v += weights[i, e] * uv[near[i, e], 1]
    out[i, 0], out[i, 1] = u, v
