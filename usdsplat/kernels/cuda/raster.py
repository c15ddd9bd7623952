"""Rasterize triangles on a GPU. One thread per triangle lists it, then one thread per pixel of a
tile finds its nearest triangle."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import cuda

from usdsplat.kernels.bins import TILE
from usdsplat.kernels.cuda.device import THREADS as LIST_THREADS
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.lists import make_lists
from usdsplat.kernels.cuda.loops import BLOCKS
from usdsplat.kernels.cuda.tile import THREADS, origin
from usdsplat.kernels.raster import FEW, columns_of, corners, edges_of, tiles_of
from usdsplat.kernels.triangles import Z, depth_from, depth_plane

BATCH = 64
"""Number of triangles of a batch."""
EDGE, PLANE, LOW, HIGH = 0, 18, 21, 22
"""Offsets of a triangle in a batch: three edges of six numbers, the depth plane's three, the depths
of its nearest and its farthest corner."""
NUMBERS = 23


@kernel
def _touch(view, shapes, boxes, grid, writes, places, tiles, owners):
    """Count or write the pairs of a triangle, see `make_lists`. Counting and writing are one
    kernel, so that they agree."""
    appearances, firsts, vertex_firsts, triangles, vertices = shapes
    n = boxes.shape[0]
    for t in range(cuda.grid(1), n + 1, cuda.gridsize(1)):
        if t == n:
            if not writes:
                places[n] = 0
            continue
        g = grid[0]
        at = places[t] if writes else 0
        stop = places[t + 1] if writes else 0
        first, end, top, bottom = tiles_of(boxes[t], g)
        if first < end:
            a, b, c = corners(appearances, firsts, vertex_firsts, triangles, vertices, t)
            edges = edges_of(view[0], a, b, c)
            for y in range(top, bottom):
                left, right = first, end
                if end - first > FEW:
                    left, right = columns_of(edges, y, first, end, g)
                for x in range(left, right):
                    if at < stop:
                        tiles[at], owners[at] = y * g.columns + x, t
                    at += 1
        if not writes:
            places[t] = at
        for rest in range(at, stop):
            tiles[rest], owners[rest] = g.columns * g.rows, t


def tile_lists(
    device: CudaDevice,
    view: Any,
    shapes: Any,
    boxes: Any,
    grid: Any,
    tiles: int,
    _chunks: int,
    get: Callable[..., Any],
) -> tuple[Any, Any, int]:
    """Make the list of each tile, see `kernels.raster.tile_lists`."""

    def touch(writes: bool, places: Any, keys: Any, owners: Any) -> None:
        _touch[BLOCKS, LIST_THREADS, device.stream](
            view, shapes, boxes, grid, writes, places, keys, owners
        )

    return make_lists(device, get, "triangle", boxes.shape[0], tiles, touch)


@cuda.jit(device=True)
def _fetch(view, shapes, boxes, t, batch, box, i):
    """Write a triangle to index i of a batch."""
    appearances, firsts, vertex_firsts, triangles, vertices = shapes
    a, b, c = corners(appearances, firsts, vertex_firsts, triangles, vertices, t)
    first, second, third = edges_of(view, a, b, c)
    for k in range(6):
        batch[EDGE + k, i] = first[k]
        batch[EDGE + 6 + k, i] = second[k]
        batch[EDGE + 12 + k, i] = third[k]
    p, q, r = depth_plane(view, a, b, c)
    batch[PLANE, i], batch[PLANE + 1, i], batch[PLANE + 2, i] = p, q, r
    batch[LOW, i], batch[HIGH, i] = min(a[Z], b[Z], c[Z]), max(a[Z], b[Z], c[Z])
    for k in range(4):
        box[k, i] = boxes[t, k]


@cuda.jit(device=True)
def _is_in(batch, i, edge, u, v):
    """Return whether a pixel is on the inner side of one edge, see `raster.cover`."""
    k = EDGE + 6 * edge
    row = batch[k + 1, i] * (v - batch[k + 3, i]) + batch[k + 4, i]
    return batch[k, i] * (u - batch[k + 2, i]) + row >= batch[k + 5, i]


@kernel
def _raster(view, shapes, boxes, grid, starts, lists, depth, winner):
    batch = cuda.shared.array((NUMBERS, BATCH), np.float64)
    box = cuda.shared.array((4, BATCH), np.int32)
    tile, thread = cuda.blockIdx.x, cuda.threadIdx.x
    eye, g = view[0], grid[0]
    left, top = origin(g, tile)
    x, y = left + thread % TILE, top + thread // TILE
    u, v = np.float64(x), np.float64(y)
    inside = g.x0 <= x < g.x1 and g.y0 <= y < g.y1
    nearest, seen = np.float32(np.inf), np.int32(-1)
    begin, end = starts[tile], starts[tile + 1]
    for first in range(begin, end, BATCH):
        cuda.syncthreads()
        if thread < BATCH and first + thread < end:
            _fetch(eye, shapes, boxes, lists[first + thread], batch, box, thread)
        cuda.syncthreads()
        for i in range(min(BATCH, end - first)):
            if not (box[0, i] <= x < box[2, i] and box[1, i] <= y < box[3, i]):
                continue
            if (
                _is_in(batch, i, 0, u, v)
                and _is_in(batch, i, 1, u, v)
                and _is_in(batch, i, 2, u, v)
            ):
                value = batch[PLANE + 1, i] * v + batch[PLANE + 2, i]
                value = batch[PLANE, i] * u + value
                z = depth_from(eye, value, batch[LOW, i], batch[HIGH, i])
                near = np.float32(z)
                if eye.near <= z <= eye.far and near < nearest:
                    nearest, seen = near, lists[first + i]
    if inside:
        depth[y - g.y0, x - g.x0] = nearest
        winner[y - g.y0, x - g.x0] = seen


def raster(device: CudaDevice, *args: Any) -> None:
    """Find the nearest triangle of each pixel, see `kernels.raster.raster`."""
    starts = args[4]
    _raster[starts.shape[0] - 1, THREADS, device.stream](*args)
