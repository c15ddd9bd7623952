"""Count or write the samples of deep pixels on a GPU, with one thread for each pixel of a tile."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from usdsplat.kernels.bins import TILE
from usdsplat.kernels.blend import END
from usdsplat.kernels.cuda.device import THREADS as SIZE
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.falloff import behind
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.loops import BLOCKS
from usdsplat.kernels.cuda.tile import (
    BATCH,
    FIELDS,
    THREADS,
    alpha_in,
    fetch_splat,
    origin,
)
from usdsplat.kernels.project import DEPTH


@kernel
def _deep(
    records, starts, lists, grid, column, error, writes, offsets, counts, near, far, color
):  # fmt: skip
    """Count or write samples. One kernel does both, so that counts and samples match."""
    batch = cuda.shared.array((FIELDS, BATCH), np.float32)
    colors = cuda.shared.array((3, BATCH), np.float32)
    depths = cuda.shared.array(BATCH, np.float32)
    rows = cuda.shared.array((2, BATCH), np.int32)
    tile, thread = cuda.blockIdx.x, cuda.threadIdx.x
    x, y = thread % TILE, thread // TILE
    g = grid[0]
    left, top = origin(g, tile)
    column_of, row_of = left + x - g.x0, top + y - g.y0
    inside = g.x0 <= left + x < g.x1 and g.y0 <= top + y < g.y1
    t = np.float32(1) if inside else np.float32(-1)
    seen, run, samples = np.float32(1), np.float32(0), np.int64(0)
    offset = offsets[row_of * (g.x1 - g.x0) + column_of] if writes and inside else np.int64(0)
    begin, end = starts[tile], starts[tile + 1]
    for first in range(begin, end, BATCH):
        if cuda.syncthreads_count(np.int32(t > np.float32(0))) == 0:
            break
        if first + thread < end:
            rank = lists[first + thread]
            fetch_splat(records, rank, left, top, batch, rows, thread)
            for c in range(3):
                colors[c, thread] = records[rank, column + c]
            depths[thread] = records[rank, DEPTH]
        cuda.syncthreads()
        for i in range(min(BATCH, end - first)):
            if t <= np.float32(0):
                break
            if not (rows[0, i] <= y < rows[1, i]):
                continue
            alpha = alpha_in(batch, i, x, y)
            weight = alpha * t
            if weight <= np.float32(0):
                continue
            remains = behind(t, alpha)
            if remains < END:
                t = -t
                break
            t = remains
            own = min(weight / seen, np.float32(1))
            seen = seen - seen * own
            begins = run <= np.float32(0) or run + weight > error
            run = weight if begins else run + weight
            if begins:
                samples += 1
            if not writes or own <= np.float32(0):
                continue
            at = offset + samples - 1
            far[at] = depths[i]
            if begins:
                near[at] = depths[i]
                for c in range(3):
                    color[at, c] = own * colors[c, i]
                color[at, 3] = own
            else:
                part = (np.float32(1) - color[at, 3]) * own
                for c in range(3):
                    color[at, c] += part * colors[c, i]
                color[at, 3] += part
    if inside and not writes:
        counts[row_of, column_of] = np.uint32(samples)


@kernel
def _widen(counts, out):
    n = counts.shape[0] * counts.shape[1]
    for k in range(cuda.grid(1), n + 1, cuda.gridsize(1)):
        column = k % counts.shape[1]
        out[k] = counts[k // counts.shape[1], column] if k < n else 0


def place(device: CudaDevice, counts: Any, offsets: Any) -> int:
    """Compute the offset of each pixel's samples, see `kernels.deep.place`."""
    n = counts.size
    wide = device.borrow("deep counts", n + 1, np.int64)
    _widen[BLOCKS, SIZE, device.stream](counts, wide)
    device.primitives.running_sum(wide, offsets, n + 1)
    return device.number(offsets, n)


def deep(device: CudaDevice, *args: Any) -> None:
    """Count or write the samples of all pixels of a band, see `kernels.deep.deep`."""
    starts = args[1]
    _deep[starts.shape[0] - 1, THREADS, device.stream](*args)
