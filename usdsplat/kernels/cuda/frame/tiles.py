"""Make the tile lists: pairs of tile and splat, in order of depth, then sorted by tile.

One thread processes a splat that crosses few rows of tiles. Splats of more rows are processed by a
warp, four at a time, with a lane for each row. A splat that touches many tiles would keep its team
busy while all others wait: `fill` lists such splats, and `fill_many` processes each with a warp.
"""

from __future__ import annotations

import numpy as np
from numba import cuda, float32, int32, uint64

from usdsplat.kernels.bins import MOST_PAIRS, tile_columns, tile_rows
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.ties import limit
from usdsplat.kernels.cuda.vectors import load4
from usdsplat.kernels.cuda.warp import FULL, LANES, running, votes, without_lowest
from usdsplat.kernels.project import (
    HALF_HEIGHT,
    HALF_WIDTH,
    LOG_OPACITY,
    RECORD,
    A,
    B,
    C,
    U,
    V,
)

F4 = np.uint64(4)
FEW = 2
"""Maximum number of rows of tiles of a splat that one thread processes."""
TEAM = 8
"""Number of lanes that share a splat of more rows."""
MANY = 32
"""Number of tiles above which a whole warp processes a splat."""


@cuda.jit(device=True, inline="always")
def chosen(crowd, team):
    """Return the lane whose splat team `team` processes: the set bit of this number in `crowd`; -1
    if there is none."""
    for _ in range(team):
        crowd = without_lowest(crowd)
    return int32(cuda.ffs(crowd)) - int32(1)


@cuda.jit(device=True, inline="always")
def without_four(crowd):
    """Return `crowd` without the lanes whose splats the teams have processed."""
    for _ in range(LANES // TEAM):
        crowd = without_lowest(crowd)
    return crowd


@cuda.jit(device=True, inline="always")
def footprint(records, row, shape):
    """Read the values that determine a splat's tiles: the first floats of its record, 8 f32."""
    at = uint64(row) * uint64(RECORD)
    shape[U], shape[V], shape[A], shape[B] = load4(records, at)
    shape[C], shape[LOG_OPACITY], shape[HALF_WIDTH], shape[HALF_HEIGHT] = load4(records, at + F4)


@kernel
def count(totals, grid, records, counts):
    """Count the tiles of each of the `totals[0]` splats, and of all of them in `totals[1]`.

    `totals[3]` is set to 1 if the sum is more than MOST_PAIRS, the largest number that `totals` can
    store.

    records: (room * RECORD,) f32. counts: receives numbers of tiles, (room,) i32.
    """
    g = grid[0]
    n = min(totals[0], counts.shape[0])
    shape = cuda.local.array(8, float32)
    lane = cuda.threadIdx.x % LANES
    k = cuda.grid(1)
    first_of_warp = k - lane
    total = int32(0)
    while first_of_warp < n:
        rows, first, found = int32(0), int32(0), int32(0)
        if k < n:
            footprint(records, k, shape)
            first, end = tile_rows(shape, g)
            rows = int32(end - first)
        if rows <= FEW:
            for y in range(first, first + rows):
                a, b = tile_columns(shape, y, g)
                found += int32(max(b - a, 0))
        crowd = votes(int32(rows > FEW))
        while crowd != 0:
            one = chosen(crowd, lane // TEAM)
            crowd = without_four(crowd)
            begin = cuda.shfl_sync(FULL, first, max(one, int32(0)))
            stop = begin + cuda.shfl_sync(FULL, rows, max(one, int32(0)))
            own = int32(0)
            if one >= 0:
                footprint(records, first_of_warp + one, shape)
                y = begin + lane % TEAM
                while y < stop:
                    a, b = tile_columns(shape, y, g)
                    own += int32(max(b - a, 0))
                    y += TEAM
            for shift in (4, 2, 1):
                own += cuda.shfl_xor_sync(FULL, own, shift)
            if one >= 0 and lane % TEAM == 0:
                counts[first_of_warp + one] = own
                total += own
        if k < n and rows <= FEW:
            counts[k] = found
        total += found
        k += cuda.gridsize(1)
        first_of_warp += cuda.gridsize(1)
    for shift in (16, 8, 4, 2, 1):
        total += cuda.shfl_xor_sync(FULL, total, shift)
    if lane == 0 and total > 0:
        before = cuda.atomic.add(totals, 1, total)
        if before > int32(MOST_PAIRS) - total:
            totals[3] = 1


@cuda.jit(device=True, inline="always")
def pad_pairs(at, stop, row, nothing, pair_tiles, pair_splats):
    """Write pairs of tile `nothing` for missing pairs."""
    while at < stop:
        pair_tiles[at], pair_splats[at] = nothing, row
        at += 1


@kernel
def fill(
    totals, grid, records, order, places, tiles, nothing, pair_tiles, pair_splats, crowded
):  # fmt: skip
    """Write the pairs of all splats of up to MANY tiles, in order of depth, and pad the rest.

    Args:
        order: Row of each rank in `records`, (m,) i32.
        places: First pair of each rank, (m + 1,) i32, from the numbers of `count`. Two kernels may
            round an edge differently: a missing pair is written as one of tile `nothing`, and a
            surplus pair is dropped. Pairs beyond the capacity are dropped, too.
        tiles: Tiles in a row of the grid.
        pair_tiles, pair_splats: Receive each pair's tile and row in `records`.
        crowded: Receives the ranks of splats of more than MANY tiles, (m,) i32, and `totals[2]`
            their number. Their order does not matter, as `places` determines where their pairs are
            written.
    """
    g = grid[0]
    n = min(totals[0], places.shape[0] - 1)
    room = int32(pair_tiles.shape[0])
    lane, member = cuda.threadIdx.x % LANES, cuda.threadIdx.x % TEAM
    k = cuda.grid(1)
    beyond = totals[1] + k
    while beyond < room:
        pair_tiles[beyond] = nothing
        beyond += cuda.gridsize(1)
    if k - lane >= n:
        return
    shape = cuda.local.array(8, float32)
    rows, first, row, at, stop = int32(0), int32(0), int32(0), int32(0), int32(0)
    if k < n:
        row, at, stop = order[k], places[k], min(places[k + 1], room)
        footprint(records, row, shape)
        first, end = tile_rows(shape, g)
        rows = int32(end - first)
        if stop - at > MANY:
            crowded[cuda.atomic.add(totals, 2, 1)] = k
            rows, stop = int32(0), at
    if rows <= FEW:
        for y in range(first, first + rows):
            a, b = tile_columns(shape, y, g)
            for tile in range(y * tiles + a, y * tiles + b):
                if at < stop:
                    pair_tiles[at], pair_splats[at] = tile, row
                    at += 1
        pad_pairs(at, stop, row, nothing, pair_tiles, pair_splats)
    crowd = votes(int32(rows > FEW))
    while crowd != 0:
        one = chosen(crowd, lane // TEAM)
        crowd = without_four(crowd)
        source = max(one, int32(0))
        y = cuda.shfl_sync(FULL, first, source)
        end = y + cuda.shfl_sync(FULL, rows, source)
        y += member
        its_row = cuda.shfl_sync(FULL, row, source)
        its_stop = cuda.shfl_sync(FULL, stop, source)
        its_at = cuda.shfl_sync(FULL, at, source)
        if one < 0:
            end = y
        else:
            footprint(records, its_row, shape)
        while votes(int32(y - member < end)) != 0:
            a, b = int32(0), int32(0)
            if y < end:
                a, b = tile_columns(shape, y, g)
            own = int32(max(b - a, 0))
            up_to = own
            for shift in (1, 2, 4):
                other = cuda.shfl_up_sync(FULL, up_to, shift)
                if member >= shift:
                    up_to += other
            # All lanes of a team write adjacent pairs, whichever rows these belong to.
            leader = lane - member
            total = cuda.shfl_sync(FULL, up_to, leader + TEAM - 1)
            corner = int32(y * tiles + a - (up_to - own))
            p = int32(member)
            while votes(int32(p < total)) != 0:
                its = int32(0)
                for step in (4, 2, 1):
                    if cuda.shfl_sync(FULL, up_to, leader + its + step - 1) <= p:
                        its += int32(step)
                tile = cuda.shfl_sync(FULL, corner, min(leader + its, LANES - 1)) + p
                if p < total and its_at + p < its_stop:
                    pair_tiles[its_at + p], pair_splats[its_at + p] = tile, its_row
                p += TEAM
            its_at += total
            y += TEAM
        if one >= 0 and member == 0:
            pad_pairs(its_at, its_stop, its_row, nothing, pair_tiles, pair_splats)


@kernel
def fill_many(
    totals, grid, records, order, places, tiles, nothing, pair_tiles, pair_splats, crowded
):  # fmt: skip
    """Write the pairs of the splats in `crowded`, with a warp for each: one row of tiles at a
    time."""
    g = grid[0]
    lane = cuda.threadIdx.x % LANES
    room = int32(pair_tiles.shape[0])
    shape = cuda.local.array(8, float32)
    item = cuda.grid(1) // LANES
    while item < totals[2]:
        k = crowded[item]
        row, at, stop = order[k], places[k], min(places[k + 1], room)
        footprint(records, row, shape)
        y, end = tile_rows(shape, g)
        while y < end:
            a, b = int32(0), int32(0)
            if y + lane < end:
                a, b = tile_columns(shape, y + lane, g)
            width, up_to = int32(max(b - a, 0)), int32(0)
            up_to = running(width, lane)
            corner, begin = int32((y + lane) * tiles + a), int32(at + up_to - width)
            for r in range(min(LANES, end - y)):
                wide = cuda.shfl_sync(FULL, width, r)
                tile, to = cuda.shfl_sync(FULL, corner, r), cuda.shfl_sync(FULL, begin, r)
                x = int32(lane)
                while x < wide and to + x < stop:
                    pair_tiles[to + x], pair_splats[to + x] = tile + x, row
                    x += LANES
            at += cuda.shfl_sync(FULL, up_to, LANES - 1)
            y += LANES
        if lane == 0:
            pad_pairs(at, stop, row, nothing, pair_tiles, pair_splats)
        item += cuda.gridsize(1) // LANES


@kernel
def bound(totals, pair_tiles, starts):
    """Set starts[tile] to the first pair of the tile, (tiles + 1,) i32.

    Each thread searches for one.
    """
    tile = cuda.grid(1)
    if tile < starts.shape[0]:
        n = min(totals[1], pair_tiles.shape[0])
        starts[tile] = limit(pair_tiles, n, tile, False)
