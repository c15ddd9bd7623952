"""Laplacian on a graph of points: weights from distances, normalized by second moments.

    (L f)_i = sum_j w_ij (f_j - f_i),   w_ij = 2 d K_ij / sum_j K_ij r_ij^2,   K = (1 - q^2)^3

with q = r / h_i. For evenly distributed points, L x^2 = 2 along every axis for any spacing. Weights
are not negative, so that diffusion makes no new extremes.

If the diffusion has a direction t, r^2 is r' A r with A = 1 + (1/c - 1)(1 - t t'). The
neighbourhood is then an ellipse, narrower by sqrt(c) across t, and L is D_ab d_a d_b with D = 1
along t and c across. The result is scaled so that det D = 1.

Sources: Brookshaw 1985; Cleary & Monaghan 1999; Coifman & Lafon 2006 for the graph.
"""

from __future__ import annotations

import numpy as np

from usdsplat.kernels.jit import scalar, serial
from usdsplat.kernels.launch import kernel

ZERO, ONE = np.float32(0), np.float32(1)


# --- 1. mathematics: one pair -----------------------------------------------------------


@scalar
def falloff(square):
    """Return K for a squared relative distance."""
    rest = max(ONE - square, ZERO)
    return rest * rest * rest


@scalar
def stretched(x, y, z, tx, ty, tz, excess):
    """Return r' A r for a vector r = (x, y, z); (tx, ty, tz) is a unit vector, excess is 1/c -
    1."""
    square = x * x + y * y + z * z
    along = x * tx + y * ty + z * tz
    return square + excess * max(square - along * along, ZERO)


# --- 2. loops ---------------------------------------------------------------------------


@kernel(over="h", writes=("w", "sums"))
def laplacian(i, positions, row, nbr, h, directions, across, dimension, w, sums):
    """Compute the weights of each point's neighbours.

    positions: float32 (n, 3). row: int64 (n + 1,). nbr: int32 (m,). h: float32 (n,).
    directions: float32 (n, 3), unit vectors, or zero for a point without direction; (0, 3) if no
    point has one. across: c, 0 to 1, relative diffusion across the direction. dimension: float32
    (n,), 2 or 3.
    w: float32 (m,), receives weights [1/unit^2]. sums: float32 (n, 2), receives the sum of a
    point's weights, and the sum of K over its neighbours, both as if there were no directions.
    """
    x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
    tx = ty = tz = excess = ZERO
    d = dimension[i]
    faster = np.float64(1)
    if len(directions) > 0:
        tx, ty, tz = directions[i, 0], directions[i, 1], directions[i, 2]
        if tx * tx + ty * ty + tz * tz > ZERO:
            excess = np.float32(1.0 / across - 1.0)
            faster = across ** (1.0 / np.float64(d) - 1.0)
    scale = ONE / (h[i] * h[i])
    moment, near = np.float64(0), np.float64(0)
    for e in range(row[i], row[i + 1]):
        j = nbr[e]
        dx, dy, dz = positions[j, 0] - x, positions[j, 1] - y, positions[j, 2] - z
        square = stretched(dx, dy, dz, tx, ty, tz, excess)
        k = falloff(square * scale)
        w[e] = k
        moment += k * square
        near += falloff((dx * dx + dy * dy + dz * dz) * scale)
    factor = 2.0 * d * faster / moment if moment > 0.0 else 0.0
    total = np.float64(0)
    for e in range(row[i], row[i + 1]):
        w[e] = np.float32(w[e] * factor)
        total += w[e]
    sums[i, 0] = np.float32(total)
    sums[i, 1] = np.float32(near)


@serial(writes=("extra",))
def missing(row, nbr, extra):
    """Count, for each i, the points that have i as a neighbour but are not neighbours of i. Rows
    ascend.

    extra: int64 (n,), initially zero, receives counts.
    """
    for i in range(len(row) - 1):
        for e in range(row[i], row[i + 1]):
            if find(row, nbr, nbr[e], i) < 0:
                extra[nbr[e]] += 1


@serial(writes=("both_nbr", "both_w"))
def merge(row, nbr, w, both_row, both_nbr, both_w):
    """Make the graph symmetric: neighbours of either side, with the mean of both sides' weights.

    row, nbr, w: the graph, rows ascending. both_row: int64 (n + 1,), rows of the merged graph.
    both_nbr: int32 (m',), both_w: float32 (m',): receive the merged graph, rows ascending.
    """
    half = np.float32(0.5)
    filled = both_row[:-1].copy()
    for i in range(len(row) - 1):  # in order of the sources, so that rows ascend
        for e in range(row[i], row[i + 1]):
            j = nbr[e]
            back = find(row, nbr, j, i)
            if back < 0:
                slot = filled[j]
                filled[j] += 1
                both_nbr[slot] = i
                both_w[slot] = half * w[e]
    for i in range(len(row) - 1):
        last, e = filled[i], row[i + 1]
        slot = both_row[i + 1]
        while e > row[i] or last > both_row[i]:  # backwards, so that no unread entry is overwritten
            slot -= 1
            if e == row[i] or (last > both_row[i] and both_nbr[last - 1] > nbr[e - 1]):
                last -= 1
                both_nbr[slot], both_w[slot] = both_nbr[last], both_w[last]
            else:
                e -= 1
                back = find(row, nbr, nbr[e], i)
                other = w[back] if back >= 0 else ZERO
                both_nbr[slot], both_w[slot] = nbr[e], half * (w[e] + other)


@scalar
def find(row, nbr, i, j):
    """Return the index of j among the neighbours of i, or -1."""
    low, high = row[i], row[i + 1]
    while low < high:
        middle = (low + high) >> 1
        if nbr[middle] < j:
            low = middle + 1
        else:
            high = middle
    return low if low < row[i + 1] and nbr[low] == j else np.int64(-1)


@kernel(over="sums", writes=("sums",))
def row_sums(i, row, w, sums):
    """Compute the sum of each row's weights. sums: float32 (n,), receives sums."""
    total = np.float64(0)
    for e in range(row[i], row[i + 1]):
        total += w[e]
    sums[i] = np.float32(total)
