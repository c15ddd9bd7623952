"""CUDA implementation of `kernels.sim.grid`: points are sorted by cell with CUB's radix sort."""

from __future__ import annotations

import numpy as np
from numba import cuda

from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.loops import BLOCKS
from usdsplat.kernels.cuda.sim.blocks import THREADS, WARPS, largest, more
from usdsplat.kernels.sim.grid import BLOCK


@kernel
def _bounds(positions, lower, upper):
    shared = cuda.shared.array(WARPS, np.float32)
    block, me = cuda.blockIdx.x, cuda.threadIdx.x
    none = np.float32(-np.inf)
    lx, ly, lz, hx, hy, hz = none, none, none, none, none, none
    for i in range(block * BLOCK + me, min(positions.shape[0], (block + 1) * BLOCK), THREADS):
        x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
        total = x + y + z
        if total - total == np.float32(0):  # it is finite
            lx, ly, lz = more(lx, -x), more(ly, -y), more(lz, -z)
            hx, hy, hz = more(hx, x), more(hy, y), more(hz, z)
    lx, ly, lz = largest(lx, shared), largest(ly, shared), largest(lz, shared)
    hx, hy, hz = largest(hx, shared), largest(hy, shared), largest(hz, shared)
    if me == 0:
        lower[block, 0], lower[block, 1], lower[block, 2] = -lx, -ly, -lz
        upper[block, 0], upper[block, 1], upper[block, 2] = hx, hy, hz


def bounds(device: CudaDevice, positions, lower, upper):
    """Compute bounds as `kernels.sim.grid.bounds` does, by one block of threads per block of
    rows."""
    if lower.shape[0]:
        _bounds[lower.shape[0], THREADS, device.stream](positions, lower, upper)


@kernel
def _number(rows):
    for i in range(cuda.grid(1), rows.shape[0], cuda.gridsize(1)):
        rows[i] = i


@kernel
def _starts(entry, start):
    """Write the first slot of each key: the first entry that is not less than the key."""
    for key in range(cuda.grid(1), start.shape[0], cuda.gridsize(1)):
        low, high = np.int32(0), np.int32(entry.shape[0])
        while low < high:
            middle = np.int32((low + high) >> 1)
            if entry[middle] < key:
                low = np.int32(middle + 1)
            else:
                high = middle
        start[key] = low


def sort_cells(device: CudaDevice, entry, bits, histogram, moved, rows, start, order):
    """Sort as `kernels.sim.grid.sort_cells` does.

    `histogram` is not used; `moved` receives the sorted keys.
    """
    n = entry.shape[0]
    if n:
        _number[BLOCKS, THREADS, device.stream](rows)
        device.primitives.sort_pairs(
            entry.view(np.uint32), rows, moved.view(np.uint32), order, n, end_bit=int(bits)
        )
    _starts[BLOCKS, THREADS, device.stream](moved, start)
