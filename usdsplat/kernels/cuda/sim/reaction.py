"""CUDA implementation of `kernels.sim.reaction`: several lanes of a warp share a point.

The lanes' loads of neighbours and weights are therefore adjacent. Sums have a fixed order: each
lane adds its own terms, then lanes are added in pairs.
"""

from __future__ import annotations

import numpy as np
from numba import cuda
from numba.cuda import libdevice

from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.sim.reaction import ZERO, reacted

LANES = 8
"""Lanes that share a point; a point has about 20 neighbours."""
THREADS = 256
FULL = 0xFFFFFFFF
_HALF = np.uint64(32)


@cuda.jit(device=True)
def _pair(pairs, i):
    """Return u and v of a point, by one load."""
    bits = pairs[i]
    return (
        libdevice.int_as_float(np.int32(bits)),
        libdevice.int_as_float(np.int32(bits >> _HALF)),
    )


@kernel
def _step(row, nbr, w, pairs, feed, kill, du, dv, step, out):
    n = np.int64(row.shape[0] - 1)
    i = np.int64(cuda.grid(1)) // LANES
    lane = cuda.threadIdx.x % LANES
    flow_u, flow_v, u, v = ZERO, ZERO, ZERO, ZERO
    if i < n:
        at = np.uint64(i)
        u, v = _pair(pairs, at)
        first, last = row[at], row[at + np.uint64(1)]
        for e in range(np.uint64(first) + np.uint64(lane), np.uint64(last), np.uint64(LANES)):
            p, q = _pair(pairs, np.uint32(nbr[e]))
            flow_u += w[e] * (p - u)
            flow_v += w[e] * (q - v)
    for apart in (4, 2, 1):
        flow_u += cuda.shfl_xor_sync(FULL, flow_u, apart)
        flow_v += cuda.shfl_xor_sync(FULL, flow_v, apart)
    if i < n and lane == 0:
        f = feed[i] if feed.shape[0] > 1 else feed[0]
        k = kill[i] if kill.shape[0] > 1 else kill[0]
        out[2 * i], out[2 * i + 1] = reacted(u, v, du * flow_u, dv * flow_v, f, k, step)


def gray_scott(device: CudaDevice, row, nbr, w, uv, feed, kill, du, dv, step, out):
    """Make one step of the reaction, see `kernels.sim.reaction.gray_scott`."""
    blocks = -(-(row.shape[0] - 1) * LANES // THREADS)
    if blocks:
        _step[blocks, THREADS, device.stream](
            row, nbr, w, uv.view(np.uint64), feed, kill, du, dv, step, out
        )
