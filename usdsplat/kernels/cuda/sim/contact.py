"""CUDA implementation of `kernels.sim.contact`, in two launches.

The first launch finds in float32 the splats that may touch a solid: a block of threads processes a
block of rows, and tests only the solids near the bounding box of these rows. The second launch
resolves the few contacts found in float64, with one thread each, as it needs many registers.
"""

from __future__ import annotations

import numpy as np
from numba import cuda

from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.loops import BLOCKS
from usdsplat.kernels.cuda.sim.blocks import THREADS, WARPS, largest, more, place_of
from usdsplat.kernels.sim.blend_solids import (
    BLEND,
    BLOCK,
    CLEARANCE,
    FIELD,
    KIND,
    PLACE,
    SIZE,
    TURN,
    into,
    join,
)
from usdsplat.kernels.sim.contact import (
    ALIVE_ONLY,
    COUNTS,
    MARCHED,
    MARGIN,
    PINNED_OR_DEAD,
    TOUCHED,
    TRAPPED,
    contact_row,
    is_near,
)
from usdsplat.kernels.sim.solids import BOX, MESH, ROUND, box_distance, field_solid, round_distance

RESOLVERS = 64
"""Threads of a block of the second launch."""
_TURN, _PLACE, _SIZE, _CLEARANCE, _BLEND, _KIND, _SHORT = 0, 9, 12, 16, 17, 18, 19
"""Columns of the table of solids that the first launch reads, float32, flat."""


@kernel
def _shorten(bodies, short, total):
    """Copy the values of each solid that the first launch needs.

    The rotation is into the solid's frame. total: is set to 0.
    """
    j = cuda.blockIdx.x
    at = j * _SHORT
    if j == 0 and cuda.threadIdx.x == 0:
        total[0] = 0
    if cuda.threadIdx.x == 0:
        for row in range(3):
            for column in range(3):
                short[at + _TURN + 3 * row + column] = bodies[j, TURN + 3 * column + row]
            short[at + _PLACE + row] = bodies[j, PLACE + row]
        for k in range(4):
            short[at + _SIZE + k] = bodies[j, SIZE + k]
        short[at + _CLEARANCE], short[at + _BLEND] = bodies[j, CLEARANCE], bodies[j, BLEND]
        short[at + _KIND] = bodies[j, KIND]


@cuda.jit(device=True)
def _gap_to(bodies, short, j, fields, voxels, px, py, pz):
    """Return the distance of a point from solid j, float32."""
    at = j * _SHORT
    kind = short[at + _KIND]
    if kind == MESH:
        u, v, w = into(bodies, j, TURN, PLACE, np.float64(px), np.float64(py), np.float64(pz))
        return np.float32(field_solid(u, v, w, fields, int(bodies[j, FIELD]), voxels)[0])
    px, py, pz = px - short[at + _PLACE], py - short[at + _PLACE + 1], pz - short[at + _PLACE + 2]
    x = short[at + _TURN] * px + short[at + _TURN + 1] * py + short[at + _TURN + 2] * pz
    y = short[at + _TURN + 3] * px + short[at + _TURN + 4] * py + short[at + _TURN + 5] * pz
    z = short[at + _TURN + 6] * px + short[at + _TURN + 7] * py + short[at + _TURN + 8] * pz
    a, b, c = short[at + _SIZE], short[at + _SIZE + 1], short[at + _SIZE + 2]
    if kind == ROUND:
        return round_distance(x, y, z, a, b, c, short[at + _SIZE + 3])
    if kind == BOX:
        return box_distance(x, y, z, a, b, c)
    return z


@kernel
def _find(
    bodies, short, fields, voxels, blend, clearance, flags, scales, positions, near, found,
    counts, listed, total,
):  # fmt: skip
    """Find the solids near each block, and the rows that may touch one of them.

    found: Receives the number of solids near each block, (blocks,) i32. listed: Receives the rows,
    in any order, (n,) i32. total: Receives their number, (1,) i32, initially zero.
    """
    shared = cuda.shared.array(WARPS, np.float32)
    places = cuda.shared.array(WARPS, np.int32)
    begin = cuda.shared.array(1, np.int32)
    block, me = cuda.blockIdx.x, cuda.threadIdx.x
    n = positions.shape[0]
    first, last = block * BLOCK, min(n, (block + 1) * BLOCK)
    none = np.float32(-np.inf)
    lx, ly, lz, hx, hy, hz, sigma = none, none, none, none, none, none, none
    for i in range(first + me, last, THREADS):
        x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
        lx, ly, lz = more(lx, -x), more(ly, -y), more(lz, -z)
        hx, hy, hz = more(hx, x), more(hy, y), more(hz, z)
        sigma = more(sigma, max(scales[i, 0], max(scales[i, 1], scales[i, 2])))
    lx, ly, lz = -largest(lx, shared), -largest(ly, shared), -largest(lz, shared)
    hx, hy, hz = largest(hx, shared), largest(hy, shared), largest(hz, shared)
    reach = 3.0 * blend + clearance * largest(sigma, shared)
    far = max(max(abs(lx), abs(hx)), max(max(abs(ly), abs(hy)), max(abs(lz), abs(hz))))
    middle = (0.5 * (lx + hx), 0.5 * (ly + hy), 0.5 * (lz + hz))
    half = (0.5 * (hx - lx), 0.5 * (hy - ly), 0.5 * (hz - lz))
    count, slack = np.int32(0), np.float32(0)
    for start in range(0, bodies.shape[0], THREADS):
        j = start + me
        wanted = False
        if j < bodies.shape[0]:
            wanted = is_near(bodies, j, TURN, PLACE, middle, half, reach + 1e-5 * far)
        at, these = place_of(wanted, places)
        if wanted:
            near[block, count + at] = j
            for axis in range(3):
                slack = max(slack, abs(short[j * _SHORT + _PLACE + axis]))
        count += these
    slack = MARGIN * (far + largest(slack, shared))  # with a barrier, after `near` is written
    if me == 0:
        found[block] = count
    if me < COUNTS:
        counts[block, me] = 0
    for start in range(first, last, THREADS):
        i = start + me
        touches = False
        if count > 0 and i < last and flags[i] & PINNED_OR_DEAD == ALIVE_ONLY:
            x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
            sigma = max(scales[i, 0], max(scales[i, 1], scales[i, 2]))
            gap = np.float32(0)
            for s in range(count):
                j = near[block, s]
                other = _gap_to(bodies, short, j, fields, voxels, x, y, z)
                other -= short[j * _SHORT + _CLEARANCE] * sigma
                gap = other if s == 0 else join(gap, other, short[j * _SHORT + _BLEND])[1]
            touches = gap < slack
        at, these = place_of(touches, places)
        if me == 0 and these > 0:
            begin[0] = cuda.atomic.add(total, 0, these)
        cuda.syncthreads()
        if touches:
            listed[begin[0] + at] = i


@kernel
def _resolve(
    bodies, everyone, fields, voxels, dt, blend, clearance, least, started, scales, positions,
    velocities, since, struck, near, found, counts, listed, total,
):  # fmt: skip
    for k in range(cuda.grid(1), total[0], cuda.gridsize(1)):
        i = np.int64(listed[k])
        block = i // BLOCK
        sigma = np.float64(max(scales[i, 0], max(scales[i, 1], scales[i, 2])))
        touched, marched, trapped = contact_row(
            bodies, near[block], np.int64(found[block]), everyone, fields, voxels, dt, least, i,
            started, positions, velocities, sigma, 3.0 * blend + clearance * sigma,
            struck[i] == 0,
        )  # fmt: skip
        if touched:
            since[i] = 0.0
            cuda.atomic.add(counts, (block, TOUCHED), 1)
            if marched:
                cuda.atomic.add(counts, (block, MARCHED), 1)
            if trapped:
                cuda.atomic.add(counts, (block, TRAPPED), 1)


def contact(
    device: CudaDevice, bodies, everyone, fields, voxels, dt, blend, clearance, least, started,
    flags, scales, positions, velocities, since, struck, near, counts,
):  # fmt: skip
    """Resolve all contacts at the end of a substep, see `kernels.sim.contact.contact`."""
    blocks, k = counts.shape[0], bodies.shape[0]
    if not blocks or not k:
        return
    short = device.borrow("contact: solids", k * _SHORT, np.float32)
    found = device.borrow("contact: found", blocks, np.int32)
    listed = device.borrow("contact: listed", positions.shape[0], np.int32)
    total = device.borrow("contact: total", 1, np.int32)
    _shorten[k, WARPS, device.stream](bodies, short, total)
    _find[blocks, THREADS, device.stream](
        bodies, short, fields, voxels, blend, clearance, flags, scales, positions, near, found,
        counts, listed, total,
    )  # fmt: skip
    _resolve[BLOCKS, RESOLVERS, device.stream](
        bodies, everyone, fields, voxels, dt, blend, clearance, least, started, scales, positions,
        velocities, since, struck, near, found, counts, listed, total,
    )  # fmt: skip
