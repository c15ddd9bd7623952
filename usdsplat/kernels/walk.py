"""Walk through what each pixel sees, one contribution after the other.

`blend` and `median` treat 16 pixels at a time and know only the order of centres. Here each pixel
has its own list: in that order, or, for rayHitDistance, by the depths at which its own ray hits
the splats. Those are kept in a sorted window; what lies nearer than anything that may still
come is taken out of it, so the order is exact and no list is cut short.

What is done with a contribution is the mode: sum paint, find the median, weigh prims for
Cryptomatte, or count and write the samples of a deep picture.

The loop is one long body because a call with arrays takes counted references, which all threads
share: a hundred nanoseconds for each contribution.

Source: Radl et al. 2024, "StopThePop", for the order; OpenEXR's "Interpreting OpenEXR Deep Pixels".
"""

from __future__ import annotations

import numpy as np
from numba import prange

from .batch import FIELDS, LOOK, load_batch
from .bins import TILE
from .blend import END, alpha_at
from .jit import parallel, scalar
from .project import DEPTH
from .ray_hit import CENTER, GX, GY, HX, HY, HZ, REACH, ray_hit_at, row_at
from .weigh import NONE, number_prims, strongest

PAINT, MEDIAN, WEIGH, COUNT, FILL = range(5)

WALK = np.dtype(
    [
        ("mode", "i4"), ("column", "i4"), ("sort_by_ray_hit", "i4"), ("is_parallel", "i4"),
        ("prims", "i4"), ("part", "f4"), ("error", "f4"), ("near", "f4"),
    ]
)  # fmt: skip
"""What a walk is for: its mode, the first column of the paints, whether pixels have orders of their
own, whether rays are parallel, how many prims there are, the part of the coverage that MEDIAN looks
for, by how much merging may change the opacity in front of any depth, and the near plane: the eye
may be inside a Gaussian, whose ray hit then may be behind it."""

DEPTHS = -1
"""Column that stands for the depth of each contribution."""

FLUSH = 8
"""Splats between two looks at what may leave the windows."""

STATE = 8
THROUGH, COVER, GOAL, FIRST, SECOND, THIRD, SEEN, WEIGHT = range(STATE)
"""Of one pixel: transmittance; coverage so far and the one looked for; three sums; the depth found,
or the transmittance of what a deep pixel holds so far; the weight of the run that is merged."""


# --- 1. mathematics: one contribution to one pixel --------------------------------------


@scalar
def held_through(offsets, depths, through, pixel, depth):
    """What the samples of a deep holdout in front of `depth` let through."""
    low, high = offsets[pixel], offsets[pixel + 1]
    first = low
    while low < high:
        middle = (low + high) // 2
        if depths[middle] < depth:
            low = middle + 1
        else:
            high = middle
    return through[low - 1] if low > first else np.float32(1)


# --- 2. CPU ----------------------------------------------------------------------------


@parallel(writes=("out",), gpu="walk.walk")
def walk(
    options, records, paints, keeps, labels, starts, lists, grid, ray_hits, stops, covered, holdout,
    out,
):  # fmt: skip
    """Walk all pixels of a band.

    Args:
        options: One WALK record, shape (1,).
        records, starts, lists, grid, ray_hits, stops: As `blend` takes them.
        paints: Three numbers of each splat from a column on, f32; of column DEPTHS none.
        keeps: 0 for a splat that only holds out, else 1, shape (n,) f32; or of no size.
        labels: Number of each splat's prim, shape (n,) i32; read only by WEIGH.
        covered: 1 where a surface shows behind the splats, shape (h, w) u8; or of no size.
        holdout: (offsets (h * w + 1,) i64, depths f32, transmittance up to each sample f32), sorted
            by depth in each pixel; the offsets of no size where there is none.
        out: (image (h, w, 4) f32: paint and coverage, through (h, w) f32: transmittance, ranks
            (h, w) i32, depths (h, w) f32, ids and weights (h, w, RANKS), counts (h, w) u32,
            offsets (h * w,) i64, deep (depth, back, color (n, 4)) f32). A mode writes its own:
            PAINT image and through; MEDIAN, which reads both, ranks and depths; WEIGH ids and
            weights; COUNT counts; FILL, from each pixel's offset on, deep, and, where something
            holds out, into through the part of a surface behind that its samples do not hide and
            is there.
    """
    image, through, ranks, depths_out, ids, weights, counts, offsets, deep = out
    hold_offsets, hold_depths, hold_through = holdout
    deep_near, deep_far, deep_color = deep
    for tile in prange(starts.shape[0] - 1):
        g = grid[0]
        mode, column, error = options[0].mode, options[0].column, options[0].error
        sort_by_ray_hit, is_parallel = options[0].sort_by_ray_hit, options[0].is_parallel
        left = g.left + tile % g.columns * TILE
        top = g.top + tile // g.columns * TILE
        x0, x1 = max(0, g.x0 - left), min(TILE, g.x1 - left)
        begin, n = starts[tile], starts[tile + 1] - starts[tile]
        width = g.x1 - g.x0
        has_stops, holds, has_keeps = stops.shape[0] > 0, hold_offsets.shape[0] > 0, len(keeps) > 0
        fields = np.empty(FIELDS * n, np.float32)
        spans = np.empty(2 * n, np.int32)
        batch = np.ones((FIELDS + 3) * LOOK, np.float32)
        rows = np.empty(2 * LOOK, np.float32)
        loaded = 0
        bound = np.empty(n + 1, np.float32)
        near = np.empty(TILE * n, np.float32)
        strength = np.empty(TILE * n, np.float32)
        ranked = np.empty(TILE * n, np.int32)
        if sort_by_ray_hit:
            bound[n] = np.float32(np.inf)
            for i in range(n):
                k = n - 1 - i
                rank = lists[begin + k]
                bound[k] = min(bound[k + 1], ray_hits[rank, CENTER] - ray_hits[rank, REACH])
        prims = 0
        weighed = n if mode == WEIGH else 0
        known = np.full(options[0].prims if mode == WEIGH else 0, NONE, np.int32)
        local = np.empty(weighed, np.int32)
        names = np.empty(weighed, np.int32)
        if mode == WEIGH:
            prims = number_prims(labels, lists, begin, n, known, local, names)
        table = np.zeros(TILE * min(weighed, options[0].prims), np.float32)
        state = np.zeros(TILE * STATE, np.float32)
        mark = np.zeros(TILE, np.int32)
        head, tail = np.zeros(TILE, np.int64), np.zeros(TILE, np.int64)
        alive = np.zeros(TILE, np.uint8)
        alphas, depths = np.zeros(TILE, np.float32), np.zeros(TILE, np.float32)
        for y in range(max(0, g.y0 - top), min(TILE, g.y1 - top)):
            row = top + y - g.y0
            living = 0
            state[:] = np.float32(0)
            table[:] = np.float32(0)
            head[:], tail[:], alive[:] = 0, 0, 0
            mark[:] = NONE if mode == MEDIAN else np.int32(0)
            for x in range(x0, x1):
                s, place = x * STATE, left + x - g.x0
                state[s + THROUGH] = state[s + SEEN] = np.float32(1)
                alive[x] = 1
                if mode == MEDIAN:
                    whole = image[row, place, 3]
                    alive[x] = whole > np.float32(0)
                    if covered.shape[0] > 0 and covered[row, place] == 1:
                        beyond = through[row, place]
                        if holds:
                            beyond *= held_through(
                                hold_offsets, hold_depths, hold_through, row * width + place,
                                stops[row, place],
                            )  # fmt: skip
                        whole += beyond
                    state[s + GOAL] = whole * options[0].part
                living += alive[x]
            k = 0
            while k < n and living > 0:
                if k == loaded:
                    count = min(LOOK, n - loaded)
                    load_batch(
                        records, lists, begin + k, count, np.float32(left), np.float32(top),
                        batch, rows,
                    )  # fmt: skip
                    for i in range(count):
                        for f in range(FIELDS):
                            fields[(k + i) * FIELDS + f] = batch[f * LOOK + i]
                        spans[2 * (k + i)], spans[2 * (k + i) + 1] = rows[i], rows[LOOK + i]
                    loaded += count
                if spans[2 * k] <= y < spans[2 * k + 1]:
                    rank, f = lists[begin + k], k * FIELDS
                    dy = np.float32(y) - fields[f + 1]
                    u, a, slope = fields[f], fields[f + 2], fields[f + 3] * dy
                    rest = fields[f + 4] * dy * dy + fields[f + 5]
                    for x in range(TILE):
                        alphas[np.uint64(x)] = alpha_at(np.float32(x) - u, a, slope, rest)
                    if sort_by_ray_hit or has_stops:
                        first, second, third = row_at(
                            ray_hits[rank, HX], ray_hits[rank, HY], ray_hits[rank, HZ], dy
                        )
                        gx, gy = ray_hits[rank, GX], ray_hits[rank, GY]
                        center, reach = ray_hits[rank, CENTER], ray_hits[rank, REACH]
                        for x in range(TILE):
                            depths[np.uint64(x)] = ray_hit_at(
                                np.float32(x) - u, gx, gy, first, second, third, center, reach,
                                is_parallel,
                            )  # fmt: skip
                    center = records[rank, DEPTH]
                    for x in range(x0, x1):
                        if alphas[x] <= np.float32(0) or alive[x] == 0:
                            continue
                        depth = max(depths[x], options[0].near) if sort_by_ray_hit else center
                        if has_stops:
                            stop = stops[row, left + x - g.x0]
                            if depths[x] > stop:
                                continue
                            depth = min(depth, stop)
                        j = x * n + tail[x]
                        if sort_by_ray_hit:  # sorted by depth; equal ones keep their order
                            first_of = x * n + head[x]
                            while j > first_of and near[j - 1] > depth:
                                near[j], strength[j] = near[j - 1], strength[j - 1]
                                ranked[j] = ranked[j - 1]
                                j -= 1
                        near[j], strength[j], ranked[j] = depth, alphas[x], k
                        tail[x] += 1
                k += 1
                if k % FLUSH != 0 and k != n:
                    continue
                for x in range(x0, x1):
                    s, place = x * STATE, left + x - g.x0
                    pixel = row * width + place
                    j, end = x * n + head[x], x * n + tail[x]
                    while j < end and (not sort_by_ray_hit or near[j] <= bound[k]):
                        rank, alpha, depth = lists[begin + ranked[j]], strength[j], near[j]
                        label = local[ranked[j]] if mode == WEIGH else NONE
                        j += 1
                        t = state[s + THROUGH]
                        weight = alpha * t
                        remains = t - weight
                        if remains < END:
                            alive[x] = 0
                            break
                        state[s + THROUGH] = remains
                        if has_keeps:
                            weight *= keeps[rank]
                        if holds:
                            weight *= held_through(
                                hold_offsets, hold_depths, hold_through, pixel, depth
                            )
                        if weight <= np.float32(0):
                            continue
                        if mode == PAINT:
                            state[s + COVER] += weight
                            if column == DEPTHS:
                                state[s + FIRST] += weight * depth
                                continue
                            state[s + FIRST] += weight * paints[rank, column]
                            state[s + SECOND] += weight * paints[rank, column + 1]
                            state[s + THIRD] += weight * paints[rank, column + 2]
                        elif mode == MEDIAN:
                            state[s + COVER] += weight
                            if state[s + COVER] >= state[s + GOAL]:
                                mark[x], state[s + SEEN] = rank, depth
                                alive[x] = 0
                                break
                        elif mode == WEIGH:
                            table[label * TILE + x] += weight
                        else:
                            seen = state[s + SEEN]
                            own = min(weight / seen, np.float32(1))
                            state[s + SEEN] = seen - seen * own
                            run = state[s + WEIGHT]
                            begins = run <= np.float32(0) or run + weight > error
                            state[s + WEIGHT] = weight if begins else run + weight
                            if begins:
                                mark[x] += 1
                            if mode == FILL:
                                at = offsets[pixel] + mark[x] - 1
                                if begins:
                                    deep_near[at] = depth
                                    deep_color[at, 0] = deep_color[at, 1] = np.float32(0)
                                    deep_color[at, 2] = deep_color[at, 3] = np.float32(0)
                                deep_far[at] = depth
                                part = (np.float32(1) - deep_color[at, 3]) * own
                                deep_color[at, 0] += part * paints[rank, column]
                                deep_color[at, 1] += part * paints[rank, column + 1]
                                deep_color[at, 2] += part * paints[rank, column + 2]
                                deep_color[at, 3] += part
                    head[x] = j - x * n
                    if alive[x] == 0 or j == end:
                        head[x] = tail[x] = 0
                living = 0
                for x in range(x0, x1):
                    living += alive[x]
            for x in range(x0, x1):
                s, place = x * STATE, left + x - g.x0
                if mode == PAINT:
                    image[row, place, 0] = state[s + FIRST]
                    image[row, place, 1] = state[s + SECOND]
                    image[row, place, 2] = state[s + THIRD]
                    image[row, place, 3] = state[s + COVER]
                    through[row, place] = state[s + THROUGH]
                elif mode == MEDIAN:
                    ranks[row, place] = mark[x]
                    depths_out[row, place] = state[s + SEEN]
                elif mode == WEIGH:
                    strongest(table, x, prims, names, ids, weights, row, place)
                elif mode == COUNT:
                    counts[row, place] = mark[x]
                elif has_stops and (has_keeps or holds):
                    beyond = state[s + THROUGH] / state[s + SEEN]
                    if holds:
                        beyond *= held_through(
                            hold_offsets, hold_depths, hold_through, row * width + place,
                            stops[row, place],
                        )  # fmt: skip
                    through[row, place] = min(beyond, np.float32(1))
