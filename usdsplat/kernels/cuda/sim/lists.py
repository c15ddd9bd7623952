"""CUDA implementation of `kernels.sim.lists`, with a thread for each slot.

The lists are bit-identical. Here `found` has space for `k_max` neighbours of each slot, starting at
slot times `k_max`, so that threads do not wait for each other. `pack` closes the gaps.
"""

from __future__ import annotations

import numpy as np
from numba import cuda
from numba.cuda import libdevice

from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.loops import BLOCKS
from usdsplat.kernels.sim.grid import BLOCK, cell_of, span
from usdsplat.kernels.sim.lists import MARGIN

THREADS = 128
LANES = 8
"""Threads that copy the list of a slot."""
_BITS = 32
"""Bits of a squared distance, and bits of a slot's number."""


@cuda.jit(device=True)
def _squared(x, y, z, positions, c):
    """Return `grid.squared_distance`, like there without contraction of products and sums."""
    dx, dy, dz = positions[c, 0] - x, positions[c, 1] - y, positions[c, 2] - z
    xx, yy, zz = libdevice.fmul_rn(dx, dx), libdevice.fmul_rn(dy, dy), libdevice.fmul_rn(dz, dz)
    return libdevice.fadd_rn(libdevice.fadd_rn(xx, yy), zz)


@cuda.jit(device=True)
def _spans(x, y, z, far, inverse, bits):
    """Return the wrapped cells around a point, for each axis in the form that `span` returns."""
    return (
        span(cell_of(x - far, inverse), cell_of(x + far, inverse), bits[0]),
        span(cell_of(y - far, inverse), cell_of(y + far, inverse), bits[1]),
        span(cell_of(z - far, inverse), cell_of(z + far, inverse), bits[2]),
    )


@cuda.jit(device=True)
def _row(spans, bits, p, q):
    """Return the first table entry of row q of cells in layer p."""
    ya, yb, yc, _ = spans[1]
    za, zb, zc, _ = spans[2]
    wz = za + p if za + p < zb else zc + p - (zb - za)
    wy = ya + q if ya + q < yb else yc + q - (yb - ya)
    return ((wz << bits[1]) | wy) << bits[0]


@cuda.jit(device=True)
def _rank(d2, slot):
    """Return a number that sorts by distance and then by slot."""
    return (np.uint64(np.uint32(libdevice.float_as_int(d2))) << np.uint64(_BITS)) | np.uint64(slot)


@cuda.jit(device=True)
def _scan(positions, reach, widest, start, spans, bits, i, limit, begin, found):
    """Visit the neighbours of slot i whose rank is at most `limit`.

    found: Receives the neighbours from `begin` on, as far as there is space; may be empty.

    Returns:
        the number of these neighbours.
    """
    x, y, z, h = positions[i, 0], positions[i, 1], positions[i, 2], reach[i]
    h2 = libdevice.fmul_rn(h, h)
    xa, xb, xc, xd = spans[0]
    ya, yb, yc, yd = spans[1]
    za, zb, zc, zd = spans[2]
    hits = np.int64(0)
    for p in range((zb - za) + (zd - zc)):
        for q in range((yb - ya) + (yd - yc)):
            row = _row(spans, bits, p, q)
            for part in range(1 if xc == xd else 2):
                first = start[row + (xa if part == 0 else xc)]
                last = start[row + (xb if part == 0 else xd)]
                for c in range(np.uint32(first), np.uint32(last)):
                    d2 = _squared(x, y, z, positions, c)
                    within = h2
                    if widest > np.float32(0):
                        other = reach[c]
                        within = max(h2, libdevice.fmul_rn(other, other))
                    if d2 > np.float32(0) and d2 < within and _rank(d2, c) <= limit:
                        if begin + hits < found.shape[0]:
                            found[begin + hits] = np.int32(c)
                        hits += np.int64(1)
    return hits


@kernel
def _search(
    positions, reach, widest, start, inverse, bits, k_max, begin, end, found, nothing, counts,
    dropped,
):  # fmt: skip
    i = begin + cuda.grid(1)
    if i >= end:
        return
    x, y, z, h = positions[i, 0], positions[i, 1], positions[i, 2], reach[i]
    counts[i] = 0
    total = x + y + z
    finite = total - total == np.float32(0) and h - h == np.float32(0)
    if not (finite and h > np.float32(0)):
        return
    far = np.float64(max(h, widest)) * MARGIN
    spans = _spans(x, y, z, far, inverse, bits)
    every = np.uint64(0xFFFFFFFFFFFFFFFF)
    first = (i - begin) * k_max
    room = found[first : first + k_max]
    hits = _scan(positions, reach, widest, start, spans, bits, i, every, np.int64(0), room)
    if hits > k_max:
        # Find the largest limit with at most k_max neighbours, bit by bit.
        limit = np.uint64(0)
        for bit in range(2 * _BITS - 1, -1, -1):
            trial = limit | (np.uint64(1) << np.uint64(bit))
            at_most = _scan(
                positions, reach, widest, start, spans, bits, i, trial - np.uint64(1),
                np.int64(0), nothing,
            )  # fmt: skip
            if at_most < k_max:
                limit = trial
        hits = _scan(positions, reach, widest, start, spans, bits, i, limit, np.int64(0), room)
        cuda.atomic.add(dropped, (i - begin) // BLOCK, 1)
    counts[i] = hits


def search(
    device: CudaDevice, positions, reach, widest, start, inverse, bits, k_max, begin, found,
    counts, dropped,
):  # fmt: skip
    """Find neighbours as `kernels.sim.lists.search` does, but with the layout of `found` described
    above."""
    blocks = dropped.shape[0]
    end = min(positions.shape[0], begin + blocks * BLOCK)
    _clear[1, THREADS, device.stream](dropped)
    if end > begin:
        _search[-(-(end - begin) // THREADS), THREADS, device.stream](
            positions, reach, widest, start, inverse, bits, k_max, begin, end, found,
            device.borrow("search: nothing", 1, np.int32), counts, dropped,
        )  # fmt: skip


@kernel
def _clear(counts):
    for i in range(cuda.grid(1), counts.shape[0], cuda.gridsize(1)):
        counts[i] = 0


@kernel
def _pack(found, k_max, rows, neighbors):
    lane = cuda.grid(1) % LANES
    for s in range(cuda.grid(1) // LANES, rows.shape[0] - 1, cuda.gridsize(1) // LANES):
        first, source = rows[s], s * k_max
        for k in range(lane, rows[s + 1] - first, LANES):
            neighbors[first + k] = found[source + k]


def pack(device: CudaDevice, found, k_max, blocks, rows, neighbors):
    """Close the gaps in `found` as `kernels.sim.lists.pack` does, for the layout of this module."""
    _pack[BLOCKS, THREADS, device.stream](found, k_max, rows, neighbors)
