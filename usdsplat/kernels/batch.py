"""Load a batch of a tile's list before it is drawn, in a layout for 16 lanes.

Loading many splats at once hides memory latency. The square roots of their spans are computed 16 at
a time.
"""

from __future__ import annotations

import numpy as np

from .bins import SLACK, TILE, spans
from .jit import scalar
from .lanes import bits, fetch, floor, higher, load, lower, store
from .project import HALF_HEIGHT, LOG_CUTOFF, LOG_OPACITY, RECORD, A, B, C, U, V
from .ray_hit import CENTER, REACH

LOOK = 32
"""Splats per batch. Saturated rows of a tile are detected once per batch."""
AHEAD = 3 * LOOK
"""Splats between prefetching a record and reading it. The prefetch runs while batches are drawn; it
reaches into the next tile's list."""
FIELDS = 7
"""Rows of LOOK floats: u v a b c ln(opacity) half-height, with exponents divided by 8. (u, v) is
relative to the tile. Paint follows them."""

SQUARINGS = 3
SHRINK = np.float32(1.0 / (1 << SQUARINGS))
"""Factor on exponents: 1/8. A short polynomial is accurate enough there, and the result is squared
three times."""
LEAST = LOG_CUTOFF * SHRINK
"""Scaled exponent below which a contribution is cut off."""


# --- 1. mathematics: 16 splats ----------------------------------------------------------


@scalar
def _touched_rows(batch, rows):
    """Find the rows of a tile that each splat of a batch touches: `blend.rows_touched`, 16 at a
    time.

    Args:
        batch: Fields of LOOK splats.
        rows: Receives the first row of each, then one past the last, whole numbers in f32.
    """
    zero, one, most = np.float32(0), np.float32(1), np.float32(TILE - 1)
    for i in range(0, LOOK, TILE):
        k = np.uint64(i)
        u, v = load(batch, k), load(batch, k + np.uint64(LOOK))
        a, b = load(batch, k + np.uint64(2 * LOOK)), load(batch, k + np.uint64(3 * LOOK))
        c, log_opacity = load(batch, k + np.uint64(4 * LOOK)), load(batch, k + np.uint64(5 * LOOK))
        half = load(batch, k + np.uint64(6 * LOOK))
        reach = (log_opacity - LEAST) * np.float32(2)
        lowest, highest = spans(c, b, a, reach, half, -u - SLACK, most - u + SLACK)
        store(rows, k, floor(higher(v + lowest, zero) + (one - SLACK)))
        store(
            rows, k + np.uint64(LOOK), floor(higher(lower(v + highest + SLACK, most), -one) + one)
        )


# --- 2. CPU ----------------------------------------------------------------------------


@scalar
def load_fields(records, lists, first, count, left, top, batch, look=LOOK):
    """Load `count` splats of a list.

    Args:
        left, top: Of the tile [pixel], f32.
        batch: Receives FIELDS rows of `look` floats.
    """
    for i in range(count):
        if first + i + AHEAD < lists.shape[0]:
            later = np.uint64(lists[np.uint64(first + i + AHEAD)]) * np.uint64(RECORD)
            fetch(records, later)
            fetch(records, later + np.uint64(RECORD - 1))
        k, j = np.uint64(lists[np.uint64(first + i)]), np.uint64(i)
        batch[j] = records[k, U] - left
        batch[j + np.uint64(look)] = records[k, V] - top
        batch[j + np.uint64(2 * look)] = records[k, A] * SHRINK
        batch[j + np.uint64(3 * look)] = records[k, B] * SHRINK
        batch[j + np.uint64(4 * look)] = records[k, C] * SHRINK
        batch[j + np.uint64(5 * look)] = records[k, LOG_OPACITY] * SHRINK
        batch[j + np.uint64(6 * look)] = records[k, HALF_HEIGHT]


@scalar
def load_batch(records, lists, first, count, left, top, batch, rows):
    """Load `count` splats of a list, and find the rows of this tile that each touches.

    Args:
        batch: Receives FIELDS rows of LOOK floats.
        rows: Receives the first row of each, then one past the last, whole numbers in f32.
    """
    load_fields(records, lists, first, count, left, top, batch)
    _touched_rows(batch, rows)


@scalar
def load_paints(paints, column, lists, first, count, batch, look=LOOK):
    """Load the paint of `count` splats of a list into a batch, whose rows have `look` floats."""
    for i in range(count):
        k, j, c = np.uint64(lists[np.uint64(first + i)]), np.uint64(i), np.uint64(column)
        batch[j + np.uint64(7 * look)] = paints[k, c]
        batch[j + np.uint64(8 * look)] = paints[k, c + np.uint64(1)]
        batch[j + np.uint64(9 * look)] = paints[k, c + np.uint64(2)]


@scalar
def lay_row(batch, rows, y, slopes):
    """Prepare a batch for row y of a tile: return a mask of the splats that touch it.

    `slopes` receives the linear and the constant part of each splat's exponent in the row.
    """
    touched = np.uint64(0)
    for i in range(0, LOOK, TILE):
        k = np.uint64(i)
        inside = (load(rows, k) <= y) & (load(rows, k + np.uint64(LOOK)) > y)
        touched |= bits(inside) << k
        dy = y - load(batch, k + np.uint64(LOOK))
        store(slopes, k, load(batch, k + np.uint64(3 * LOOK)) * dy)
        rest = load(batch, k + np.uint64(4 * LOOK)) * dy * dy + load(batch, k + np.uint64(5 * LOOK))
        store(slopes, k + np.uint64(LOOK), rest)
    return touched


@scalar
def load_occluder_depth(occluder_depth, top, left, g, stop):
    """Copy the depths of surfaces in a tile, +inf outside the band. Return (minimum, maximum)."""
    least, most = np.float32(np.inf), np.float32(-np.inf)
    for y in range(TILE):
        for x in range(TILE):
            depth = np.float32(np.inf)
            if g.y0 <= top + y < g.y1 and g.x0 <= left + x < g.x1:
                depth = occluder_depth[top + y - g.y0, left + x - g.x0]
                least, most = min(least, depth), max(most, depth)
            stop[y * TILE + x] = depth
    return least, most


@scalar
def behind_surfaces(ray_hits, lists, first, count, least, most):
    """Return two masks of a batch: splats with ray hits behind all surfaces of the tile, and behind
    some."""
    hidden, mixed = np.uint64(0), np.uint64(0)
    for i in range(count):
        k = np.uint64(lists[first + i])
        bit = np.uint64(1) << np.uint64(i)
        if ray_hits[k, CENTER] - ray_hits[k, REACH] > most:
            hidden |= bit
        elif ray_hits[k, CENTER] + ray_hits[k, REACH] > least:
            mixed |= bit
    return hidden, mixed


@scalar
def look(state, row_floats, live):
    """Mark the rows with a pixel that is not saturated. Return their number."""
    rows = 0
    for y in range(TILE):
        through = load(state, np.uint64(y * row_floats))
        live[y] = 1 if bits(through > np.float32(0)) != np.uint64(0) else 0
        rows += live[y]
    return rows
