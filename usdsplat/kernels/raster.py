"""Rasterize triangles: tiles of the fixed grid, with a depth buffer for each.

Triangles are listed by tile in their own order. A later one must be strictly nearer to win, so ties
of depth go to the lower triangle, independent of the thread count. If a triangle spans many tiles,
the range of columns in each row of tiles follows from its edges.

Source: Pineda 1988, "A parallel algorithm for polygon rasterization".
"""

from __future__ import annotations

import numpy as np
from numba import prange

from .bins import MOST_PAIRS, TILE, offsets
from .jit import launcher, parallel, scalar
from .triangles import Z, depth_from, depth_plane, edge, find, orientation

FEW = 2
"""Number of columns of tiles up to which all tiles of a triangle's box are listed without a
test."""
MARGIN = 1.0
"""Margin of tiles in the test [pixel]. An extra tile costs little, a missing one causes a hole."""


# --- 1. mathematics: one triangle -------------------------------------------------------


@scalar
def corners(appearances, firsts, vertex_firsts, triangles, vertices, t):
    """Return the three vertices of triangle t, counted through all appearances."""
    k = find(firsts, t)
    corner = triangles[t - firsts[k] + appearances[k].rows]
    base = vertex_firsts[k]
    return vertices[base + corner[0]], vertices[base + corner[1]], vertices[base + corner[2]]


@scalar
def edges_of(view, a, b, c):
    """Return the three edges, each opposite to its corner."""
    side = 1.0 if orientation(view, a, b, c) > 0.0 else -1.0
    return edge(view, b, c, side), edge(view, c, a, side), edge(view, a, b, side)


@scalar
def narrow(e, y0, y1, low, high):
    """Shorten the range [low, high] [pixel] by the part that is outside one edge in all rows y0 to
    y1."""
    best = max(e[1] * (y0 - MARGIN - e[3]), e[1] * (y1 + MARGIN - e[3])) + e[4]
    if e[0] > 0.0:
        low = max(low, e[2] - best / e[0] - MARGIN)
    elif e[0] < 0.0:
        high = min(high, e[2] - best / e[0] + MARGIN)
    elif best < 0.0:
        high = -np.inf
    return low, high


@scalar
def tiles_of(box, grid):
    """Return tile columns and rows of a box within the band: (first, end, first, end)."""
    x0, x1 = max(box[0], grid.x0), min(box[2], grid.x1)
    y0, y1 = max(box[1], grid.y0), min(box[3], grid.y1)
    if x0 >= x1 or y0 >= y1:
        return 0, 0, 0, 0
    return (
        (x0 - grid.left) // TILE, (x1 - 1 - grid.left) // TILE + 1,
        (y0 - grid.top) // TILE, (y1 - 1 - grid.top) // TILE + 1,
    )  # fmt: skip


@scalar
def columns_of(edges, row, first, end, grid):
    """Return the tile columns in first..end-1 that the triangle may touch in one row of tiles."""
    y0 = np.float64(grid.top + row * TILE)
    y1 = y0 + (TILE - 1)
    low = np.float64(grid.left + first * TILE)
    high = np.float64(grid.left + end * TILE - 1)
    low, high = narrow(edges[0], y0, y1, low, high)
    low, high = narrow(edges[1], y0, y1, low, high)
    low, high = narrow(edges[2], y0, y1, low, high)
    if not (low <= high):
        return first, first
    return (np.int64(low) - grid.left) // TILE, (np.int64(high) - grid.left) // TILE + 1


@scalar
def cover(view, a, b, c, t, x0, y0, x1, y1, left, top, depth, winner):
    """Draw one triangle into a tile: pixels x0..x1-1 of rows y0..y1-1, in order, if nearer."""
    (a0, b0, u0, v0, c0, least0), (a1, b1, u1, v1, c1, least1), (a2, b2, u2, v2, c2, least2) = (
        edges_of(view, a, b, c)
    )
    p, q, r = depth_plane(view, a, b, c)
    low, high = min(a[Z], b[Z], c[Z]), max(a[Z], b[Z], c[Z])
    for y in range(y0, y1):
        v = np.float64(y)
        row0, row1, row2 = b0 * (v - v0) + c0, b1 * (v - v1) + c1, b2 * (v - v2) + c2
        value = q * v + r
        at = (y - top) * TILE - left
        for x in range(x0, x1):
            u = np.float64(x)
            if (
                a0 * (u - u0) + row0 >= least0
                and a1 * (u - u1) + row1 >= least1
                and a2 * (u - u2) + row2 >= least2
            ):
                z = depth_from(view, p * u + value, low, high)
                near = np.float32(z)
                if view.near <= z <= view.far and near < depth[at + x]:
                    depth[at + x] = near
                    winner[at + x] = t


# --- 2. CPU ----------------------------------------------------------------------------


@parallel
def count(view, shapes, boxes, grid, chunks, counts):
    """Set counts[k, tile] to the number of triangles of chunk k that may touch the tile.

    Args:
        view: One VIEW record, shape (1,).
        shapes: (appearances, first triangles, first vertices, triangles, vertices), see
            `triangles.boxes`.
        boxes: Result of `triangles.boxes`.
        grid: One GRID record of `bins`, shape (1,).
        chunks: Number of chunks of the order; any number gives the same lists.
        counts: Shape (chunks, tiles + 1) i32; the last column is not used.
    """
    appearances, firsts, vertex_firsts, triangles, vertices = shapes
    n = boxes.shape[0]
    for k in prange(chunks):
        eye, g = view[0], grid[0]
        row = counts[k]
        row[:] = 0
        for t in range(n * k // chunks, n * (k + 1) // chunks):
            first, end, top, bottom = tiles_of(boxes[t], g)
            if end - first <= FEW:
                for y in range(top, bottom):
                    for x in range(first, end):
                        row[y * g.columns + x] += 1
            else:
                a, b, c = corners(appearances, firsts, vertex_firsts, triangles, vertices, t)
                edges = edges_of(eye, a, b, c)
                for y in range(top, bottom):
                    left, right = columns_of(edges, y, first, end, g)
                    for x in range(left, right):
                        row[y * g.columns + x] += 1


@parallel
def fill(view, shapes, boxes, grid, chunks, counts, lists):
    """Write each tile's list of triangles, i32, ascending. `counts` are offsets from
    `bins.offsets`.

    For other arguments see `count`.
    """
    appearances, firsts, vertex_firsts, triangles, vertices = shapes
    n = boxes.shape[0]
    for k in prange(chunks):
        eye, g = view[0], grid[0]
        row = counts[k]
        for t in range(n * k // chunks, n * (k + 1) // chunks):
            first, end, top, bottom = tiles_of(boxes[t], g)
            if end - first <= FEW:
                for y in range(top, bottom):
                    for x in range(first, end):
                        at = row[y * g.columns + x]
                        lists[at] = t
                        row[y * g.columns + x] = at + 1
            else:
                a, b, c = corners(appearances, firsts, vertex_firsts, triangles, vertices, t)
                edges = edges_of(eye, a, b, c)
                for y in range(top, bottom):
                    left, right = columns_of(edges, y, first, end, g)
                    for x in range(left, right):
                        at = row[y * g.columns + x]
                        lists[at] = t
                        row[y * g.columns + x] = at + 1


@launcher(gpu="raster.tile_lists")
def tile_lists(view, shapes, boxes, grid, tiles, chunks, get):
    """Make the list of triangles of each tile. The result is as in `bins.tile_lists`.

    Args:
        view, shapes, boxes, grid, chunks: See `count`.
        tiles: Number of tiles of the grid.
        get: Returns buffers by name, shape and dtype.
    """
    counts = get("surface counts", (chunks, tiles + 1), np.int32)
    starts = get("surface starts", (tiles + 1,), np.int64)
    count(view, shapes, boxes, grid, chunks, counts)
    pairs = offsets(counts, starts)
    lists = get("surface lists", (pairs if pairs <= MOST_PAIRS else 0,), np.int32)
    if pairs <= MOST_PAIRS:
        fill(view, shapes, boxes, grid, chunks, counts, lists)
    return starts, lists, int(pairs)


@parallel(writes=("depth", "winner"), gpu="raster.raster")
def raster(view, shapes, boxes, grid, starts, lists, depth, winner):
    """Find the nearest triangle of each pixel of a band.

    Args:
        view, shapes, boxes, grid: See `count`.
        starts, lists: The lists of all tiles.
        depth: Receives the planar camera depth [scene unit], +inf where nothing is, f32, shape
            (y1 - y0, x1 - x0).
        winner: Receives the triangle, counted through all appearances, -1 where nothing is, i32.
    """
    appearances, firsts, vertex_firsts, triangles, vertices = shapes
    for tile in prange(starts.shape[0] - 1):
        eye, g = view[0], grid[0]
        left = g.left + tile % g.columns * TILE
        top = g.top + tile // g.columns * TILE
        x0, x1 = max(left, g.x0), min(left + TILE, g.x1)
        y0, y1 = max(top, g.y0), min(top + TILE, g.y1)
        near = np.full(TILE * TILE, np.inf, np.float32)
        seen = np.full(TILE * TILE, -1, np.int32)
        for i in range(starts[tile], starts[tile + 1]):
            t = lists[i]
            box = boxes[t]
            a, b, c = corners(appearances, firsts, vertex_firsts, triangles, vertices, t)
            cover(
                eye, a, b, c, t, max(x0, box[0]), max(y0, box[1]), min(x1, box[2]),
                min(y1, box[3]), left, top, near, seen,
            )  # fmt: skip
        for y in range(y0, y1):
            at = (y - top) * TILE - left
            for x in range(x0, x1):
                depth[y - g.y0, x - g.x0] = near[at + x]
                winner[y - g.y0, x - g.x0] = seen[at + x]
