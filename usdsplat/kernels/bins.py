"""Bin splats to tiles: exact spans of an ellipse over rows of tiles.

For each row of tiles that a splat crosses, the range of columns that it touches follows in closed
form from the ellipse at which a contribution falls under 1/255. No tile is tested individually.
These crossings are distributed to the rows of tiles, and those of a row to its tiles, each by a
stable counting sort of the depth order. Every tile's list is therefore in depth order. (Direct
distribution to all tiles takes twice as long: there are more tiles than lines in the fastest
cache.)
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import prange

from .jit import launcher, parallel, scalar, serial
from .lanes import choose, floor, higher, load, lower, root, store
from .project import HALF_HEIGHT, HALF_WIDTH, LOG_CUTOFF, LOG_OPACITY, A, B, C, U, V

TILE = 16
"""Edge of a tile [pixel]. Tiles lie on a fixed grid of the display window, so crops, bands and
overscan see the same tiles as the full frame."""

CHUNK = 8
"""Loop items that a thread takes at a time, see `device`."""

MOST_PAIRS = np.iinfo(np.int32).max
"""Maximum number of pairs of a tile and a splat or triangle in one band."""

SLACK = np.float32(1.0 / 64.0)
"""Margin of every span [pixel], so that float32 rounding loses no pixel above the cutoff."""


# --- 1. mathematics: one splat ---------------------------------------------------------


@scalar
def span(a, b, c, reach, half, low, high):
    """Return the extent along one axis of the ellipse a x² + b x y + c y² >= −reach/2, for y in
    [low, high].

    `half` is the ellipse's half extent in x. Return (lowest, highest) x relative to the centre;
    highest is −inf if no point lies in the strip. Swap a and c for the other axis. Both branches of
    every choice are computed, so that loops can be vectorised and nothing is mispredicted.
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
def spans(a, b, c, reach, half, low, high):
    """Return `span` of 16 splats."""
    zero, two, none = np.float32(0), np.float32(2), np.float32(-np.inf)
    inverse = np.float32(0.5) / a
    tip = -b * half / (two * c)
    bend, shift = two * c * reach / (half * half), two * a * reach
    y = lower(high, higher(low, tip))
    square = bend * y * y - shift
    crossing = (-b * y - root(higher(square, zero))) * inverse
    highest = choose(y == tip, half, choose(square >= zero, crossing, none))
    y = lower(high, higher(low, -tip))
    square = bend * y * y - shift
    crossing = (-b * y + root(higher(square, zero))) * inverse
    return choose(y == -tip, -half, crossing), highest


@scalar
def tiles_between(lowest, highest, origin, first, end):
    """Return the first tile, and one past the last, with a pixel in [lowest, highest] [pixel].

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
    """Return the first row of tiles, and one past the last, that the splat may touch."""
    v, half = record[V], record[HALF_HEIGHT]
    return tiles_between(v - half, v + half, grid.top, grid.y0, grid.y1)


@scalar
def tile_columns(record, row, grid):
    """Return the first column of tiles, and one past the last, that the splat touches in tile row
    `row`."""
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
    align=True,  # otherwise a GPU reads it byte by byte
)  # fmt: skip
"""A band of the data window [pixel], end exclusive; the edge of its first tile; its numbers of
tiles."""


def grid_of(x0: int, y0: int, x1: int, y1: int) -> npt.NDArray[Any]:
    """Return the GRID record of a band, shape (1,)."""
    left, top = x0 // TILE * TILE, y0 // TILE * TILE
    columns, rows = -(-(x1 - left) // TILE), -(-(y1 - top) // TILE)
    return np.array([(x0, y0, x1, y1, left, top, columns, rows)], GRID)


def tiles_in(grid: npt.NDArray[Any]) -> int:
    """Return the number of tiles of a GRID record."""
    return int(grid["columns"][0] * grid["rows"][0])


# --- 2. CPU ----------------------------------------------------------------------------


@serial
def offsets(counts, starts):
    """Convert counts to the offsets at which each chunk writes. Return the number of all pairs.

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
def count_rows(records, grid, counts):
    """Set counts[t, y] to the number of splats of chunk t that may touch row y of tiles.

    Args:
        records: Depth-ordered splats, shape (n, RECORD).
        grid: One GRID record, shape (1,).
        counts: Shape (chunks, rows + 1) i64, the last column scratch; any number of chunks gives
            the same lists.
    """
    n, chunks = records.shape[0], counts.shape[0]
    for t in prange(chunks):
        g = grid[0]
        row = counts[t]
        row[:] = 0
        for k in range(n * t // chunks, n * (t + 1) // chunks):
            at = np.uint64(k)  # unsigned indices need no test for negative ones
            v, half = records[at, V], records[at, HALF_HEIGHT]
            first, end = tiles_between(v - half, v + half, g.top, g.y0, g.y1)
            if first < end:
                row[np.uint64(first)] += 1
                row[np.uint64(end)] -= 1
        total = 0
        for y in range(counts.shape[1]):
            total += row[y]
            row[y] = total


@serial
def row_places(counts, ends):
    """Convert counts to the offsets at which each chunk writes its spans of each row of tiles.

    Args:
        counts: Result of `count_rows`; becomes offsets.
        ends: Receives the end of each row's spans, shape (rows,) i64.
    """
    place = 0
    for y in range(ends.shape[0]):
        for t in range(counts.shape[0]):
            here = counts[t, y]
            counts[t, y] = place
            place += here
        ends[y] = place
    return place


@scalar
def _column_spans(fields, g):
    """Convert the values of 16 crossings to the first column of tiles, and one past the last."""
    one, tile = np.float32(1), np.float32(TILE)
    u, y = load(fields, np.uint64(0)), load(fields, np.uint64(TILE))
    a, b = load(fields, np.uint64(2 * TILE)), load(fields, np.uint64(3 * TILE))
    c, reach = load(fields, np.uint64(4 * TILE)), load(fields, np.uint64(5 * TILE))
    lowest, highest = spans(
        a, b, c, reach, load(fields, np.uint64(6 * TILE)), y - SLACK, y + (tile - one + SLACK)
    )
    origin = np.float32(g.left)
    low = floor(higher(u + lowest, np.float32(g.x0)) - origin + (one - SLACK))
    high = floor(lower(u + highest + SLACK, np.float32(g.x1 - 1)) - origin)
    shrink = one / tile
    is_touched = (low <= high) & (high >= np.float32(0))
    store(fields, np.uint64(0), choose(is_touched, floor(low * shrink), np.float32(0)))
    store(fields, np.uint64(TILE), choose(is_touched, floor(high * shrink) + one, np.float32(0)))


@parallel
def find_spans(records, grid, counts, crossings):
    """Find the columns of tiles that each splat touches in each row of tiles that it crosses.

    Args:
        counts: Result of `row_places`; changed.
        crossings: Receives, row after row of tiles and in depth order there, the splat and both
            ends of its columns: shape (places, 2) i32, first | end << 16.
    """
    n, chunks = records.shape[0], counts.shape[0]
    for t in prange(chunks):
        g = grid[0]
        fields = np.ones(7 * TILE, np.float32)
        splats, rows = np.empty(TILE, np.int32), np.empty(TILE, np.int32)
        waiting = 0
        places = counts[t]
        last = n * (t + 1) // chunks
        for k in range(n * t // chunks, last + 1):
            first, end = np.int32(0), np.int32(0)
            splat = np.uint64(k)
            if k < last:
                v, half = records[splat, V], records[splat, HALF_HEIGHT]
                first, end = tiles_between(v - half, v + half, g.top, g.y0, g.y1)
            # once more at the end, for the rest
            for y in range(first, end if k < last else np.int32(1)):
                if k < last:
                    j = np.uint64(waiting)
                    splats[j], rows[j] = k, y
                    fields[j] = records[splat, U]
                    fields[j + np.uint64(TILE)] = np.float32(g.top + y * TILE) - records[splat, V]
                    fields[j + np.uint64(2 * TILE)] = records[splat, A]
                    fields[j + np.uint64(3 * TILE)] = records[splat, B]
                    fields[j + np.uint64(4 * TILE)] = records[splat, C]
                    reach = np.float32(2) * (records[splat, LOG_OPACITY] - LOG_CUTOFF)
                    fields[j + np.uint64(5 * TILE)] = reach
                    fields[j + np.uint64(6 * TILE)] = records[splat, HALF_WIDTH]
                    waiting += 1
                    if waiting < TILE:
                        continue
                _column_spans(fields, g)
                for i in range(waiting):
                    j = np.uint64(i)
                    left, right = np.int32(fields[j]), np.int32(fields[j + np.uint64(TILE)])
                    row = np.uint64(rows[j])
                    at = np.uint64(places[row])
                    places[row] += 1
                    crossings[at, 0] = splats[j]
                    crossings[at, 1] = left | right << np.int32(16)
                waiting = 0


@parallel
def count_columns(crossings, ends, columns, counts):
    """Set counts[tile] to the number of splats that touch the tile.

    Only the ends of each span are marked, +1 and -1. A running sum along the row yields the counts.

    Args:
        crossings, ends: Results of `find_spans` and `row_places`.
        columns: Number of columns of tiles.
        counts: Shape (rows, columns + 1) i32; the last column is scratch.
    """
    for item in prange(ends.shape[0] * CHUNK):
        if item % CHUNK != 0:  # one row is as much work as a thread takes at a time
            continue
        y = item // CHUNK
        row = counts[y]
        row[:] = 0
        for k in range(ends[y - 1] if y > 0 else 0, ends[y]):
            both = crossings[np.uint64(k), 1]
            row[np.uint64(both & 0xFFFF)] += 1
            row[np.uint64(both >> 16)] -= 1
        total = 0
        for x in range(columns):
            total += row[x]
            row[x] = total


@parallel
def fill_tiles(crossings, ends, starts, counts, lists):
    """Write each tile's list of splats (rows of the records, i32) in depth order.

    Args:
        crossings, ends: See `count_columns`.
        starts: First pair of each tile, shape (tiles + 1,) i64.
        counts: Scratch, shape (rows, columns + 1) i32.
    """
    for item in prange(ends.shape[0] * CHUNK):
        if item % CHUNK != 0:
            continue
        y = item // CHUNK
        row, columns = counts[y], counts.shape[1] - 1
        for x in range(columns):
            row[x] = starts[y * columns + x]
        for k in range(ends[y - 1] if y > 0 else 0, ends[y]):
            splat, both = crossings[np.uint64(k), 0], crossings[np.uint64(k), 1]
            for x in range(both & 0xFFFF, both >> 16):
                at = row[np.uint64(x)]
                lists[np.uint64(at)] = splat
                row[np.uint64(x)] = at + 1


@serial
def tile_starts(counts, starts):
    """Set starts[tile] to the pairs of all tiles before it, shape (tiles + 1,). Return the number
    of all pairs."""
    columns = counts.shape[1] - 1
    starts[0] = 0
    for tile in range(starts.shape[0] - 1):
        starts[tile + 1] = starts[tile] + counts[tile // columns, tile % columns]
    return starts[starts.shape[0] - 1]


@launcher(gpu="bins.tile_lists")
def tile_lists(records, grid, tiles, chunks, get):
    """Make the list of each tile.

    Args:
        records: Depth-ordered splats, shape (n, RECORD).
        grid: One GRID record, shape (1,).
        tiles: Number of tiles of the grid.
        chunks: Number of chunks of the depth order; any number gives the same lists.
        get: Returns buffers by name, shape and dtype.

    Returns:
        (starts, lists, pairs): the first pair of each tile, shape (tiles + 1,) i64, rows of
        `records` in order, shape (pairs,) i32, and the number of pairs. Beyond MOST_PAIRS there are
        no lists.
    """
    columns = int(grid["columns"][0])
    rows = tiles // columns
    places = get("row places", (chunks, rows + 1), np.int64)
    ends = get("row ends", (rows,), np.int64)
    count_rows(records, grid, places)
    crossings = get("crossings", (row_places(places, ends), 2), np.int32)
    find_spans(records, grid, places, crossings)
    counts = get("counts", (rows, columns + 1), np.int32)
    starts = get("starts", (tiles + 1,), np.int64)
    count_columns(crossings, ends, columns, counts)
    pairs = tile_starts(counts, starts)
    lists = get("lists", (pairs if pairs <= MOST_PAIRS else 0,), np.int32)
    if pairs <= MOST_PAIRS:
        fill_tiles(crossings, ends, starts, counts, lists)
    return starts, lists, int(pairs)
