"""Blocks of 4x4 pixels of a tile, as sixteen lanes, and the splats of a batch that touch them.

Lanes go down the columns of a block: lane 4 x + y is the pixel in column x and row y of it. What
differs by row only is then four numbers in memory, repeated.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from .batch import LEAST, LOOK
from .bins import SLACK, TILE, spans
from .jit import scalar
from .lanes import (
    WIDTH,
    bits,
    choose,
    floor,
    higher,
    lanes,
    load,
    lower,
    ramp,
    size,
    store,
    store_mixed,
)

CHANNELS = 4
SIDE = 4
"""Edge of a block [pixel]."""
ACROSS = TILE // SIDE
"""Blocks of a tile along each axis."""
BLOCKS = ACROSS * ACROSS
STATE = CHANNELS * TILE
"""Floats of a block's state: transmittance, red, green and blue of 16 pixels."""
MANY = 2 * LOOK
"""Splats per batch. The state of a block is read and written once for all."""

_QUAD = ir.VectorType(ir.FloatType(), SIDE)
_ALIGNMENT = 4
"""Alignment of loads, that of a float32 [byte]."""


# --- 1. lanes --------------------------------------------------------------------------


def _order(numbers: Any) -> Any:
    return ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), list(numbers))


@intrinsic
def repeated(typing: Any, source: Any, at: Any) -> Any:
    """Return four numbers that are `at` numbers after a place, four times: one load."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        where = builder.bitcast(builder.gep(args[0], [args[1]]), _QUAD.as_pointer())
        four = builder.load(where, align=_ALIGNMENT)
        return builder.shuffle_vector(four, four, _order(i % SIDE for i in range(WIDTH)))

    return lanes(source, types.uintp), emit


@intrinsic
def turned(typing: Any, numbers: Any) -> Any:
    """Return the lanes of a block in the order of its rows."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        order = _order(i % SIDE * SIDE + i // SIDE for i in range(WIDTH))
        return builder.shuffle_vector(args[0], args[0], order)

    return lanes(lanes), emit


config: Any = numba.config
if config.DISABLE_JIT:

    def repeated(source: Any, at: Any) -> Any:
        return np.tile(source[int(at) : int(at) + SIDE], WIDTH // SIDE)

    def turned(numbers: Any) -> Any:
        return numbers.reshape(SIDE, SIDE).T.ravel()


# --- 2. splats of a batch --------------------------------------------------------------


@scalar
def touched_rows(batch, found, count):
    """Find the rows that each splat touches in each column of blocks, as `blend.rows_touched` does.

    Args:
        batch: Fields of MANY splats.
        found: Receives for each column of blocks MANY first rows and MANY ends, whole numbers in
            f32. Splats from `count` on touch no row.
    """
    zero, one, most = np.float32(0), np.float32(1), np.float32(TILE - 1)
    for i in range(0, count, TILE):
        k = np.uint64(i)
        u, v = load(batch, k), load(batch, k + np.uint64(MANY))
        a, b = load(batch, k + np.uint64(2 * MANY)), load(batch, k + np.uint64(3 * MANY))
        c, log_opacity = load(batch, k + np.uint64(4 * MANY)), load(batch, k + np.uint64(5 * MANY))
        half = load(batch, k + np.uint64(6 * MANY))
        reach = (log_opacity - LEAST) * np.float32(2)
        for column in range(ACROSS):
            x, at = np.float32(column * SIDE), k + np.uint64(2 * MANY * column)
            lowest, highest = spans(
                c, b, a, reach, half, x - u - SLACK, x + np.float32(SIDE - 1) - u + SLACK
            )
            first = floor(higher(v + lowest, zero) + (one - SLACK))
            end = floor(higher(lower(v + highest + SLACK, most), -one) + one)
            store(found, at, first)
            store(found, at + np.uint64(MANY), choose(first < end, end, zero))
    for column in range(ACROSS):
        for i in range(count, (count + LOOK - 1) // LOOK * LOOK):
            found[np.uint64(2 * MANY * column + MANY + i)] = zero


@scalar
def touched_splats(found, base, top):
    """Return a mask of splats base..base+LOOK-1 that touch the block in rows top..top+SIDE-1.

    `found` is the part of the result of `touched_rows` for the block's column.
    """
    touched, bottom = np.uint64(0), top + np.float32(SIDE - 1)
    for i in range(0, LOOK, TILE):
        at = np.uint64(base + i)
        inside = (load(found, at) <= bottom) & (load(found, at + np.uint64(MANY)) > top)
        touched |= bits(inside) << np.uint64(i)
    return touched


@scalar
def columns(left):
    """Return x of the 16 pixels of a block whose first column is `left`."""
    return floor(ramp() * np.float32(1.0 / SIDE)) + left


@scalar
def rows(top):
    """Return y of the 16 pixels of a block whose first row is `top`."""
    return ramp() - floor(ramp() * np.float32(1.0 / SIDE)) * np.float32(SIDE) + top


@scalar
def lay_rows(batch, slopes, count):
    """Compute the linear and the constant part of each splat's exponent in each row of a tile.

    Args:
        batch: Fields of MANY splats.
        slopes: Receives 16 linear parts, then 16 constant ones, of each splat.
    """
    for k in range(count):
        i, at = np.uint64(k), np.uint64(2 * TILE * k)
        dy = ramp() - batch[i + np.uint64(MANY)]
        store(slopes, at, batch[i + np.uint64(3 * MANY)] * dy)
        rest = batch[i + np.uint64(4 * MANY)] * dy * dy + batch[i + np.uint64(5 * MANY)]
        store(slopes, at + np.uint64(TILE), rest)


# --- 3. pixels of a tile ---------------------------------------------------------------


@scalar
def begin_tile(state, live, x0, x1, y0, y1):
    """Let pixels of columns x0..x1-1 and rows y0..y1-1 of a tile be transparent, others saturated.

    `live` receives 1 for each block with such a pixel. Return their number.
    """
    alive = 0
    for k in range(BLOCKS):
        xs = columns(np.float32(k % ACROSS * SIDE))
        ys = rows(np.float32(k // ACROSS * SIDE))
        inside = (xs >= np.float32(x0)) & (xs < np.float32(x1))
        inside = inside & (ys >= np.float32(y0)) & (ys < np.float32(y1))
        store(state, np.uint64(k * STATE), choose(inside, np.float32(1), np.float32(0)))
        live[k] = 1 if bits(inside) != np.uint64(0) else 0
        alive += live[k]
    return alive


@scalar
def load_stops(occluder_depth, top, left, g, stop):
    """Copy the depths of surfaces in a tile, block after block, +inf outside the band. Return
    (minimum, maximum)."""
    least, most = np.float32(np.inf), np.float32(-np.inf)
    for k in range(BLOCKS * TILE):
        y = top + k // TILE // ACROSS * SIDE + k % SIDE
        x = left + k // TILE % ACROSS * SIDE + k % TILE // SIDE
        depth = np.float32(np.inf)
        if g.y0 <= y < g.y1 and g.x0 <= x < g.x1:
            depth = occluder_depth[y - g.y0, x - g.x0]
            least, most = min(least, depth), max(most, depth)
        stop[k] = depth
    return least, most


@scalar
def store_tile(state, image, top, left, y0, y1, x0, x1):
    """Write the pixels of a tile that lie in rows y0 to y1 - 1 and columns x0 to x1 - 1 of it."""
    one = np.float32(1)
    for k in range(BLOCKS):
        at = np.uint64(k * STATE)
        red, green = load(state, at + np.uint64(TILE)), load(state, at + np.uint64(2 * TILE))
        blue, coverage = load(state, at + np.uint64(3 * TILE)), one - size(load(state, at))
        store_mixed(state, at, turned(red), turned(green), turned(blue), turned(coverage))
    for y in range(y0, y1):
        row = image[top + y]
        for first in range(0, TILE, SIDE):
            k = y // SIDE * ACROSS + first // SIDE
            at = np.uint64(k * STATE + y % SIDE * SIDE * CHANNELS)
            to = np.int64((left + first) * CHANNELS)
            if x0 <= first and first + SIDE <= x1:
                store(row, np.uint64(to), load(state, at))
                continue
            begin, end = max(0, x0 - first) * CHANNELS, min(SIDE, x1 - first) * CHANNELS
            for c in range(begin, end):
                row[np.uint64(to + c)] = state[at + np.uint64(c)]
