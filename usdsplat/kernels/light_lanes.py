"""Evaluate the casters in front of receivers sixteen at a time, for receivers of one tile together.

The casters of a tile are copied into lanes once, as far as a receiver asks for them. Each receiver
multiplies sixteen products, so what it gets does not depend on the receivers beside it.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import prange
from numba.core import types
from numba.extending import intrinsic

from .batch import SHRINK
from .bins import TILE, tiles_in
from .blend import exponential, ray_hits_at
from .casters import CASTER, HIT, LABEL, NEAREST
from .jit import launcher, parallel, scalar, serial
from .lanes import WIDTH, choose, fetch, lanes, load, lower, spread
from .launch import chunk_of, kernel
from .lighting import (
    ALL_FACES,
    MOST_ALPHA,
    OPAQUE,
    arriving,
    face_of,
    illuminate,
    spread_along,
)
from .position import apply
from .project import LOG_CUTOFF, LOG_OPACITY, A, B, C, U, V
from .ray_hit import CENTER, GX, GY, HX, HY, HZ, REACH, SPREAD, row_at

SPOT = 4
"""Floats of a receiver in the picture of a light: u, v [pixel], depth, standard deviation along the
view."""
NO_THROUGH = np.empty(0, np.float32)
NOWHERE = -1
"""Tile of a receiver that no caster of a list shadows, or that has no light."""
AHEAD = 16
"""Casters between prefetching a record and reading it."""
FIELDS = LABEL
"""Floats of a caster in lanes."""
RECEIVERS = 1 << 18
"""Receivers that are sorted by tile at a time: a Z-order curve leaves few tiles to be loaded
twice."""


# --- 1. lanes --------------------------------------------------------------------------


@intrinsic
def product(typing: Any, a: Any) -> Any:
    """Return the product of all 16 lanes, of halves of the lanes in turn."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        rest, half = args[0], WIDTH // 2
        while half:
            order = ir.VectorType(ir.IntType(32), half)
            low = builder.shuffle_vector(rest, rest, ir.Constant(order, list(range(half))))
            high = ir.Constant(order, list(range(half, 2 * half)))
            rest = builder.fmul(low, builder.shuffle_vector(rest, rest, high))
            half //= 2
        return builder.extract_element(rest, ir.IntType(32)(0))

    return types.float32(lanes), emit


config: Any = numba.config
if config.DISABLE_JIT:

    def product(a: Any) -> Any:
        while len(a) > 1:
            a = a[: len(a) // 2] * a[len(a) // 2 :]
        return a[0]


# --- 2. mathematics: sixteen casters ----------------------------------------------------


@scalar
def passed(fields, at, u, v, depth, sigma, is_parallel):
    """Return the factors of 16 casters on the transmittance to a receiver.

    Args:
        fields: Casters in lanes, the 16 from index `at` on.
        u, v, depth, sigma: See SPOT.
    """
    one, zero = np.float32(1), np.float32(0)
    dx, dy = u - column(fields, at, U), v - column(fields, at, V)
    power = column(fields, at, LOG_OPACITY) + (
        column(fields, at, A) * dx * dx
        + column(fields, at, B) * dx * dy
        + column(fields, at, C) * dy * dy
    )
    first, second, third = row_at(
        column(fields, at, HIT + HX), column(fields, at, HIT + HY), column(fields, at, HIT + HZ), dy
    )
    hit = ray_hits_at(
        dx, column(fields, at, HIT + GX), column(fields, at, HIT + GY), first, second, third,
        column(fields, at, HIT + CENTER), column(fields, at, HIT + REACH), is_parallel,
    )  # fmt: skip
    beyond, both = depth - hit, column(fields, at, HIT + SPREAD) + sigma
    beyond = beyond - both
    ramp = lower(beyond / (both + both), spread(one))
    alpha = lower(exponential(lower(power, spread(zero)) * SHRINK), spread(MOST_ALPHA))
    counts = (power >= LOG_CUTOFF) & (beyond > zero)
    return one - choose(counts, alpha * ramp, zero)


@scalar
def column(fields, at, name):
    """Return the same number of 16 casters, as 16 lanes.

    Args:
        fields: Casters of a list in lanes, see `load_casters`.
        at: Place of the first of the 16.
        name: Column of the number, see `casters`.
    """
    return load(fields, np.uint64(at) + np.uint64(name * TILE))


# --- 3. CPU ----------------------------------------------------------------------------


@scalar
def load_casters(casters, casts, own, lists, first, count, fields, at):
    """Copy up to 16 casters of a list into lanes.

    Args:
        casters, casts, own: See `lighting.illuminate`.
        lists: The casters are those from index `first` on.
        count: Number of casters that are left; lanes without a caster are transparent.
        fields: Receives FIELDS floats of each from index `at` on.
    """
    for j in range(TILE):
        place = np.uint64(at + j)
        if j >= count:
            for c in range(FIELDS):
                fields[place + np.uint64(c * TILE)] = np.float32(0)
            fields[place + np.uint64(LOG_OPACITY * TILE)] = -np.float32(np.inf)
            continue
        if first + j + AHEAD < lists.shape[0]:
            fetch(casters, np.uint64(lists[np.uint64(first + j + AHEAD)]) * np.uint64(CASTER))
        k = np.uint64(lists[np.uint64(first + j)])
        for c in range(FIELDS):
            fields[place + np.uint64(c * TILE)] = casters[k, c]
        label = np.int64(casters[k, LABEL])
        if label == own or casts[label] == 0:
            fields[place + np.uint64(LOG_OPACITY * TILE)] = -np.float32(np.inf)


@kernel(over="points", writes=("spots", "where"))
def locate(
    i, light, points, normals, shapes, prims, lit, world_to_screen, views, grid, spots, where
):
    """Find the tile of a receiver that has light, and its place in the picture.

    Args:
        light, points, normals, shapes, prims, lit, world_to_screen, views: See
            `lighting.illuminate`.
        grid: GRID record of the tiles.
        spots: Receives SPOT floats, shape (n, SPOT) f32.
        where: Receives the tile, or NOWHERE, shape (n,) i32.
    """
    where[i] = NOWHERE
    prim = 0
    if prims.shape[0] > 0:
        prim = prims[i]
    if prim < 0 or lit[prim] == 0:
        return
    one, view, g = light[0], views[0], grid[0]
    px, py, pz = points[i, 0], points[i, 1], points[i, 2]
    if one.face != ALL_FACES and face_of(px - one.x, py - one.y, pz - one.z) != one.face:
        return
    red, green, blue = arriving(one, px, py, pz, normals[i])
    if not (red + green + blue > np.float32(0)):
        return
    x, y, z = apply(world_to_screen, px, py, pz)
    if not (view.is_parallel or z > 0.0):
        return
    scale = 1.0 if view.is_parallel else z
    u, v = view.fx * (x / scale) + view.cx, view.fy * (y / scale) + view.cy
    column, row = math.floor(u + 0.5) - g.left, math.floor(v + 0.5) - g.top
    if not (column >= 0 and row >= 0 and column < g.columns * TILE and row < g.rows * TILE):
        return
    where[i] = np.int64(row) // TILE * g.columns + np.int64(column) // TILE
    spots[i, 0], spots[i, 1], spots[i, 2] = np.float32(u), np.float32(v), np.float32(z)
    spots[i, 3] = np.float32(0)
    if shapes.shape[0] > 0:
        spots[i, 3] = spread_along(world_to_screen, shapes[i])


@serial
def group(where, firsts, order):
    """Sort receivers by tile, stably.

    Args:
        where: Result of `locate`.
        firsts: Receives the first place of each tile in `order`, and the number of receivers in
            tiles, shape (tiles + 1,) i32.
        order: Receives the receivers, shape (n,) i32.
    """
    firsts[:] = 0
    for i in range(where.shape[0]):
        if where[i] != NOWHERE:
            firsts[where[i]] += 1
    total = np.int32(0)
    for tile in range(firsts.shape[0]):
        total += firsts[tile]
        firsts[tile] = total
    for back in range(where.shape[0]):
        i = where.shape[0] - 1 - back
        tile = where[i]
        if tile != NOWHERE:
            firsts[tile] -= 1
            order[firsts[tile]] = i


@parallel
def pass_tiles(spots, firsts, order, own, is_parallel, splats, tiles, through):
    """Find the transmittance of the splats to the receivers of each tile.

    Args:
        spots: Result of `locate`; firsts, order: results of `group`.
        own, splats, tiles: See `lighting.illuminate`.
        through: Receives it, shape (n,) f32; unchanged for other receivers.
    """
    casters, casts = splats
    starts, lists, _ = tiles
    for tile in prange(firsts.shape[0] - 1):
        if firsts[tile] == firsts[tile + 1]:
            continue
        begin, n = starts[tile], starts[tile + 1] - starts[tile]
        fields = np.empty((n + TILE - 1) // TILE * (TILE * FIELDS), np.float32)
        loaded = 0
        for r in range(firsts[tile], firsts[tile + 1]):
            i = np.uint64(order[r])
            u, v, depth, sigma = spots[i, 0], spots[i, 1], spots[i, 2], spots[i, 3]
            front, whole, seen = depth - sigma, spread(np.float32(1)), np.float32(1)
            for k in range(0, n, TILE):
                at = k * FIELDS
                if k == loaded:
                    load_casters(casters, casts, own, lists, begin + k, n - k, fields, at)
                    loaded += TILE
                if not (fields[np.uint64(at + NEAREST * TILE)] < front):
                    break
                whole = whole * passed(fields, at, u, v, depth, sigma, is_parallel)
                seen = product(whole)
                if seen < OPAQUE:
                    seen = np.float32(0)
                    break
            through[i] = seen


@launcher(writes=("sums",), gpu="light_lanes.shine")
def shine(
    light, points, normals, shapes, prims, lit, own, world_to_screen, views, splats, tiles, depths,
    get, sums,
):  # fmt: skip
    """Add the light of one sample to receivers.

    Args:
        get: Returns buffers by name, shape and dtype.
        light, points, normals, shapes, prims, lit, own, world_to_screen, views, splats, tiles,
            depths, sums: See `lighting.illuminate`.
    """
    for first in range(0, len(points), RECEIVERS):
        part = slice(first, first + RECEIVERS)
        some = (
            points[part], normals[part], shapes[part] if len(shapes) else shapes,
            prims[part] if len(prims) else prims, lit,
        )  # fmt: skip
        through = NO_THROUGH
        if len(splats[0]) and light["casts"][0] and not light["distance"][0] >= 0:
            n, grid = len(some[0]), tiles[-1]
            spots, where = get("spots", (n, SPOT), np.float32), get("where", (n,), np.int32)
            _run(locate, light, *some, world_to_screen, views, grid, spots, where)
            firsts = get("firsts", (tiles_in(grid) + 1,), np.int32)
            order, through = get("order", (n,), np.int32), get("through", (n,), np.float32)
            group(where, firsts, order)
            through[:] = 1
            is_parallel = int(views["is_parallel"][0])
            pass_tiles(spots, firsts, order, own, is_parallel, splats, tiles, through)
        _run(
            illuminate, light, *some, own, world_to_screen, views, splats, tiles, depths, through,
            sums[part],
        )  # fmt: skip


def _run(kernel, *args):
    """Run a kernel in the midst of a launch, with chunks for its own number of items."""
    before = numba.get_parallel_chunksize()
    numba.set_parallel_chunksize(chunk_of(kernel, kernel.size(args), numba.get_num_threads()))
    kernel.on_cpu(args)
    numba.set_parallel_chunksize(before)
