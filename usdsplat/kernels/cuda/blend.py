"""Blending on a GPU: a thread for each pixel of a tile, by the same rules as on the CPU."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from usdsplat.kernels.bins import TILE
from usdsplat.kernels.blend import CHANNELS, END
from usdsplat.kernels.cuda.device import CudaDevice, form
from usdsplat.kernels.cuda.falloff import behind
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.tile import (
    BATCH,
    FIELDS,
    PEAKS,
    THREADS,
    alpha_in,
    fetch_peak,
    fetch_splat,
    is_hidden,
    origin,
)

ALL_LANES = 0xFFFFFFFF


@kernel
def _blend(
    records, paints, column, starts, lists, grid, peaks, stops, is_parallel, image, work
):  # fmt: skip
    batch = cuda.shared.array((FIELDS, BATCH), np.float32)
    colors = cuda.shared.array((3, BATCH), np.float32)
    shape = cuda.shared.array((PEAKS, BATCH), np.float32)
    rows = cuda.shared.array((2, BATCH), np.int32)
    live = cuda.shared.array(TILE, np.int32)
    done = cuda.shared.array(1, np.int32)
    tile, thread = cuda.blockIdx.x, cuda.threadIdx.x
    x, y = thread % TILE, thread // TILE
    g = grid[0]
    left, top = origin(g, tile)
    column_of, row_of = left + x - g.x0, top + y - g.y0
    inside = g.x0 <= left + x < g.x1 and g.y0 <= top + y < g.y1
    has_stops = stops.shape[0] > 0
    stop = stops[row_of, column_of] if has_stops and inside else np.float32(np.inf)
    t = np.float32(1) if inside else np.float32(-1)
    red, green, blue = np.float32(0), np.float32(0), np.float32(0)
    touched = np.int32(0)
    if thread == 0:
        done[0] = 0
    begin, end = starts[tile], starts[tile + 1]
    for first in range(begin, end, BATCH):
        if cuda.syncthreads_count(np.int32(t > np.float32(0))) == 0:
            break
        votes = np.uint32(cuda.ballot_sync(ALL_LANES, t > np.float32(0)))
        if x == 0:
            half = np.uint32(votes >> np.uint32(thread % 32))
            live[y] = np.int32(np.uint32(half & np.uint32(0xFFFF)) != np.uint32(0))
        if first + thread < end:
            rank = lists[first + thread]
            fetch_splat(records, rank, left, top, batch, rows, thread)
            for c in range(3):
                colors[c, thread] = paints[rank, column + c]
            if has_stops:
                fetch_peak(peaks, rank, shape, thread)
        cuda.syncthreads()
        if first + thread < end:
            for row in range(rows[0, thread], rows[1, thread]):
                touched += live[row]
        for i in range(min(BATCH, end - first)):
            if t <= np.float32(0):
                break
            if not (rows[0, i] <= y < rows[1, i]):
                continue
            alpha = alpha_in(batch, i, x, y)
            if alpha <= np.float32(0):
                continue
            if has_stops and is_hidden(batch, shape, i, x, y, stop, is_parallel):
                continue
            weight = alpha * t
            remains = behind(t, alpha)
            if remains < END:
                t = -t
                break
            t = remains
            red += weight * colors[0, i]
            green += weight * colors[1, i]
            blue += weight * colors[2, i]
    cuda.syncthreads()
    cuda.atomic.add(done, 0, touched)
    cuda.syncthreads()
    if thread == 0:
        work[tile] = done[0]
    if inside:
        at = column_of * CHANNELS
        image[row_of, at], image[row_of, at + 1], image[row_of, at + 2] = red, green, blue
        image[row_of, at + 3] = np.float32(1) - abs(t)


@form
def blend(device: CudaDevice, *args: Any) -> None:
    """`kernels.blend.blend`; `work` counts rows that were alive when a batch began."""
    work = args[-1]
    _blend[work.shape[0], THREADS, device.stream](*args)
