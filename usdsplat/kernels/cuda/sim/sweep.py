"""CUDA implementation of `kernels.sim.sweep`, in two launches.

The first finds the solids that may pass a splat of each block. The second sweeps these splats, with
a thread each.
"""

from __future__ import annotations

import math

import numpy as np
from numba import cuda

from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.sim.blocks import THREADS, WARPS, largest, more, place_of
from usdsplat.kernels.sim.blend_solids import BLOCK, CLEARANCE, SWEPT
from usdsplat.kernels.sim.contact import ALIVE_ONLY, PINNED_OR_DEAD
from usdsplat.kernels.sim.sweep import may_pass, sweep_row

SWEEPERS = 128
"""Threads of a block of the second launch."""


@cuda.jit(device=True)
def _box(rows, first, last, shared):
    """Return the bounding box of the block's points, as (centre (3), half extent (3))."""
    none = np.float32(-np.inf)
    lx, ly, lz, hx, hy, hz = none, none, none, none, none, none
    for i in range(first + cuda.threadIdx.x, last, THREADS):
        x, y, z = rows[i, 0], rows[i, 1], rows[i, 2]
        lx, ly, lz = more(lx, -x), more(ly, -y), more(lz, -z)
        hx, hy, hz = more(hx, x), more(hy, y), more(hz, z)
    lx, ly, lz = -largest(lx, shared), -largest(ly, shared), -largest(lz, shared)
    hx, hy, hz = largest(hx, shared), largest(hy, shared), largest(hz, shared)
    return (
        0.5 * (lx + hx), 0.5 * (ly + hy), 0.5 * (lz + hz),
        0.5 * (hx - lx), 0.5 * (hy - ly), 0.5 * (hz - lz),
    )  # fmt: skip


@kernel
def _cull(bodies, clearance, started, scales, positions, near, found, counts):
    """Find the solids near each block. found: receives their number, (blocks,) i32."""
    shared = cuda.shared.array(WARPS, np.float32)
    places = cuda.shared.array(WARPS, np.int32)
    block, me = cuda.blockIdx.x, cuda.threadIdx.x
    first, last = block * BLOCK, min(positions.shape[0], (block + 1) * BLOCK)
    before, after = _box(started, first, last, shared), _box(positions, first, last, shared)
    sigma, moved = np.float32(0), np.float32(0)
    for i in range(first + me, last, THREADS):
        u, v = positions[i, 0] - started[i, 0], positions[i, 1] - started[i, 1]
        w = positions[i, 2] - started[i, 2]
        moved = more(moved, u * u + v * v + w * w)
        sigma = more(sigma, max(scales[i, 0], max(scales[i, 1], scales[i, 2])))
    far = 1.001 * math.sqrt(largest(moved, shared))
    reach = 1.001 * clearance * largest(sigma, shared)
    count = np.int32(0)
    for start in range(0, bodies.shape[0], THREADS):
        j = start + me
        wanted = False
        if j < bodies.shape[0] and bodies[j, SWEPT] != 0.0:
            wanted = may_pass(bodies, j, before, after, far, reach)
        at, these = place_of(wanted, places)
        if wanted:
            near[block, count + at] = j
        count += these
    if me == 0:
        found[block], counts[block] = count, 0


@kernel
def _sweep(
    bodies, fields, voxels, dt, started, flags, scales, positions, velocities, since, struck, near,
    found, counts,
):  # fmt: skip
    i = np.int64(cuda.grid(1))
    if i >= positions.shape[0]:
        return
    block = i // BLOCK
    count = found[block]
    if count == 0 or flags[i] & PINNED_OR_DEAD != ALIVE_ONLY:
        return
    sigma = np.float64(max(scales[i, 0], max(scales[i, 1], scales[i, 2])))
    for s in range(count):
        j = np.int64(near[block, s])
        if sweep_row(
            bodies, j, fields, voxels, dt, bodies[j, CLEARANCE] * sigma, i, started, positions,
            velocities,
        ):  # fmt: skip
            since[i] = 0.0
            struck[i] = 1
            cuda.atomic.add(counts, block, 1)


def sweep(
    device: CudaDevice, bodies, fields, voxels, dt, clearance, started, flags, scales, positions,
    velocities, since, struck, near, counts,
):  # fmt: skip
    """Sweep solids past splats, see `kernels.sim.sweep.sweep`."""
    blocks, n = counts.shape[0], positions.shape[0]
    if not blocks:
        return
    found = device.borrow("sweep: found", blocks, np.int32)
    _cull[blocks, THREADS, device.stream](
        bodies, clearance, started, scales, positions, near, found, counts
    )
    _sweep[-(-n // SWEEPERS), SWEEPERS, device.stream](
        bodies, fields, voxels, dt, started, flags, scales, positions, velocities, since, struck,
        near, found, counts,
    )  # fmt: skip
