"""Process a tile on a GPU: a block of threads, one for each pixel, with splats of its list in
batches.

Each thread loads one splat of a batch into shared memory, and computes the rows that it touches.
Then each thread processes all of them for its own pixel.
"""

from __future__ import annotations

import numpy as np
from numba import cuda

from usdsplat.kernels.bins import TILE
from usdsplat.kernels.blend import SHRINK, rows_touched
from usdsplat.kernels.cuda.falloff import TO_BITS, along_row, contribution, exponent
from usdsplat.kernels.project import HALF_HEIGHT, LOG_OPACITY, A, B, C, U, V
from usdsplat.kernels.ray_hit import CENTER, GX, GY, HX, HY, HZ, REACH, ray_hit_at, row_at

THREADS = TILE * TILE
BATCH = THREADS
"""Number of splats of a batch."""
FIELDS, RAY_HITS = 6, 7
"""Numbers per splat in a batch, and per ray hit."""


@cuda.jit(device=True)
def origin(g, tile):
    """Return the first column and row of a tile [pixel]."""
    return g.left + tile % g.columns * TILE, g.top + tile // g.columns * TILE


@cuda.jit(device=True)
def fetch_splat(records, rank, left, top, batch, rows, i):
    """Write a splat to index i of a batch, and the rows of the tile that it touches.

    u and v are relative to the tile, other values are scaled for `falloff`.
    """
    s = records[rank]
    u, v = s[U] - np.float32(left), s[V] - np.float32(top)
    a, b, c, log_opacity = s[A], s[B], s[C], s[LOG_OPACITY]
    batch[0, i], batch[1, i] = u, v
    batch[2, i], batch[3, i], batch[4, i] = a * TO_BITS, b * TO_BITS, c * TO_BITS
    batch[5, i] = log_opacity * TO_BITS
    rows[0, i], rows[1, i] = rows_touched(
        a * SHRINK, b * SHRINK, c * SHRINK, log_opacity * SHRINK, s[HALF_HEIGHT], u, v
    )


@cuda.jit(device=True)
def fetch_ray_hit(ray_hits, rank, shape, i):
    """Write a splat's ray hit to index i of a batch."""
    for k in range(RAY_HITS):
        shape[k, i] = ray_hits[rank, k]


@cuda.jit(device=True)
def alpha_in(batch, i, x, y):
    """Return the contribution of splat i of a batch to pixel (x, y) of the tile."""
    rest, slope = along_row(np.float32(x) - batch[0, i], batch[2, i], batch[3, i], batch[5, i])
    return contribution(exponent(np.float32(y) - batch[1, i], batch[4, i], slope, rest))


@cuda.jit(device=True)
def alpha_of(records, rank, left, top, x, y):
    """Return the contribution of any splat to pixel (x, y) of the tile, as `alpha_in` does."""
    s = records[rank]
    dx, dy = np.float32(x) - (s[U] - np.float32(left)), np.float32(y) - (s[V] - np.float32(top))
    rest, slope = along_row(dx, s[A] * TO_BITS, s[B] * TO_BITS, s[LOG_OPACITY] * TO_BITS)
    return contribution(exponent(dy, s[C] * TO_BITS, slope, rest))


@cuda.jit(device=True)
def depth_in(batch, shape, i, x, y, is_parallel):
    """Return the depth at which the ray of pixel (x, y) hits splat i of a batch."""
    dy = np.float32(y) - batch[1, i]
    first, second, third = row_at(shape[HX, i], shape[HY, i], shape[HZ, i], dy)
    return ray_hit_at(
        np.float32(x) - batch[0, i], shape[GX, i], shape[GY, i], first, second, third,
        shape[CENTER, i], shape[REACH, i], is_parallel,
    )  # fmt: skip


@cuda.jit(device=True)
def is_hidden(batch, shape, i, x, y, stop, is_parallel):
    """Return whether the ray of pixel (x, y) hits splat i of a batch behind the depth `stop`."""
    if shape[CENTER, i] + shape[REACH, i] <= stop:
        return False
    if shape[CENTER, i] - shape[REACH, i] > stop:
        return True
    return not (depth_in(batch, shape, i, x, y, is_parallel) <= stop)
