"""What the threads of a block find out together: the largest of their numbers, a place in a list.

Source: Harris 2007, "Optimizing parallel reduction in CUDA", with shuffles in place of the last
steps.
"""

from __future__ import annotations

import numpy as np
from numba import cuda

THREADS = 256
"""Of a block; all of them call these functions."""
WARP = 32
WARPS = THREADS // WARP
FULL = 0xFFFFFFFF
NEVER = np.float32(-np.inf)


@cuda.jit(device=True)
def more(a, b):
    """The larger of two numbers; a, if b is none."""
    return b if b > a else a


@cuda.jit(device=True)
def largest(value, shared):
    """The largest of the block's values (f32), told to all of its threads; what is no number
    counts for nothing. shared: (WARPS,) f32, which may be used again."""
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
    """How many of the block's threads before this one want a place, and how many do in all.
    shared: (WARPS,) i32, which may be used again."""
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
