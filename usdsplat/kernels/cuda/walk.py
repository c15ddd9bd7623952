"""Walking pixels on a GPU: a thread for each, its window in the GPU's memory.

Where pixels have orders of their own, a window may have to hold all that its tile's list has. So
tiles are walked in groups of about equal lists, by as many blocks of threads as their windows have
room for, each of which takes one tile after the other: nothing is cut short, and long lists cost
room for themselves alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from usdsplat.kernels import feature
from usdsplat.kernels.bins import TILE
from usdsplat.kernels.blend import END
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.falloff import behind
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.tile import (
    BATCH,
    FIELDS,
    RAY_HITS,
    THREADS,
    alpha_in,
    depth_in,
    fetch_ray_hit,
    fetch_splat,
    is_hidden,
    origin,
)
from usdsplat.kernels.project import DEPTH, RED
from usdsplat.kernels.ray_hit import CENTER, REACH
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
from usdsplat.kernels.weigh import NONE, RANKS

PAINT = COLOR
"""Mode of a walk that sums three numbers of each splat, whichever."""
DEPTH_COLUMN = -1
"""Column that stands for the depth of each contribution."""
FLUSH = 8
"""Splats between two looks at what may leave the windows."""
STATE = 8
THROUGH, COVER, GOAL, FIRST, SECOND, THIRD, SEEN, WEIGHT = range(STATE)
"""Of one pixel: transmittance; coverage so far and the one looked for; three sums; the depth found,
or the transmittance of what a deep pixel holds so far; the weight of the run that is merged."""
ROOM = 1 << 30
"""[byte] of all windows together, unless one block needs more."""
WINDOW = 12
"""[byte] of an entry: depth, contribution, place in the list."""
BLOCKS = 132 * 4
"""Of threads: as many as a GPU runs at once."""
STEP = 4
"""By how much the lists of a group may differ in length."""


@cuda.jit(device=True)
def _take(
    options, k, rank, alpha, depth, pixel, thread, state, mark, table, local, begin, keeps, paints,
    holdout, offsets, deep,
):  # fmt: skip
    """Do with a contribution what the mode says, as `kernels.walk` does; whether the pixel goes
    on."""
    hold_offsets, hold_depths, hold_through = holdout
    mode = options.wants
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
    if mode == PAINT:
        column = options.column
        state[COVER] += weight
        if column == DEPTH_COLUMN:
            state[FIRST] += weight * depth
        else:
            state[FIRST] += weight * paints[rank, column]
            state[SECOND] += weight * paints[rank, column + 1]
            state[THIRD] += weight * paints[rank, column + 2]
    elif mode == MEDIAN:
        state[COVER] += weight
        if state[COVER] >= state[GOAL]:
            mark[0], state[SEEN] = rank, depth
            return False
    elif mode == WEIGH:
        table[local[begin + k], thread] += weight
    else:
        deep_near, deep_far, color = deep
        column = options.column
        seen = state[SEEN]
        own = min(weight / seen, np.float32(1))
        state[SEEN] = seen - seen * own
        run = state[WEIGHT]
        begins = run <= np.float32(0) or run + weight > options.error
        state[WEIGHT] = weight if begins else run + weight
        if begins:
            mark[0] += 1
        if mode == FILL:
            at = offsets[pixel] + mark[0] - 1
            if begins:
                deep_near[at] = depth
                for c in range(4):
                    color[at, c] = np.float32(0)
            deep_far[at] = depth
            part = (np.float32(1) - color[at, 3]) * own
            for c in range(3):
                color[at, c] += part * paints[rank, column + c]
            color[at, 3] += part
    return True


@cuda.jit(device=True)
def _bound(lists, ray_hits, begin, n, bounds, thread):
    """bounds[k] = the least depth at which a ray may hit anything from place k of the list on."""
    for k in range(thread, n, THREADS):
        rank = lists[begin + k]
        bounds[begin + k] = ray_hits[rank, CENTER] - ray_hits[rank, REACH]
    cuda.syncthreads()
    if thread == 0:
        least = np.float32(np.inf)
        for j in range(n):
            k = begin + n - 1 - j
            least = min(least, bounds[k])
            bounds[k] = least
    cuda.syncthreads()


@cuda.jit(device=True)
def _number(lists, labels, begin, n, local, known, names, thread):
    """Number the prims of a tile as they come in its list; returns how many there are."""
    for k in range(thread, n, THREADS):
        local[begin + k] = labels[lists[begin + k]]
    for prim in range(thread, known.shape[0], THREADS):
        known[prim] = NONE
    cuda.syncthreads()
    if thread == 0:
        prims = 0
        for k in range(begin, begin + n):
            label = local[k]
            if known[label] < 0:
                known[label], names[1 + prims] = prims, label
                prims += 1
            local[k] = known[label]
        names[0] = prims
    cuda.syncthreads()
    return names[0]


@cuda.jit(device=True)
def _strongest(table, prims, thread, names, ids, weights, row, column):
    """`kernels.walk.strongest` of one pixel."""
    for rank in range(RANKS):
        best, most = NONE, np.float32(0)
        for j in range(prims):
            if table[j, thread] > most:
                best, most = np.int32(j), table[j, thread]
        ids[row, column, rank] = names[1 + best] if best >= 0 else NONE
        weights[row, column, rank] = most
        if best >= 0:
            table[best, thread] = np.float32(0)


@cuda.jit(device=True)
def _held_at_stop(holdout, pixel, stop):
    """What a deep holdout lets through of a surface."""
    offsets, depths, through = holdout
    if offsets.shape[0] == 0:
        return np.float32(1)
    return held_through(offsets, depths, through, pixel, stop)


@kernel
def _walk(
    options, tiles, room, records, paints, keeps, labels, starts, lists, grid, ray_hits,
    occluder_depth, covered, holdout, out,
):  # fmt: skip
    nears, strengths, places, bounds, local, known, names, tables = room
    image, through, ranks, depths_out, ids, weights, counts, offsets, deep = out
    batch = cuda.shared.array((FIELDS, BATCH), np.float32)
    shape = cuda.shared.array((RAY_HITS, BATCH), np.float32)
    rows = cuda.shared.array((2, BATCH), np.int32)
    state = cuda.local.array(STATE, np.float32)
    mark = cuda.local.array(1, np.int32)
    thread = cuda.threadIdx.x
    x, y = thread % TILE, thread // TILE
    g, o = grid[0], options[0]
    mode, sort_by_ray_hit, is_parallel = o.wants, o.sort_by_ray_hit, o.is_parallel
    near, strength = nears[cuda.blockIdx.x], strengths[cuda.blockIdx.x]
    place, table = places[cuda.blockIdx.x], tables[cuda.blockIdx.x]
    has_occluders = occluder_depth.shape[0] > 0
    for each in range(cuda.blockIdx.x, tiles.shape[0], cuda.gridDim.x):
        tile = tiles[each]
        left, top = origin(g, tile)
        column, row = left + x - g.x0, top + y - g.y0
        inside = g.x0 <= left + x < g.x1 and g.y0 <= top + y < g.y1
        begin, n = starts[tile], starts[tile + 1] - starts[tile]
        pixel = row * (g.x1 - g.x0) + column
        cuda.syncthreads()
        if sort_by_ray_hit:
            _bound(lists, ray_hits, begin, n, bounds, thread)
        prims = 0
        if mode == WEIGH:
            prims = _number(
                lists, labels, begin, n, local, known[cuda.blockIdx.x], names[cuda.blockIdx.x],
                thread,
            )  # fmt: skip
            for j in range(prims):
                table[j, thread] = np.float32(0)
        for k in range(STATE):
            state[k] = np.float32(0)
        state[THROUGH] = state[SEEN] = np.float32(1)
        mark[0] = NONE if mode == MEDIAN else np.int32(0)
        alive = inside
        stop = occluder_depth[row, column] if has_occluders and inside else np.float32(np.inf)
        if mode == MEDIAN and inside:
            whole = image[row, column, 3]
            alive = whole > np.float32(0)
            if covered.shape[0] > 0 and covered[row, column] == 1:
                whole += through[row, column] * _held_at_stop(holdout, pixel, stop)
            state[GOAL] = whole * o.part
        head, tail = 0, 0
        for first in range(0, n, BATCH):
            if cuda.syncthreads_count(np.int32(alive)) == 0:
                break
            if first + thread < n:
                rank = lists[begin + first + thread]
                fetch_splat(records, rank, left, top, batch, rows, thread)
                if sort_by_ray_hit or has_occluders:
                    fetch_ray_hit(ray_hits, rank, shape, thread)
            cuda.syncthreads()
            for i in range(min(BATCH, n - first)):
                if not alive:
                    break
                k = first + i
                if rows[0, i] <= y < rows[1, i]:
                    alpha = alpha_in(batch, i, x, y)
                    goes_in = alpha > np.float32(0)
                    if goes_in and has_occluders:
                        goes_in = not is_hidden(batch, shape, i, x, y, stop, is_parallel)
                    if goes_in and not sort_by_ray_hit:
                        rank = lists[begin + k]
                        alive = _take(
                            o, k, rank, alpha, min(records[rank, DEPTH], stop), pixel, thread,
                            state, mark, table, local, begin, keeps, paints, holdout, offsets,
                            deep,
                        )  # fmt: skip
                    elif goes_in:  # sorted by depth; equal ones keep their order
                        depth = depth_in(batch, shape, i, x, y, is_parallel)
                        depth = min(max(depth, o.near), stop)
                        j = tail
                        while j > head and near[j - 1, thread] > depth:
                            near[j, thread] = near[j - 1, thread]
                            strength[j, thread] = strength[j - 1, thread]
                            place[j, thread] = place[j - 1, thread]
                            j -= 1
                        near[j, thread], strength[j, thread] = depth, alpha
                        place[j, thread] = np.int32(k)
                        tail += 1
                if sort_by_ray_hit and (k % FLUSH == FLUSH - 1 or k == n - 1):
                    rest = bounds[begin + k + 1] if k + 1 < n else np.float32(np.inf)
                    while alive and head < tail and near[head, thread] <= rest:
                        at = place[head, thread]
                        alive = _take(
                            o, at, lists[begin + at], strength[head, thread], near[head, thread],
                            pixel, thread, state, mark, table, local, begin, keeps, paints,
                            holdout, offsets, deep,
                        )  # fmt: skip
                        head += 1
                    if head == tail:
                        head = tail = 0
        if not inside:
            continue
        if mode == PAINT:
            image[row, column, 0], image[row, column, 1] = state[FIRST], state[SECOND]
            image[row, column, 2], image[row, column, 3] = state[THIRD], state[COVER]
            through[row, column] = state[THROUGH]
        elif mode == MEDIAN:
            ranks[row, column], depths_out[row, column] = mark[0], state[SEEN]
        elif mode == WEIGH:
            _strongest(table, prims, thread, names[cuda.blockIdx.x], ids, weights, row, column)
        elif mode == COUNT:
            counts[row, column] = mark[0]
        elif has_occluders and (keeps.shape[0] > 0 or holdout[0].shape[0] > 0):
            beyond = state[THROUGH] / state[SEEN] * _held_at_stop(holdout, pixel, stop)
            through[row, column] = min(beyond, np.float32(1))


def _groups(lengths: Any) -> list[Any]:
    """Tiles whose lists are about as long as each other's, the longest first in each group."""
    order = np.argsort(-lengths, kind="stable").astype(np.int32)
    sizes = np.maximum(lengths[order], 1)
    groups, first = [], 0
    while first < len(order):
        end = int(np.searchsorted(-sizes, -(sizes[first] // STEP), side="left"))
        end = max(end, first + 1)
        groups.append(order[first:end])
        first = end
    return groups


def walk(
    device: CudaDevice, options: Any, records: Any, features: Any, keeps: Any, labels: Any,
    *args: Any,
) -> None:  # fmt: skip
    """`kernels.walk.walk`: one walk for each thing that is asked for."""
    *lists, holdout, out = args
    color, albedo, normals, sums, through, median, front, prims, counts, offsets, deep = out
    asked = device.fetch(options)[0]
    # mode -> paints, their first column, part of the coverage; image, ranks and depths
    steps = {
        COLOR: (records, RED, 0.0, color, median),
        ALBEDO: (features, feature.ALBEDO, 0.0, albedo, median),
        NORMALS: (features, feature.NORMAL, 0.0, normals, median),
        DEPTHS: (records, DEPTH_COLUMN, 0.0, sums, median),
        MEDIAN: (records, RED, HALF, color, median),
        FRONT: (records, RED, 0.0, color, front),
        WEIGH: (records, RED, 0.0, color, median),
        COUNT: (records, RED, 0.0, color, median),
        FILL: (records, RED, 0.0, color, median),
    }
    for wanted, (paints, column, part, image, found) in steps.items():
        if not asked["wants"] & wanted:
            continue
        chosen = np.array([asked], asked.dtype)
        mode = {ALBEDO: PAINT, NORMALS: PAINT, DEPTHS: PAINT, FRONT: MEDIAN}.get(wanted, wanted)
        chosen["wants"], chosen["column"], chosen["part"] = mode, column, part
        written = image, through, *found, *prims, counts, offsets, deep
        launch(device, chosen, records, paints, keeps, labels, *lists, holdout, written)


def launch(device: CudaDevice, options: Any, *args: Any) -> None:
    """Walk all pixels in one mode.

    Args:
        options: One WALK record of the host, shape (1,), `wants` the mode.
        args: What `_walk` takes behind its windows.
    """
    starts, lists = args[4], args[5]
    chosen = options[0]
    lengths = np.diff(device.fetch(starts))
    sort_by_ray_hit, weighs = bool(chosen["sort_by_ray_hit"]), chosen["wants"] == WEIGH
    prims = int(chosen["prims"]) if weighs else 0
    pairs = lists.shape[0]
    borrow = device.borrow
    bounds = borrow("walk bounds", pairs if sort_by_ray_hit else 0, np.float32)
    local = borrow("walk local", pairs if weighs else 0, np.int32)
    for tiles in _groups(lengths) if sort_by_ray_hit else [np.arange(len(lengths), dtype=np.int32)]:
        longest = int(lengths[tiles[0]]) if sort_by_ray_hit else 0
        here = min(prims, int(lengths[tiles].max()))
        size = THREADS * (longest * WINDOW + 4 * here) + 8 * prims
        blocks = min(len(tiles), max(1, ROOM // max(size, 1)))
        blocks = min(blocks, BLOCKS) if sort_by_ray_hit or weighs else blocks

        def windows(name: str, dtype: Any, depth: int = longest, blocks: int = blocks) -> Any:
            count = blocks * depth * THREADS
            return borrow(name, count, dtype)[:count].reshape((blocks, depth, THREADS))

        known = borrow("walk known", blocks * prims, np.int32)[: blocks * prims]
        names = borrow("walk names", blocks * (prims + 1), np.int32)[: blocks * (prims + 1)]
        room = (
            windows("walk depths", np.float32), windows("walk strengths", np.float32),
            windows("walk places", np.int32), bounds, local, known.reshape((blocks, prims)),
            names.reshape((blocks, prims + 1)), windows("walk table", np.float32, here),
        )  # fmt: skip
        chosen_tiles = device.keep(tiles)
        _walk[blocks, THREADS, device.stream](device.keep(options), chosen_tiles, room, *args)
