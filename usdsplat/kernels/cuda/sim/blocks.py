"""Operations of a thread block: the maximum of all threads' values, and positions in a list.

Source: Harris 2007, "Optimizing parallel reduction in CUDA", with shuffles in place of the last
steps.
"""

from __future__ import annotations

import numpy as np
from numba import cuda

THREADS = 256
"""Threads of a block. All of them must call the functions of this module."""
WARP = 32
WARPS = THREADS // WARP
FULL = 0xFFFFFFFF
NEVER = np.float32(-np.inf)


@cuda.jit(device=True)
def more(a, b):
    """Return the larger of two numbers; a if b is NaN."""
    return b if b > a else a


@cuda.jit(device=True)
def largest(value, shared):
    """Return the largest value (f32) of the block, in each of its threads. NaN is ignored.

    shared: (WARPS,) f32; it may be reused after the call.
    """
    value = more(NEVER, value)
    for step in (16, 8, 4, 2, 1):
        value = more(value, cuda.shfl_xor_sync(FULL, value, step))
    if cuda.threadIdx.x % WARP == 0:
        shared[cuda.threadIdx.x // WARP] = value
    cuda.syncthreads()
    for k in range(WARPS):
        value = more(value, shared[k])
    cuda.syncthreads()
    return value


@cuda.jit(device=True)
def place_of(wanted, shared):
    """Return the number of threads before this one that have `wanted` set, and their total number.

    shared: (WARPS,) i32; it may be reused after the call.
    """
    votes = np.uint32(cuda.ballot_sync(FULL, wanted))
    lane, warp = cuda.threadIdx.x % WARP, cuda.threadIdx.x // WARP
    if lane == 0:
        shared[warp] = cuda.popc(votes)
    cuda.syncthreads()
    before, total = np.int32(0), np.int32(0)
    for k in range(WARPS):
        before += shared[k] if k < warp else np.int32(0)
        total += shared[k]
    cuda.syncthreads()
    below = np.uint32(votes & np.uint32((np.uint32(1) << np.uint32(lane)) - np.uint32(1)))
    return before + np.int32(cuda.popc(below)), total
