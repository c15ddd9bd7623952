"""Combine the threads of a warp: votes and sums over its 32 lanes."""

from __future__ import annotations

import numpy as np
from numba import cuda

LANES = 32
FULL = np.uint32(0xFFFFFFFF)


@cuda.jit(device=True, inline="always")
def votes(condition):
    """Return a bit for each lane, set where its condition holds."""
    return np.uint32(cuda.ballot_sync(FULL, condition))


@cuda.jit(device=True, inline="always")
def below(lane):
    """Return the bits of all lanes before `lane`."""
    return np.uint32((np.uint32(1) << np.uint32(lane)) - np.uint32(1))


@cuda.jit(device=True, inline="always")
def without_lowest(bits):
    """Return `bits` without the lowest set bit."""
    return np.uint32(bits & np.uint32(bits - np.uint32(1)))


@cuda.jit(device=True, inline="always")
def running(value, lane):
    """Return the sum of `value` over this lane and all before it."""
    for shift in (1, 2, 4, 8, 16):
        other = cuda.shfl_up_sync(FULL, value, shift)
        if lane >= shift:
            value += other
    return value
