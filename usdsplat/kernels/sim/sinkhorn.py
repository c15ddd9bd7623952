"""Half iterations of Sinkhorn's algorithm in the log domain, on a sparse kernel of blocks.

Points are ordered so that runs of BLOCK of them are compact. The kernel exp((f + g - c) / epsilon)
is evaluated only between blocks that are listed as neighbours, and the cost c is the squared
distance of features: nothing of the size n x m is stored.

Sources: Cuturi 2013, "Sinkhorn distances"; Schmitzer 2019, "Stabilized sparse scaling algorithms
for entropy regularized transport problems", for scaling, truncation and the log domain.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel

BLOCK = 32
"""Points of a block."""
FEATURES = 6
"""Features of a point, in units of which the cost is 1."""
NEGLIGIBLE = np.float32(-20)
"""Exponent, relative to the largest one, below which a term is left out: exp(-20) = 2e-9."""
ZERO, ONE = np.float32(0), np.float32(1)
_NONE = np.float32(-1e30)


@scalar
def cost(x, y, i, j):
    """Return the squared distance of the features of point i of x and point j of y."""
    total = ZERO
    for k in range(FEATURES):
        d = x[i, k] - y[j, k]
        total += d * d
    return total


@kernel(over="x", writes=("out",), grain=BLOCK)
def soften(i, x, y, potentials, logarithms, epsilon, rows, lists, out):
    """Compute the potential of a point for which its mass is that of the plan.

    f_i = -epsilon log sum_j w_j exp((g_j - c_ij) / epsilon), over the listed blocks.

    Args:
        x: Features of n points, shape (n, 6) f32.
        y: Features of m points, shape (m, 6) f32.
        potentials: g of the points of y, shape (m,) f32.
        logarithms: log w of the points of y, shape (m,) f32.
        epsilon: f32, more than 0.
        rows, lists: Blocks of y listed for block b of x: lists[rows[b]:rows[b + 1]].
        out: Receives f, shape (n,) f32; 0 for a point whose block has an empty list.
    """
    block = i // BLOCK
    top, total = _NONE, ZERO
    inverse = ONE / epsilon
    for e in range(rows[block], rows[block + 1]):
        first = np.int64(lists[e]) * BLOCK
        for j in range(first, min(first + BLOCK, y.shape[0])):
            v = (potentials[j] - cost(x, y, i, j)) * inverse + logarithms[j]
            if v > top:
                total = total * np.float32(math.exp(top - v)) + ONE
                top = v
            elif v > top + NEGLIGIBLE:
                total += np.float32(math.exp(v - top))
    out[i] = -epsilon * (top + np.float32(math.log(total))) if total > ZERO else ZERO


@kernel(over="lists", writes=("out",))
def survey(e, x, y, first, second, epsilon, sources, lists, out):
    """Compute the largest exponent of a pair of blocks: (f + g - c) / epsilon.

    Args:
        x, y: Features, shapes (n, 6) and (m, 6) f32.
        first, second: Potentials f and g, shapes (n,) and (m,) f32.
        epsilon: f32.
        sources, lists: Block of x and of y of each pair, shape (p,) i32.
        out: Receives exponents, shape (p,) f32.
    """
    most = _NONE
    here, there = np.int64(sources[e]) * BLOCK, np.int64(lists[e]) * BLOCK
    for i in range(here, min(here + BLOCK, x.shape[0])):
        for j in range(there, min(there + BLOCK, y.shape[0])):
            most = max(most, first[i] + second[j] - cost(x, y, i, j))
    out[e] = most / epsilon


@kernel(over="x", writes=("images", "best", "costs"), grain=BLOCK)
def average(i, x, y, first, second, logarithms, epsilon, rows, lists, values, images, best, costs):
    """Compute the mean over the plan of values at the points of y, for a point of x.

    Args:
        x, y, epsilon, rows, lists, logarithms: See `soften`.
        first, second: Potentials f and g, shapes (n,) and (m,) f32.
        values: At the points of y, shape (m, 3) f32.
        images: Receives means, shape (n, 3) f32; 0 for a point that has no partner.
        best: Receives the point of y with the largest share, shape (n,) i32; -1 for none.
        costs: Receives the mean cost, shape (n,) f32.
    """
    block = i // BLOCK
    a, b, c, spent, total = ZERO, ZERO, ZERO, ZERO, ZERO
    top, found = _NONE, -1
    for e in range(rows[block], rows[block + 1]):
        start = np.int64(lists[e]) * BLOCK
        for j in range(start, min(start + BLOCK, y.shape[0])):
            price = cost(x, y, i, j)
            v = (first[i] + second[j] - price) / epsilon + logarithms[j]
            if v > top:
                top, found = v, j
            if v > NEGLIGIBLE:
                share = np.float32(math.exp(min(v, ONE)))
                total += share
                spent += share * price
                a += share * values[j, 0]
                b += share * values[j, 1]
                c += share * values[j, 2]
    best[i] = found
    scale = ONE / total if total > ZERO else ZERO
    images[i, 0], images[i, 1], images[i, 2] = scale * a, scale * b, scale * c
    costs[i] = scale * spent
