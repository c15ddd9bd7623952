"""Compute the products of some pixels of a tile on a GPU, with a block of threads, one per pixel.

Each thread processes the contributions to its pixel one after another, by the rules of
`kernels.walk`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from usdsplat.kernels import feature
from usdsplat.kernels.blend import END
from usdsplat.kernels.cuda.falloff import behind
from usdsplat.kernels.cuda.pixel_order import insert, pop, push
from usdsplat.kernels.cuda.prims import number_prims, strongest
from usdsplat.kernels.cuda.tile import (
    FIELDS,
    RAY_HITS,
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
    AXES,
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

SUMS = 15
"""Number of sums of a pixel: three each for colour, albedo, normal and axis, and those of
`feature.EXPECTED`."""
DEPTH_SUM, AXIS_SUM = 9, 12
STATE = 6
THROUGH, COVER, GOAL, FOUND_AT, SEEN, RUN = range(STATE)
"""Indices of the numbers of a pixel: transmittance; coverage so far; coverage to reach; depth of
the found splat; transmittance of the deep samples so far; sum of the weights that are merged in the
current sample."""
SPLAT, SAMPLES = 0, 1
"""Indices of the integers of a pixel: rank of the found splat; number of deep samples."""
FLUSH = 8
"""Number of splats after which contributions that need not wait any longer are processed."""


@cuda.jit(device=True)
def _take(wants, error, rank, alpha, depth, pixel, thread, numbers, paints, prims, holdout, deep):
    """Process a contribution as `kernels.walk` does. Return False if the pixel is finished."""
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
        sums[DEPTH_SUM + 1] += weight * features[rank, feature.EXPECTED + 1]
        sums[DEPTH_SUM + 2] += weight * features[rank, feature.EXPECTED + 2]
    if wants & AXES:
        for c in range(3):
            sums[AXIS_SUM + c] += weight * features[rank, feature.AXIS + c]
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
    """Return the transmittance of a deep holdout to depth `stop`, 1 without a holdout."""
    offsets, depths, through = holdout
    if offsets.shape[0] == 0:
        return np.float32(1)
    return held_through(offsets, depths, through, pixel, stop)


@cuda.jit(device=True)
def _store(wants, row, column, pixel, stop, numbers, keeps, holdout, occluded, out):
    """Write the products of a pixel."""
    state, sums, marks = numbers
    color, albedo, normals, depths, axes, through, median, front, counts = out
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
        for c in range(3):
            depths[row, column, c] = sums[DEPTH_SUM + c]
        depths[row, column, 3] = state[COVER]
    if wants & AXES:
        for c in range(3):
            axes[row, column, c] = sums[AXIS_SUM + c]
        axes[row, column, 3] = state[COVER]
    if wants & FRONT:
        front[0][row, column], front[1][row, column] = marks[SPLAT], state[FOUND_AT]
    if wants & MEDIAN:
        median[0][row, column], median[1][row, column] = marks[SPLAT], state[FOUND_AT]
    if wants & COUNT:
        counts[row, column] = marks[SAMPLES]
    if wants & FILL and occluded and (keeps.shape[0] > 0 or holdout[0].shape[0] > 0):
        beyond = state[THROUGH] / state[SEEN] * _held_at_stop(holdout, pixel, stop)
        through[row, column] = min(beyond, np.float32(1))


def block_walk(
    width: int,
    height: int,
    size: int,
    *,
    sorts: bool,
    most_places: int = 0,
    is_long: bool = False,
    only_color: bool = False,
) -> Any:
    """Return a device function that walks pixels of a tile, with a thread for each.

    Args:
        width, height: Number of columns and rows.
        size: Number of splats of a batch.
        sorts: Whether pixels are sorted by their ray hits.
        most_places: Number of list indices that a window can store, if `sorts`.
        is_long: Whether windows are heaps, which are faster if many contributions wait.
        only_color: Whether COLOR is the only product, without mattes, surfaces and holdout.
    """
    ends = size + 1

    @cuda.jit(device=True)
    def walk_block(
        window, tile, first_pixel, listed, options, records, features, keeps, labels, starts,
        lists, grid, ray_hits, occluder_depth, covered, holdout, out, firsts, ranks, bounds, known,
        names, table,
    ):  # fmt: skip
        """Walk some pixels of a tile. Return whether a window overflowed; nothing is written then.

        first_pixel: (column, row) of the first pixel in the tile. listed: (first entry, number of
        entries) of the list of splats.
        """
        color, albedo, normals, sums_out, axes, through, median, front, ids = out[:9]
        counts, offsets, deep = out[9:]
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
                        if held == slots or first + i >= most_places:
                            overflows, alive = True, False
                            break
                        depth = depth_in(batch, shape, i, x, y, is_parallel)
                        depth = min(max(depth, near), stop)
                        if is_long:
                            push(window, thread, held, depth, first + i, ranks, begin)
                        else:
                            insert(window, thread, head, held, depth, first + i, ranks, begin)
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
                            pop(window, thread, held, ranks, begin)
                        else:
                            head = head + np.int32(1) if head < slots - 1 else np.int32(0)
                        held -= np.int32(1)
        if sorts and cuda.syncthreads_count(np.int32(overflows)) > 0:
            return True
        if inside:
            if wants & WEIGH:
                strongest(table, prims, thread, names, ids[0], ids[1], row, column)
            images = color, albedo, normals, sums_out, axes, through, median, front, counts
            _store(
                wants, row, column, pixel, stop, numbers, keeps, holdout, has_occluders,
                images,
            )  # fmt: skip
        return False

    return walk_block
