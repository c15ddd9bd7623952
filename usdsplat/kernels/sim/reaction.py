"""Gray-Scott reaction on a graph of points: one explicit step.

    u' = Du L u - u v^2 + F (1 - u)
    v' = Dv L v + u v^2 - (F + k) v

Sources: Gray & Scott 1984; Pearson 1993; on surfaces Turk 1991.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from usdsplat.kernels.jit import parallel, scalar
from usdsplat.kernels.launch import kernel

BLOCK = 1024
"""Points of a work item."""

ZERO, ONE = np.float32(0), np.float32(1)
I1, I2, I3, I4 = (np.uint64(i) for i in range(1, 5))
"""Unsigned, as signed indices cost a test for negative values at every use."""


# --- 1. mathematics: one point ----------------------------------------------------------


@scalar
def reacted(u, v, flow_u, flow_v, feed, kill, step):
    """Return (u, v) after a step; flow is D L of each, step is a time."""
    made = u * v * v
    return (
        u + step * (flow_u - made + feed * (ONE - u)),
        v + step * (flow_v + made - (feed + kill) * v),
    )


# --- 2. loops ---------------------------------------------------------------------------


@parallel(writes=("out",), gpu="sim.reaction.gray_scott")
def gray_scott(row, nbr, w, uv, feed, kill, du, dv, step, out):
    """Make one step for all points. Sums have a fixed order: four interleaved sums, then the rest.

    row: int64 (n + 1,). nbr: int32 (m,). w: float32 (m,), weights of the Laplacian.
    uv, out: float32 (2 n,), u and v of each point, interleaved; two different arrays. `out`
    receives the result.
    feed, kill: float32 (n,), or (1,) if all points have the same value.
    du, dv, step: float32; du and dv include the square of the lattice unit.
    """
    n = len(row) - 1
    feeds, kills = len(feed) > 1, len(kill) > 1
    for block in prange((n + BLOCK - 1) // BLOCK):
        first, last = np.uint64(block * BLOCK), np.uint64(min(block * BLOCK + BLOCK, n))
        for i in range(first, last):
            k = I2 * i
            u, v = uv[k], uv[k + I1]
            u0 = u1 = u2 = u3 = v0 = v1 = v2 = v3 = ZERO
            e, end = np.uint64(row[i]), np.uint64(row[i + I1])
            while e + I4 <= end:
                a, b = I2 * np.uint32(nbr[e]), I2 * np.uint32(nbr[e + I1])
                c, d = I2 * np.uint32(nbr[e + I2]), I2 * np.uint32(nbr[e + I3])
                wa, wb, wc, wd = w[e], w[e + I1], w[e + I2], w[e + I3]
                u0 += wa * (uv[a] - u)
                v0 += wa * (uv[a + I1] - v)
                u1 += wb * (uv[b] - u)
                v1 += wb * (uv[b + I1] - v)
                u2 += wc * (uv[c] - u)
                v2 += wc * (uv[c + I1] - v)
                u3 += wd * (uv[d] - u)
                v3 += wd * (uv[d + I1] - v)
                e += I4
            while e < end:
                a, wa = I2 * np.uint32(nbr[e]), w[e]
                u0 += wa * (uv[a] - u)
                v0 += wa * (uv[a + I1] - v)
                e += I1
            out[k], out[k + I1] = (u0 + u1) + (u2 + u3), (v0 + v1) + (v2 + v3)
        for i in range(first, last):  # a separate loop, which can be vectorized
            k = I2 * i
            out[k], out[k + I1] = reacted(
                uv[k], uv[k + I1], du * out[k], dv * out[k + I1],
                feed[i] if feeds else feed[0], kill[i] if kills else kill[0], step,
            )  # fmt: skip


@kernel(over="uv", writes=("uv",))
def seed(i, uv, weight, u, v):
    """Move uv towards (u, v) by each point's weight, in place. weight: float32 (n,), 0 to 1."""
    t = min(max(weight[i], ZERO), ONE)
    uv[i, 0] += t * (u - uv[i, 0])
    uv[i, 1] += t * (v - uv[i, 1])
