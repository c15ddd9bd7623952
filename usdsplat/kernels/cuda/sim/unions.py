"""The union of solids, as `kernels.sim.blend_solids`, for a thread and for a warp.

A thread tells in float32 which solids change nothing. A warp gives each lane a solid, and joins
what the lanes found in the order of the table: its lanes call with the same arguments, and get the
same answer.
"""

from __future__ import annotations

import math

import numpy as np
from numba import cuda

from usdsplat.kernels.cuda.rebound import rebound
from usdsplat.kernels.cuda.sim.blocks import FULL, WARP
from usdsplat.kernels.sim.blend_solids import (
    BLEND,
    CLEARANCE,
    FIELD,
    KIND,
    NOTHING,
    PLACE,
    SIZE,
    TURN,
    into,
    is_far,
    join,
    local_solid,
    times,
    touch,
    union,
)
from usdsplat.kernels.sim.contact import MARGIN
from usdsplat.kernels.sim.solids import ROUND, round_distance


@cuda.jit(device=True)
def _is_idle(bodies, j, x, y, z, sigma, least):
    """As `is_idle`, in float32: False where rounding might decide, which changes no result."""
    if bodies[j, KIND] != ROUND:
        return False
    u, v, w = np.float32(x), np.float32(y), np.float32(z)
    middle, grow = np.float32(bodies[j, SIZE]), np.float32(bodies[j, SIZE + 1])
    half, slope = np.float32(bodies[j, SIZE + 2]), np.float32(bodies[j, SIZE + 3])
    e = round_distance(u, v, w, middle, grow, half, slope)
    e -= MARGIN * (abs(u) + abs(v) + abs(w) + middle + half)
    return np.float64(e) - bodies[j, CLEARANCE] * sigma > least + bodies[j, BLEND]


union_of_thread = rebound(union, is_idle=_is_idle)
touch_of_thread = rebound(touch, is_idle=_is_idle)


@cuda.jit(device=True)
def _least(value, so_far):
    """Of `so_far` and the lanes' values (f64) the least: of the lanes before this one, of all."""
    lane = cuda.threadIdx.x % WARP
    for step in (1, 2, 4, 8, 16):
        other = cuda.shfl_up_sync(FULL, value, step)
        if lane >= step and other < value:
            value = other
    before = cuda.shfl_up_sync(FULL, value, 1)
    lowest = cuda.shfl_sync(FULL, value, WARP - 1)
    if lane == 0 or so_far < before:
        before = so_far
    return before, lowest if lowest < so_far else so_far


@cuda.jit(device=True)
def _first(votes):
    """The first lane that voted."""
    return np.int32(cuda.ffs(votes)) - np.int32(1)


@cuda.jit(device=True)
def union_of_warp(bodies, rows, count, fields, voxels, x, y, z, sigma, reach):
    """As `union`."""
    d, gx, gy, gz = NOTHING, 0.0, 0.0, 0.0
    least, nx, ny, nz = NOTHING, 0.0, 0.0, 1.0
    for start in range(0, count, WARP):
        s = start + cuda.threadIdx.x % WARP
        e, u, v, w, blend = NOTHING, 0.0, 0.0, 1.0, 0.0
        is_near = False
        if s < count:
            j = np.int64(rows[s])
            if not is_far(bodies, j, reach, x, y, z):
                u, v, w = into(bodies, j, TURN, PLACE, x, y, z)
                e, u, v, w = local_solid(bodies, j, SIZE, FIELD, fields, voxels, u, v, w)
                u, v, w = times(bodies, j, TURN, u, v, w)
                e -= bodies[j, CLEARANCE] * sigma
                blend = bodies[j, BLEND]
                is_near = True
        before, lowest = _least(e if e < NOTHING else NOTHING, least)  # what is no number is none
        votes = np.uint32(cuda.ballot_sync(FULL, is_near and not e > before + blend))
        while votes != np.uint32(0):
            k = _first(votes)
            votes = np.uint32(votes & np.uint32(votes - np.uint32(1)))
            other, width = cuda.shfl_sync(FULL, e, k), cuda.shfl_sync(FULL, blend, k)
            ox, oy = cuda.shfl_sync(FULL, u, k), cuda.shfl_sync(FULL, v, k)
            oz = cuda.shfl_sync(FULL, w, k)
            if d == NOTHING:
                d, gx, gy, gz = other, ox, oy, oz
            else:
                part, d = join(d, other, width)
                gx, gy, gz = gx + (ox - gx) * part, gy + (oy - gy) * part, gz + (oz - gz) * part
        if lowest < least:
            least = lowest
            k = _first(np.uint32(cuda.ballot_sync(FULL, e == lowest)))
            nx, ny = cuda.shfl_sync(FULL, u, k), cuda.shfl_sync(FULL, v, k)
            nz = cuda.shfl_sync(FULL, w, k)
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if length > 1e-6:
        return d, gx, gy, gz, nx / length, ny / length, nz / length
    return d, gx, gy, gz, 0.0, 0.0, 1.0
