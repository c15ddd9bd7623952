"""Walk through the contributions to each pixel on a GPU, with one thread for each pixel of a tile.

Where pixels have orders of their own, a block walks a quarter of a tile, whose list `ray_order`
makes, and each thread has a window: contributions that wait until no splat still to come may be in
front of them. Windows are in shared memory. Where one overflows, the quarter is walked again by
blocks of fewer threads, whose windows are longer, and at last with windows in the GPU's memory that
hold the longest list. So the order is exact.

A median needs the coverage of its pixel, so it takes a second walk.

Source: Radl et al. 2024, "StopThePop", for the order.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import cuda

from usdsplat.kernels import feature
from usdsplat.kernels.bins import TILE
from usdsplat.kernels.blend import END
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.falloff import behind
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.prims import number_prims, strongest
from usdsplat.kernels.cuda.ray_order import QUARTERS, SIDE, ray_order
from usdsplat.kernels.cuda.tile import (
    BATCH,
    FIELDS,
    RAY_HITS,
    THREADS,
    alpha_in,
    alpha_of,
    depth_in,
    fetch_ray_hit,
    fetch_splat,
    is_hidden,
    origin,
)
from usdsplat.kernels.project import DEPTH, RED
from usdsplat.kernels.walk import (
    ALBEDO,
    COLOR,
    COUNT,
    DEPTHS,
    FILL,
    FRONT,
    HALF,
    MEDIAN,
    NORMALS,
    WEIGH,
    held_through,
)
from usdsplat.kernels.weigh import NONE

SUMS = 10
"""Sums of a pixel over contributions: colour, albedo and normal, and from DEPTH_SUM on depth."""
DEPTH_SUM = 9
STATE = 6
THROUGH, COVER, GOAL, FOUND_AT, SEEN, RUN = range(STATE)
"""Numbers of a pixel: transmittance; coverage so far and coverage to find; depth of the splat
found; transmittance of its deep samples so far, and weight of the run that is merged."""
SPLAT, SAMPLES = 0, 1
"""Integers of a pixel: rank of the splat found, number of deep samples."""
FLUSH = 8
"""Number of splats between two passes over the windows."""
RAY_BATCH = 32
"""Number of splats of a batch where windows need the shared memory."""
FEW_ROWS = SIDE // 2
"""Rows of a quarter that a block walks where windows overflow."""
SLOTS, MORE_SLOTS = 40, 224
"""Contributions that a window holds at first, and then. The windows of a block take 15 and 42 KiB
of shared memory: 6 bytes of each contribution, for depth and place in the list."""
MOST_PLACES = 1 << 16
"""Number of places that fit into such a window."""
FAR_ENTRY = 8
"""Bytes of a contribution in a window in the GPU's memory."""
ROOM = 1 << 30
"""Bytes of all windows in memory together, unless one block needs more."""
BLOCKS = 132 * 4
"""Number of blocks that a GPU runs at once."""
MANY_PRIMS = 256
"""Number of prims of a scene from which the longest list bounds those of a tile."""
NO_UNITS = np.empty(0, np.int32)
NO_ORDER = np.empty(0, np.int64), NO_UNITS, np.empty(0, np.float32)
STEP = 4
"""Lists of a group differ in length by less than this factor."""


@cuda.jit(device=True)
def _take(wants, error, rank, alpha, depth, pixel, thread, numbers, paints, prims, holdout, deep):
    """Process a contribution as `kernels.walk` does. Return whether the pixel goes on."""
    state, sums, marks = numbers
    records, features, keeps = paints
    labels, known, table = prims
    hold_offsets, hold_depths, hold_through = holdout
    t = state[THROUGH]
    weight = alpha * t
    remains = behind(t, alpha)
    if remains < END:
        return False
    state[THROUGH] = remains
    if keeps.shape[0] > 0:
        weight *= keeps[rank]
    if hold_offsets.shape[0] > 0:
        weight *= held_through(hold_offsets, hold_depths, hold_through, pixel, depth)
    if weight <= np.float32(0):
        return True
    state[COVER] += weight
    if wants & COLOR:
        for c in range(3):
            sums[c] += weight * records[rank, RED + c]
    if wants & ALBEDO:
        for c in range(3):
            sums[3 + c] += weight * features[rank, feature.ALBEDO + c]
    if wants & NORMALS:
        for c in range(3):
            sums[6 + c] += weight * features[rank, feature.NORMAL + c]
    if wants & DEPTHS:
        sums[DEPTH_SUM] += weight * depth
    if wants & WEIGH:
        table[known[labels[rank]], thread] += weight
    if wants & FRONT and marks[SPLAT] < 0:
        marks[SPLAT], state[FOUND_AT] = rank, depth
    if wants & MEDIAN and state[COVER] >= state[GOAL]:
        marks[SPLAT], state[FOUND_AT] = rank, depth
        return False
    if wants & (COUNT | FILL):
        offsets, near, far, color = deep
        seen, run = state[SEEN], state[RUN]
        own = min(weight / seen, np.float32(1))
        state[SEEN] = seen - seen * own
        begins = run <= np.float32(0) or run + weight > error
        state[RUN] = weight if begins else run + weight
        if begins:
            marks[SAMPLES] += 1
        if wants & FILL:
            at = offsets[pixel] + marks[SAMPLES] - 1
            if begins:
                near[at] = depth
                for c in range(4):
                    color[at, c] = np.float32(0)
            far[at] = depth
            part = (np.float32(1) - color[at, 3]) * own
            for c in range(3):
                color[at, c] += part * records[rank, RED + c]
            color[at, 3] += part
    return True


@cuda.jit(device=True)
def _held_at_stop(holdout, pixel, stop):
    """Return what a deep holdout lets through of a surface at depth `stop`."""
    offsets, depths, through = holdout
    if offsets.shape[0] == 0:
        return np.float32(1)
    return held_through(offsets, depths, through, pixel, stop)


@cuda.jit(device=True)
def _is_before(depth, place, other_depth, other, ranks, begin):
    """Return whether a contribution is in front of another one; equal depths go by rank."""
    if depth == other_depth:
        return ranks[begin + place] < ranks[begin + other]
    return depth < other_depth


@cuda.jit(device=True)
def _insert(window, thread, head, held, depth, place, ranks, begin):
    """Insert a contribution into a sorted window, a ring that begins at `head`."""
    depths, places = window
    last = depths.shape[0] - 1
    at = head + held
    at = at - depths.shape[0] if at > last else at
    for _ in range(held):
        before = at - 1 if at > 0 else last
        front, waiting = depths[before, thread], places[before, thread]
        if _is_before(front, waiting, depth, place, ranks, begin):
            break
        depths[at, thread], places[at, thread] = front, waiting
        at = before
    depths[at, thread], places[at, thread] = depth, place


@cuda.jit(device=True)
def _push(window, thread, held, depth, place, ranks, begin):
    """Insert a contribution into a long window, a binary heap of `held` contributions."""
    depths, places = window
    at = held
    while at > 0:
        above = (at - 1) >> 1
        front, waiting = depths[above, thread], places[above, thread]
        if _is_before(front, waiting, depth, place, ranks, begin):
            break
        depths[at, thread], places[at, thread] = front, waiting
        at = above
    depths[at, thread], places[at, thread] = depth, place


@cuda.jit(device=True)
def _pop(window, thread, held, ranks, begin):
    """Remove the first contribution of a binary heap of `held` contributions."""
    depths, places = window
    last = held - 1
    depth, place = depths[last, thread], places[last, thread]
    at, below = 0, 1
    while below < last:
        front, waiting = depths[below, thread], places[below, thread]
        if below + 1 < last:
            other, its_place = depths[below + 1, thread], places[below + 1, thread]
            if _is_before(other, its_place, front, waiting, ranks, begin):
                below, front, waiting = below + 1, other, its_place
        if _is_before(depth, place, front, waiting, ranks, begin):
            break
        depths[at, thread], places[at, thread] = front, waiting
        at, below = below, 2 * below + 1
    depths[at, thread], places[at, thread] = depth, place


@cuda.jit(device=True)
def _store(wants, row, column, pixel, stop, numbers, keeps, holdout, occluded, out):
    """Write what the walk has found for a pixel."""
    state, sums, marks = numbers
    color, albedo, normals, depths, through, median, front, counts = out
    if wants & COLOR:
        for c in range(3):
            color[row, column, c] = sums[c]
        color[row, column, 3] = state[COVER]
        through[row, column] = state[THROUGH]
    if wants & ALBEDO:
        for c in range(3):
            albedo[row, column, c] = sums[3 + c]
        albedo[row, column, 3] = state[COVER]
    if wants & NORMALS:
        for c in range(3):
            normals[row, column, c] = sums[6 + c]
        normals[row, column, 3] = state[COVER]
    if wants & DEPTHS:
        depths[row, column, 0] = sums[DEPTH_SUM]
        depths[row, column, 1] = depths[row, column, 2] = np.float32(0)
        depths[row, column, 3] = state[COVER]
    if wants & FRONT:
        front[0][row, column], front[1][row, column] = marks[SPLAT], state[FOUND_AT]
    if wants & MEDIAN:
        median[0][row, column], median[1][row, column] = marks[SPLAT], state[FOUND_AT]
    if wants & COUNT:
        counts[row, column] = marks[SAMPLES]
    if wants & FILL and occluded and (keeps.shape[0] > 0 or holdout[0].shape[0] > 0):
        beyond = state[THROUGH] / state[SEEN] * _held_at_stop(holdout, pixel, stop)
        through[row, column] = min(beyond, np.float32(1))


def _block_walk(
    width: int,
    height: int,
    size: int,
    *,
    sorts: bool,
    is_long: bool = False,
    only_color: bool = False,
) -> Any:
    """Return a device function that walks pixels of a tile, with a thread for each.

    Args:
        width, height: Number of columns and rows.
        size: Number of splats of a batch.
        sorts: Whether pixels are sorted by their ray hits.
        is_long: Whether windows are heaps, which are faster if many contributions wait.
        only_color: Whether only COLOR is asked for, of splats alone.
    """
    ends = size + 1

    @cuda.jit(device=True)
    def walk_block(
        window, tile, first_pixel, listed, options, records, features, keeps, labels, starts,
        lists, grid, ray_hits, occluder_depth, covered, holdout, out, firsts, ranks, bounds, known,
        names, table,
    ):  # fmt: skip
        """Walk the pixels from `first_pixel` of the tile on, as (column, row), and `listed` splats,
        as (first place, number). Return whether a window overflowed: then nothing is written."""
        color, albedo, normals, sums_out, through, median, front, ids, counts, offsets, deep = out
        batch = cuda.shared.array((FIELDS, size), np.float32)
        shape = cuda.shared.array((RAY_HITS, size), np.float32)
        rows = cuda.shared.array((2, size), np.int32)
        chosen = cuda.shared.array(size, np.int32)
        least = cuda.shared.array(ends, np.float32)
        state = cuda.local.array(STATE, np.float32)
        sums = cuda.local.array(SUMS, np.float32)
        marks = cuda.local.array(2, np.int32)
        numbers = state, sums, marks
        thread = cuda.threadIdx.x
        x, y = first_pixel[0] + thread % width, first_pixel[1] + thread // width
        g = grid[0]
        given, _, is_parallel, _, error, near = options
        wants = COLOR if only_color else given
        has_occluders = not only_color and occluder_depth.shape[0] > 0
        left, top = origin(g, tile)
        column, row = left + x - g.x0, top + y - g.y0
        inside = g.x0 <= left + x < g.x1 and g.y0 <= top + y < g.y1
        begin, n = listed
        pixel = row * (g.x1 - g.x0) + column
        prims = 0
        if wants & WEIGH:
            of_tile = starts[tile + 1] - starts[tile]
            prims = number_prims(lists, labels, starts[tile], of_tile, known, names, thread)
            for j in range(prims):
                table[j, thread] = np.float32(0)
        for k in range(STATE):
            state[k] = np.float32(0)
        for k in range(SUMS):
            sums[k] = np.float32(0)
        state[THROUGH] = state[SEEN] = np.float32(1)
        marks[SPLAT], marks[SAMPLES] = NONE, np.int32(0)
        alive, overflows = inside, False
        stop = occluder_depth[row, column] if has_occluders and inside else np.float32(np.inf)
        if wants & (MEDIAN | FRONT):
            state[FOUND_AT] = np.float32(1)
        if wants & MEDIAN and inside:
            whole = color[row, column, 3]
            alive = whole > np.float32(0)
            if covered.shape[0] > 0 and covered[row, column] == 1:
                whole += through[row, column] * _held_at_stop(holdout, pixel, stop)
            state[GOAL] = whole * HALF
        splats, prim_arrays = (records, features, keeps), (labels, known, table)
        samples = offsets, deep[0], deep[1], deep[2]
        waiting_depths, places = window
        slots = waiting_depths.shape[0]
        head, held = np.int32(0), np.int32(0)
        for first in range(0, n, size):
            if cuda.syncthreads_count(np.int32(alive)) == 0:
                break
            filled = min(size, n - first)
            for i in range(thread, filled, width * height):
                rank = ranks[begin + first + i] if sorts else lists[begin + first + i]
                chosen[i] = rank
                fetch_splat(records, rank, left, top, batch, rows, i)
                if sorts:
                    least[i] = bounds[begin + first + i]
                if sorts or has_occluders:
                    fetch_ray_hit(ray_hits, rank, shape, i)
            if sorts and thread == 0:
                is_last = first + filled == n
                least[filled] = np.float32(np.inf) if is_last else bounds[begin + first + filled]
            cuda.syncthreads()
            for i in range(filled):
                if not alive:
                    break
                if rows[0, i] <= y < rows[1, i]:
                    alpha = alpha_in(batch, i, x, y)
                    goes_in = alpha > np.float32(0)
                    if goes_in and has_occluders:
                        goes_in = not is_hidden(batch, shape, i, x, y, stop, is_parallel)
                    if goes_in and sorts:
                        if held == slots or first + i >= MOST_PLACES:
                            overflows, alive = True, False
                            break
                        depth = depth_in(batch, shape, i, x, y, is_parallel)
                        depth = min(max(depth, near), stop)
                        if is_long:
                            _push(window, thread, held, depth, first + i, ranks, begin)
                        else:
                            _insert(window, thread, head, held, depth, first + i, ranks, begin)
                        held += np.int32(1)
                    elif goes_in:
                        depth = min(records[chosen[i], DEPTH], stop)
                        alive = _take(
                            wants, error, chosen[i], alpha, depth, pixel, thread, numbers, splats,
                            prim_arrays, holdout, samples,
                        )  # fmt: skip
                if sorts and (i % FLUSH == FLUSH - 1 or i == filled - 1):
                    while alive and held > 0:
                        depth = waiting_depths[head, thread]
                        if depth >= least[i + 1]:
                            break
                        rank = ranks[begin + places[head, thread]]
                        alpha = alpha_of(records, rank, left, top, x, y)
                        alive = _take(
                            wants, error, rank, alpha, depth, pixel, thread, numbers, splats,
                            prim_arrays, holdout, samples,
                        )  # fmt: skip
                        if is_long:
                            _pop(window, thread, held, ranks, begin)
                        else:
                            head = head + np.int32(1) if head < slots - 1 else np.int32(0)
                        held -= np.int32(1)
        if sorts and cuda.syncthreads_count(np.int32(overflows)) > 0:
            return True
        if inside:
            if wants & WEIGH:
                strongest(table, prims, thread, names, ids[0], ids[1], row, column)
            images = color, albedo, normals, sums_out, through, median, front, counts
            _store(
                wants, row, column, pixel, stop, numbers, keeps, holdout, has_occluders,
                images,
            )  # fmt: skip
        return False

    return walk_block


_WALK_TILE = _block_walk(TILE, TILE, BATCH, sorts=False)


@kernel
def _walk_lists(options, arrays, prims):
    """Walk tiles in the order of their lists."""
    known, names, table = prims
    starts = arrays[4]
    none = cuda.local.array((1, 1), np.float32)
    no_places = cuda.local.array((1, 1), np.int32)
    block = cuda.blockIdx.x
    room = min(block, known.shape[0] - 1)
    for tile in range(block, starts.shape[0] - 1, cuda.gridDim.x):
        cuda.syncthreads()
        listed = starts[tile], starts[tile + 1] - starts[tile]
        _WALK_TILE(
            (none, no_places), tile, (0, 0), listed, options, *arrays, known[room], names[room],
            table[room],
        )  # fmt: skip


def _ray_walk(name: str, parent: int, height: int, slots: int, *, only_color: bool = False) -> Any:
    """Return the kernel that walks rows of quarters of tiles in the order of ray hits.

    Args:
        parent: Number of rows of the units that it is given.
        height: Number of rows that a block walks.
        slots: Contributions that a window in shared memory holds; 0 if windows are in the GPU's
            memory.
        only_color: See `_block_walk`.
    """
    walk_block = _block_walk(
        SIDE, height, RAY_BATCH, sorts=True, is_long=height < SIDE, only_color=only_color
    )
    threads, parts, units_of_quarter = SIDE * height, parent // height, SIDE // parent
    size = slots, threads

    def place_of(k, units):
        """Return quarter and part of it that is walked as the k-th."""
        unit = units[k // parts] if units.shape[0] > 0 else k // parts
        return unit // units_of_quarter, unit % units_of_quarter * parts + k % parts

    def walk_part(quarter, part, window, options, arrays, known, names, table):
        firsts = arrays[12]
        of_tile = quarter % QUARTERS
        first_pixel = of_tile % 2 * SIDE, of_tile // 2 * SIDE + part * height
        listed = firsts[quarter], firsts[quarter + 1] - firsts[quarter]
        return walk_block(
            window, quarter // QUARTERS, first_pixel, listed, options, *arrays, known, names, table
        )

    place_of, walk_part = cuda.jit(device=True)(place_of), cuda.jit(device=True)(walk_part)

    def walk_rays(options, arrays, prims, units, count, again, total):
        known, names, table = prims
        depths = cuda.shared.array(size, np.float32)
        places = cuda.shared.array(size, np.uint16)
        room = min(cuda.blockIdx.x, known.shape[0] - 1)
        for k in range(cuda.blockIdx.x, count * parts, cuda.gridDim.x):
            quarter, part = place_of(k, units)
            cuda.syncthreads()
            overflows = walk_part(
                quarter, part, (depths, places), options, arrays, known[room], names[room],
                table[room],
            )  # fmt: skip
            if overflows and cuda.threadIdx.x == 0:
                again[cuda.atomic.add(total, 0, 1)] = quarter * (SIDE // height) + part

    def walk_far(options, arrays, prims, units, count, windows):
        known, names, table = prims
        depths, places = windows
        block = cuda.blockIdx.x
        room = min(block, known.shape[0] - 1)
        for k in range(block, count * parts, cuda.gridDim.x):
            quarter, part = place_of(k, units)
            cuda.syncthreads()
            walk_part(
                quarter, part, (depths[block], places[block]), options, arrays, known[room],
                names[room], table[room],
            )  # fmt: skip

    return kernel(walk_rays if slots else walk_far, name=f"cuda.walk.{name}")


_WALK_COLOR = _ray_walk("walk_color", SIDE, SIDE, SLOTS, only_color=True)
_WALK_RAYS = _ray_walk("walk_rays", SIDE, SIDE, SLOTS)
_WALK_FEW_ROWS = _ray_walk("walk_few_rows", SIDE, FEW_ROWS, MORE_SLOTS)
_WALK_FAR = _ray_walk("walk_far", FEW_ROWS, FEW_ROWS, 0)


@kernel
def _clear(total):
    total[0] = 0


def walk(device: CudaDevice, options: tuple[Any, ...], *args: Any) -> None:
    """Walk once for all that is asked for, see `kernels.walk.walk`; for a median once more."""
    wants, sorts, is_parallel, *rest = options
    records, starts, lists, grid, ray_hits = args[0], *args[4:8]
    order = None
    if sorts:
        order = ray_order(device, is_parallel, records, ray_hits, starts, lists, grid)
    for part in (wants & ~MEDIAN, wants & MEDIAN):
        if part:
            walk_pixels(device, (part, sorts, is_parallel, *rest), *args, order=order)


def walk_pixels(
    device: CudaDevice, options: tuple[Any, ...], *args: Any, order: Any = None
) -> None:
    """Walk all pixels once.

    Args:
        options, args: The arguments of `kernels.walk.walk`. Either MEDIAN alone is asked for, or
            other products.
        order: Result of `ray_order`; None where pixels are not sorted by ray hits.
    """
    wants, _, _, known, *_ = options
    keeps, starts, occluder_depth, holdout = args[2], args[4], args[8], args[10]
    tiles = starts.shape[0] - 1
    if tiles == 0:
        return
    prims = known if wants & WEIGH else 0
    if prims > MANY_PRIMS:
        prims = min(prims, max(1, int(np.diff(device.fetch(starts)).max())))

    def rooms(blocks: int, threads: int) -> tuple[int, Any]:
        blocks = min(blocks, BLOCKS) if prims else blocks
        return blocks, _prim_room(device, known, prims, blocks, threads)

    if order is None:
        blocks, room = rooms(tiles, THREADS)
        arrays = *args, *map(device.keep, NO_ORDER)
        _walk_lists[blocks, THREADS, device.stream](options, arrays, room)
        return
    arrays = *args, *order
    is_color = wants == COLOR and not any(each.size for each in (keeps, occluder_depth, holdout[0]))
    units, count = device.keep(NO_UNITS), QUARTERS * tiles
    for walk_rays, parent, height in (
        (_WALK_COLOR if is_color else _WALK_RAYS, SIDE, SIDE),
        (_WALK_FEW_ROWS, SIDE, FEW_ROWS),
    ):
        size = count * (parent // height)
        again = device.borrow(f"walk again {height}", size, np.int32)
        total = device.borrow("walk total", 1, np.int32)
        _clear[1, 1, device.stream](total)
        blocks, room = rooms(size, SIDE * height)
        walk_rays[blocks, SIDE * height, device.stream](
            options, arrays, room, units, count, again, total
        )
        units, count = again, device.number(total, 0)
        if count == 0:
            return
    crowded = device.fetch(units)[:count]
    lengths = np.diff(device.fetch(order[0]))[crowded // (SIDE // FEW_ROWS)]
    threads = SIDE * FEW_ROWS
    for some, longest in _groups(lengths):
        most = max(1, ROOM // (threads * longest * FAR_ENTRY))
        blocks, room = rooms(min(len(some), BLOCKS, most), threads)

        def window(name: str, dtype: Any, depth: int = longest, blocks: int = blocks) -> Any:
            size = blocks * depth * threads
            return device.borrow(name, size, dtype)[:size].reshape((blocks, depth, threads))

        windows = window("walk depths", np.float32), window("walk places", np.int32)
        _WALK_FAR[blocks, threads, device.stream](
            options, arrays, room, device.keep(crowded[some]), len(some), windows
        )


# --- private -------------------------------------------------------------------------------


def _prim_room(
    device: CudaDevice, known: int, prims: int, blocks: int, threads: int
) -> tuple[Any, Any, Any]:
    """Return buffers for the numbers, names and weights of the prims of each block's tile.

    Args:
        known: Number of prims of the scene.
        prims: Maximum number of prims of a tile, 0 if they are not weighed.
    """
    if not prims:
        known, prims, blocks = 1, 1, 1

    def room(name: str, dtype: Any, *shape: int) -> Any:
        size = blocks * math.prod(shape)
        return device.borrow(name, size, dtype)[:size].reshape((blocks, *shape))

    return (
        room("walk known", np.int32, known), room("walk names", np.int32, prims),
        room("walk table", np.float32, prims, threads),
    )  # fmt: skip


def _groups(lengths: Any) -> list[tuple[Any, int]]:
    """Return groups of indices whose lists have similar lengths, and the longest of each."""
    order = np.argsort(-lengths, kind="stable").astype(np.int32)
    sizes = np.maximum(lengths[order], 1)
    groups, first = [], 0
    while first < len(order):
        end = int(np.searchsorted(-sizes, -(sizes[first] // STEP), side="left"))
        end = max(end, first + 1)
        groups.append((order[first:end], int(sizes[first])))
        first = end
    return groups
