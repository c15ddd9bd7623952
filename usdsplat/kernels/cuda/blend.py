"""Blend on a GPU, with one thread for each pixel of a tile, by the same rules as on the CPU."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from usdsplat.kernels.bins import TILE
from usdsplat.kernels.blend import CHANNELS, END
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.falloff import behind
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.tile import (
    BATCH,
    FIELDS,
    RAY_HITS,
    THREADS,
    alpha_in,
    fetch_ray_hit,
    fetch_splat,
    is_hidden,
    origin,
)


@kernel
def _blend(
    records, paints, column, starts, lists, grid, ray_hits, occluder_depth, is_parallel, image
):  # fmt: skip
    batch = cuda.shared.array((FIELDS, BATCH), np.float32)
    colors = cuda.shared.array((3, BATCH), np.float32)
    shape = cuda.shared.array((RAY_HITS, BATCH), np.float32)
    rows = cuda.shared.array((2, BATCH), np.int32)
    tile, thread = cuda.blockIdx.x, cuda.threadIdx.x
    x, y = thread % TILE, thread // TILE
    g = grid[0]
    left, top = origin(g, tile)
    column_of, row_of = left + x - g.x0, top + y - g.y0
    inside = g.x0 <= left + x < g.x1 and g.y0 <= top + y < g.y1
    has_occluders = occluder_depth.shape[0] > 0
    stop = occluder_depth[row_of, column_of] if has_occluders and inside else np.float32(np.inf)
    t = np.float32(1) if inside else np.float32(-1)
    red, green, blue = np.float32(0), np.float32(0), np.float32(0)
    begin, end = starts[tile], starts[tile + 1]
    for first in range(begin, end, BATCH):
        if cuda.syncthreads_count(np.int32(t > np.float32(0))) == 0:
            break
        if first + thread < end:
            rank = lists[first + thread]
            fetch_splat(records, rank, left, top, batch, rows, thread)
            for c in range(3):
                colors[c, thread] = paints[rank, column + c]
            if has_occluders:
                fetch_ray_hit(ray_hits, rank, shape, thread)
        cuda.syncthreads()
        for i in range(min(BATCH, end - first)):
            if t <= np.float32(0):
                break
            if not (rows[0, i] <= y < rows[1, i]):
                continue
            alpha = alpha_in(batch, i, x, y)
            if alpha <= np.float32(0):
                continue
            if has_occluders and is_hidden(batch, shape, i, x, y, stop, is_parallel):
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
    if inside:
        at = column_of * CHANNELS
        image[row_of, at], image[row_of, at + 1], image[row_of, at + 2] = red, green, blue
        image[row_of, at + 3] = np.float32(1) - abs(t)


def blend(device: CudaDevice, *args: Any) -> None:
    """Blend all tiles of a band, see `kernels.blend.blend`.

    `work` is not filled, because the host would have to wait for it.
    """
    starts = args[3]
    _blend[starts.shape[0] - 1, THREADS, device.stream](*args[:-1])
