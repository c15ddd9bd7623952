"""Points that are nowhere closer than a distance, and a pattern read between them.

Sources: Lagae & Dutre 2008 on Poisson disks by dart throwing.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar, serial
from usdsplat.kernels.launch import kernel
from usdsplat.kernels.sim.grid import squared_distance
from usdsplat.kernels.sim.laplacian import falloff
from usdsplat.kernels.sim.philox import CARRIERS, uniforms

ZERO, ONE = np.float32(0), np.float32(1)
TURN = np.float32(2 * math.pi)


# --- 1. mathematics: one point ----------------------------------------------------------


@scalar
def bucket(x, y, z, mask):
    """Which list of a table the cell (x, y, z) is in; several cells may share one."""
    mixed = (x * 73856093) ^ (y * 19349663) ^ (z * 83492791)
    return (mixed ^ (mixed >> 15)) & mask


# --- 2. loops ---------------------------------------------------------------------------


@kernel(over="ids", writes=("out", "priority"))
def scatter(i, centres, long, short, ids, first, seed, out, priority):
    """Points spread evenly over ellipses, the first of each in its centre.

    centres, long, short: float32 (n, 3), of each ellipse and its half axes. ids: int64 (n,).
    first: int64 (n + 1,), rows of `out` that each has, at least one.
    out: float32 (first[n], 3), written. priority: float32 (first[n],), written: random numbers,
    those of centres in [0, 1), those of others in [1, 2).
    """
    for e in range(first[i], first[i + 1]):
        a, b, c, _ = uniforms(seed, CARRIERS, ids[i], 0, e - first[i])
        away = ZERO if e == first[i] else np.float32(math.sqrt(a))
        along = away * np.float32(math.cos(TURN * b))
        across = away * np.float32(math.sin(TURN * b))
        for axis in range(3):
            out[e, axis] = centres[i, axis] + along * long[i, axis] + across * short[i, axis]
        priority[e] = c if e == first[i] else ONE + c


@serial(writes=("head", "following", "kept"))
def throw(positions, order, distance, head, following, kept):
    """Keep each point, in this order, that is at least `distance` from all kept before.

    positions: float32 (n, 3); order: int64 (n,), a permutation or a part of one.
    head: int32 (2^b,), -1, and following: int32 (n,): room for lists of who is kept in which cell.
    kept: bool (n,), False, written.
    """
    mask = len(head) - 1
    size = 1.0 / np.float64(distance)
    nearest = np.float32(distance * distance)
    for i in order:
        px, py, pz = positions[i, 0], positions[i, 1], positions[i, 2]
        cx, cy, cz = math.floor(px * size), math.floor(py * size), math.floor(pz * size)
        free = True
        for x in range(cx - 1, cx + 2):
            for y in range(cy - 1, cy + 2):
                for z in range(cz - 1, cz + 2):
                    j = head[bucket(x, y, z, mask)] if free else -1
                    while j >= 0:
                        if squared_distance(
                            px, py, pz, positions[j, 0], positions[j, 1], positions[j, 2]
                        ) < nearest:  # fmt: skip
                            free = False
                            break
                        j = following[j]
        if free:
            kept[i] = True
            own = bucket(cx, cy, cz, mask)
            following[i] = head[own]
            head[own] = i


@kernel(over="near", writes=("weights",))
def bind(i, points, positions, near, reach, widen, weights):
    """How much each of the nearest of `positions` counts at `points`: K, rows sum to 1.

    points: float32 (n, 3). positions: float32 (c, 3). near: int32 (n, m), rows of `positions`,
    ascending by distance, -1 after the last.
    reach: distance of the first from where none counts. widen: the radius of K, in distances of
    the last. weights: float32 (n, m), written; rows of points beyond reach are zero.
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
    """u and v at points, (1, 0) where no carrier counts.

    near: int32 (n, m); weights: float32 (n, m); uv: float32 (c, 2); out: float32 (n, 2), written.
    """
    m = near.shape[1]
    u, v = ONE, ZERO
    for e in range(m):
        if weights[i, e] > ZERO:
            u += weights[i, e] * (uv[near[i, e], 0] - ONE)
            v += weights[i, e] * uv[near[i, e], 1]
    out[i, 0], out[i, 1] = u, v
