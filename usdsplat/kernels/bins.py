"""Which splats touch which tile: exact spans of an ellipse over rows of tiles.

For each row of tiles a splat crosses, the stretch of columns it touches there follows in closed
form from the ellipse at which a contribution falls under 1/255; no tile is tested one by one. Lists
are filled by a stable counting scatter over the depth order, so every tile's list is in that order.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import prange

from .jit import parallel, scalar, serial
from .project import HALF_HEIGHT, HALF_WIDTH, LOG_CUTOFF, LOG_OPACITY, A, B, C, U, V

TILE = 16
"""Edge of a tile [pixel]. Tiles lie on a fixed grid of the display window, so crops, bands and
overscan see the same tiles as the full frame."""

MOST_PAIRS = np.iinfo(np.int32).max
"""Of a tile and what touches it, that one band may have."""

SLACK = np.float32(1.0 / 64.0)
"""[pixel] Added to every span: float32 may not lose a pixel that the cutoff itself would keep."""


# --- 1. mathematics: one splat ---------------------------------------------------------


@scalar
def span(a, b, c, reach, half, low, high):
    """Extent along one axis of the ellipse a x² + b x y + c y² >= −reach/2, over y in [low, high].

    `half` is the ellipse's half extent in x. Returns (lowest, highest) x relative to the centre;
    highest is −inf when nothing lies in the strip. Swap a and c for the other axis. Both sides of
    every choice are computed: a loop of this is vectorised, and nothing is mispredicted.
    """
    zero, two = np.float32(0), np.float32(2)
    inverse = np.float32(0.5) / a
    # the point of largest x lies at y = −b x / 2c; by symmetry the smallest at its opposite
    tip = -b * half / (two * c)
    # b² − 4ac, from the half extent: the plain difference cancels for long thin splats
    bend, shift = two * c * reach / (half * half), two * a * reach
    y = min(high, max(low, tip))
    root = bend * y * y - shift
    crossing = (-b * y - math.sqrt(max(root, zero))) * inverse
    highest = half if y == tip else crossing
    highest = highest if root >= zero or y == tip else np.float32(-np.inf)
    y = min(high, max(low, -tip))
    root = bend * y * y - shift
    crossing = (-b * y + math.sqrt(max(root, zero))) * inverse
    lowest = -half if y == -tip else crossing
    return lowest, highest


@scalar
def tiles_between(lowest, highest, origin, first, end):
    """First and one past the last tile with a pixel in [lowest, highest]; all in pixels.

    `origin` is the edge of tile 0, and pixels first..end-1 exist. int() cuts towards zero: of
    x >= 0 it is the floor, and of x + 1 − slack the ceiling of x − slack.
    """
    one = np.float32(1)
    low = max(lowest, np.float32(first)) - np.float32(origin) + (one - SLACK)
    high = min(highest + SLACK, np.float32(end - 1)) - np.float32(origin)
    if not (low <= high + one and high >= np.float32(0)):
        return np.int32(0), np.int32(0)
    a, b = np.int32(low), np.int32(high)
    return a // np.int32(TILE), (b // np.int32(TILE) + np.int32(1)) if a <= b else np.int32(0)


@scalar
def tile_rows(record, grid):
    """First and one past the last row of tiles that the splat may touch."""
    v, half = record[V], record[HALF_HEIGHT]
    return tiles_between(v - half, v + half, grid.top, grid.y0, grid.y1)


@scalar
def tile_columns(record, row, grid):
    """First and one past the last column of tiles that the splat touches in tile row `row`."""
    y = np.float32(grid.top + row * TILE) - record[V]
    reach = np.float32(2) * (record[LOG_OPACITY] - LOG_CUTOFF)
    lowest, highest = span(
        record[A], record[B], record[C], reach, record[HALF_WIDTH],
        y - SLACK, y + np.float32(TILE - 1) + SLACK,
    )  # fmt: skip
    return tiles_between(record[U] + lowest, record[U] + highest, grid.left, grid.x0, grid.x1)


GRID = np.dtype(
    [
        ("x0", "i4"), ("y0", "i4"), ("x1", "i4"), ("y1", "i4"),
        ("left", "i4"), ("top", "i4"), ("columns", "i4"), ("rows", "i4"),
    ],
    align=True,  # else a GPU reads it byte by byte
)  # fmt: skip
"""A band of the data window [pixel], end exclusive; where its first tile begins; its tiles."""


def grid_of(x0: int, y0: int, x1: int, y1: int) -> npt.NDArray[Any]:
    """The GRID record of a band, shape (1,)."""
    left, top = x0 // TILE * TILE, y0 // TILE * TILE
    columns, rows = -(-(x1 - left) // TILE), -(-(y1 - top) // TILE)
    return np.array([(x0, y0, x1, y1, left, top, columns, rows)], GRID)


def tiles_in(grid: npt.NDArray[Any]) -> int:
    """How many tiles a GRID record has."""
    return int(grid["columns"][0] * grid["rows"][0])


# --- 2. CPU ----------------------------------------------------------------------------


@parallel
def count_tiles(records, grid, chunks, counts):
    """counts[t, tile] = splats of chunk t that touch the tile.

    Only the ends of each span are marked, +1 and -1; a running sum along the row makes counts of
    them.

    Args:
        records: Depth-ordered splats, shape (n, RECORD).
        grid: One GRID record, shape (1,).
        chunks: Pieces of the order; any number gives the same lists.
        counts: Shape (chunks, tiles + 1) i32; the last column is scratch.
    """
    n = records.shape[0]
    for t in prange(chunks):
        g = grid[0]
        row = counts[t]
        row[:] = 0
        for k in range(n * t // chunks, n * (t + 1) // chunks):
            s = records[k]
            first, end = tile_rows(s, g)
            for y in range(first, end):
                left, right = tile_columns(s, y, g)
                if left < right:
                    row[y * g.columns + left] += 1
                    row[y * g.columns + right] -= 1
        # a span that ends at the last column marks the next row's first, where the sum is still
        # right
        total = 0
        for tile in range(g.columns * g.rows):
            total += row[tile]
            row[tile] = total


@serial
def offsets(counts, starts):
    """Turn counts into the place where each chunk writes; returns the number of all pairs.

    Args:
        counts: Shape (chunks, tiles + 1) i32; becomes places in the lists (all pairs < 2**31).
        starts: Receives the first pair of each tile, shape (tiles + 1,) i64.
    """
    tiles = starts.shape[0] - 1
    starts[:] = 0
    for t in range(counts.shape[0]):
        for tile in range(tiles):
            here = counts[t, tile]
            counts[t, tile] = starts[tile + 1]
            starts[tile + 1] += here
    for tile in range(tiles):
        starts[tile + 1] += starts[tile]
    for t in range(counts.shape[0]):
        for tile in range(tiles):
            counts[t, tile] += np.int32(starts[tile])
    return starts[tiles]


@parallel
def fill_tiles(records, grid, chunks, counts, lists):
    """Write each tile's list of splats (rows of `records`, i32) in depth order."""
    n = records.shape[0]
    for t in prange(chunks):
        g = grid[0]
        row = counts[t]
        for k in range(n * t // chunks, n * (t + 1) // chunks):
            s = records[k]
            first, end = tile_rows(s, g)
            for y in range(first, end):
                left, right = tile_columns(s, y, g)
                for tile in range(y * g.columns + left, y * g.columns + right):
                    at = row[tile]
                    lists[at] = k
                    row[tile] = at + 1


def tile_lists(records, grid, tiles, chunks, get):
    """Make the list of each tile.

    Args:
        records, grid, chunks: Those of `count_tiles`.
        tiles: How many the grid has.
        get: Makes buffers by name, shape and dtype.

    Returns:
        (starts, lists, pairs): the first pair of each tile, shape (tiles + 1,) i64, rows of
        `records` in order, shape (pairs,) i32, and the number of pairs. Beyond MOST_PAIRS there are
        no lists.
    """
    counts = get("counts", (chunks, tiles + 1), np.int32)
    starts = get("starts", (tiles + 1,), np.int64)
    count_tiles(records, grid, chunks, counts)
    pairs = offsets(counts, starts)
    lists = get("lists", (pairs if pairs <= MOST_PAIRS else 0,), np.int32)
    if pairs <= MOST_PAIRS:
        fill_tiles(records, grid, chunks, counts, lists)
    return starts, lists, int(pairs)
