"""Find median splats on a GPU, with one thread for each pixel of a tile."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from usdsplat.kernels.bins import TILE
from usdsplat.kernels.blend import END
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
from usdsplat.kernels.median import NONE


@kernel
def _median(
    records, starts, lists, grid, ray_hits, occluder_depth, is_parallel, image, covered, part, ranks
):  # fmt: skip
    batch = cuda.shared.array((FIELDS, BATCH), np.float32)
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
    t, goal = np.float32(-1), np.float32(0)
    if inside:
        whole = image[row_of, column_of, 3]
        if whole > np.float32(0):
            if covered.shape[0] > 0 and covered[row_of, column_of] == 1:
                whole = np.float32(1)
            t, goal = np.float32(1), np.float32(1) - whole * part
    found = NONE
    begin, end = starts[tile], starts[tile + 1]
    for first in range(begin, end, BATCH):
        if cuda.syncthreads_count(np.int32(t > np.float32(0))) == 0:
            break
        if first + thread < end:
            rank = lists[first + thread]
            fetch_splat(records, rank, left, top, batch, rows, thread)
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
            remains = behind(t, alpha)
            if remains < END:
                t = -t
            elif remains <= goal:
                found = lists[first + i]
                t = -t
            else:
                t = remains
    if inside:
        ranks[row_of, column_of] = found


def median(device: CudaDevice, *args: Any) -> None:
    """Find median splats, see `kernels.median.median`."""
    starts = args[1]
    _median[starts.shape[0] - 1, THREADS, device.stream](*args)
