"""Walk through what each pixel sees, one contribution after the other.

`blend` and `median` treat 16 pixels at a time and know only the order of centres. Here each pixel
has its own list: in that order, or, for rayHitDistance, by the depths at which the splats peak
along its own ray. Those are kept in a sorted window; what lies nearer than anything that may still
come is taken out of it, so the order is exact and no list is cut short.

What is done with a contribution is the mode: sum paint, find the median, weigh prims for
Cryptomatte, or count and write the samples of a deep picture.

Source: Radl et al. 2024, "StopThePop", for the order; OpenEXR's "Interpreting OpenEXR Deep Pixels".
"""

from __future__ import annotations

import numpy as np
from numba import prange

from .bins import TILE
from .blend import END, FIELDS, LOOK, alpha_at, load_batch
from .jit import parallel, scalar
from .peak import CENTER, GX, GY, HX, HY, HZ, REACH, peak_at
from .project import DEPTH

PAINT, MEDIAN, WEIGH, COUNT, FILL = range(5)

WALK = np.dtype(
    [
        ("mode", "i4"), ("column", "i4"), ("by_ray", "i4"), ("is_parallel", "i4"),
        ("prims", "i4"), ("part", "f4"), ("error", "f4"),
    ]
)  # fmt: skip
"""What a walk is for: its mode, the first column of the paints, whether pixels have orders of their
own, whether rays are parallel, how many prims there are, the part of the coverage that MEDIAN looks
for, and by how much merging may change the opacity in front of any depth."""

RANKS = 6
"""Prims of a pixel that Cryptomatte keeps."""

FLUSH = 8
"""Splats between two looks at what may leave the windows."""

STATE = 14
THROUGH, COVER, GOAL, FIRST, SECOND, THIRD, SEEN, WEIGHT, RUN, R, G, B, NEAR, FAR = range(STATE)
"""Of one pixel: transmittance; coverage so far and the one looked for; three sums; the depth found,
or transmittance of what a deep pixel has so far; of the run that is being merged: its weight,
transmittance, colour and depths."""
NONE = np.int32(-1)


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


@scalar
def close_run(mode, s, count, at, deep):
    """End the run that is being merged: one sample of a deep pixel; returns how many there are."""
    depth, back, color = deep
    if s[WEIGHT] <= np.float32(0):
        return count
    if mode == FILL:
        depth[at + count], back[at + count] = s[NEAR], s[FAR]
        color[at + count, 0], color[at + count, 1], color[at + count, 2] = s[R], s[G], s[B]
        color[at + count, 3] = np.float32(1) - s[RUN]
    s[WEIGHT] = np.float32(0)
    return count + 1


@scalar
def take(o, s, mark, x, k, alpha, depth, held, keep, paints, label, table, at, deep):
    """Let splat k contribute to pixel x of a row; returns whether the pixel goes on."""
    zero, one = np.float32(0), np.float32(1)
    t = s[THROUGH]
    weight = alpha * t
    left = t - weight
    if left < END:
        return False
    s[THROUGH] = left
    weight *= held * keep
    if weight <= zero:
        return True
    if o.mode == PAINT:
        s[COVER] += weight
        s[FIRST] += weight * paints[k, o.column]
        s[SECOND] += weight * paints[k, o.column + 1]
        s[THIRD] += weight * paints[k, o.column + 2]
    elif o.mode == MEDIAN:
        s[COVER] += weight
        if s[COVER] >= s[GOAL]:
            mark[x], s[SEEN] = k, depth
            return False
    elif o.mode == WEIGH:
        table[label, x] += weight
    else:
        own = min(weight / s[SEEN], one)
        s[SEEN] *= one - own
        if s[WEIGHT] > zero and s[WEIGHT] + weight > o.error:
            mark[x] = close_run(o.mode, s, mark[x], at, deep)
        if s[WEIGHT] <= zero:
            s[RUN], s[R], s[G], s[B], s[NEAR] = one, zero, zero, zero, depth
        share = s[RUN] * own
        s[R] += share * paints[k, o.column]
        s[G] += share * paints[k, o.column + 1]
        s[B] += share * paints[k, o.column + 2]
        s[RUN] -= share
        s[WEIGHT] += weight
        s[FAR] = depth
    return True


@scalar
def insert(depths, alphas, ranks, first, count, depth, alpha, k):
    """Put a contribution into a window that is sorted by depth; equal ones keep their order."""
    j = count
    while j > first and depths[j - 1] > depth:
        depths[j], alphas[j], ranks[j] = depths[j - 1], alphas[j - 1], ranks[j - 1]
        j -= 1
    depths[j], alphas[j], ranks[j] = depth, alpha, k


@scalar
def strongest(table, count, x, names, ids, weights):
    """Write the prims that weigh most in pixel x, the heaviest first, and forget their weights."""
    for rank in range(RANKS):
        best, most = NONE, np.float32(0)
        for j in range(count):
            if table[j, x] > most:
                best, most = np.int32(j), table[j, x]
        ids[rank] = names[best] if best >= 0 else NONE
        weights[rank] = most
        if best >= 0:
            table[best, x] = np.float32(0)


# --- 2. CPU ----------------------------------------------------------------------------


@parallel
def walk(
    options, records, paints, keeps, labels, starts, lists, grid, peaks, stops, covered, holdout,
    out,
):  # fmt: skip
    """Walk all pixels of a band.

    Args:
        options: One WALK record, shape (1,).
        records, starts, lists, grid, peaks, stops: As `blend` takes them.
        paints: Three numbers of each splat from a column on, f32.
        keeps: 0 for a splat that only holds out, else 1, shape (n,) f32; or of no size.
        labels: Number of each splat's prim, shape (n,) i32; read only by WEIGH.
        covered: 1 where a surface shows behind the splats, shape (h, w) u8; or of no size.
        holdout: (offsets (h * w + 1,) i64, depths f32, transmittance up to each sample f32), sorted
            by depth in each pixel; the offsets of no size where there is none.
        out: (image (h, w, 4) f32: paint and coverage, through (h, w) f32: transmittance, ranks
            (h, w) i32, depths (h, w) f32, ids and weights (h, w, RANKS), counts (h, w) u32,
            offsets (h * w,) i64, deep (depth, back, color (n, 4)) f32). A mode writes its own:
            PAINT image and through; MEDIAN, which reads the image's coverage, ranks and depths;
            WEIGH ids and weights; COUNT counts; FILL, from each pixel's offset on, deep.
    """
    image, through, ranks, depths_out, ids, weights, counts, offsets, deep = out
    hold_offsets, hold_depths, hold_through = holdout
    for tile in prange(starts.shape[0] - 1):
        g, o = grid[0], options[0]
        left = g.left + tile % g.columns * TILE
        top = g.top + tile // g.columns * TILE
        begin, n = starts[tile], starts[tile + 1] - starts[tile]
        width = g.x1 - g.x0
        fields = np.empty((FIELDS, n), np.float32)
        spans = np.empty((2, n), np.int32)
        batch = np.ones((FIELDS + 3) * LOOK, np.float32)
        rows = np.empty(2 * LOOK, np.int32)
        loaded = 0
        bound = np.empty(n + 1, np.float32)
        window = n if o.by_ray else 0
        near = np.empty((TILE, window), np.float32)
        strength = np.empty((TILE, window), np.float32)
        ranked = np.empty((TILE, window), np.int32)
        if o.by_ray:
            bound[n] = np.float32(np.inf)
            for i in range(n):
                k = n - 1 - i
                peak = peaks[lists[begin + k]]
                bound[k] = min(bound[k + 1], peak[CENTER] - peak[REACH])
        prims = 0
        weighed = n if o.mode == WEIGH else 0
        known = np.full(o.prims if o.mode == WEIGH else 0, NONE, np.int32)
        local = np.empty(weighed, np.int32)
        names = np.empty(weighed, np.int32)
        if o.mode == WEIGH:
            for k in range(n):
                label = labels[lists[begin + k]]
                if known[label] < 0:
                    known[label], names[prims] = prims, label
                    prims += 1
                local[k] = known[label]
        table = np.zeros((min(weighed, o.prims), TILE), np.float32)
        state = np.zeros((TILE, STATE), np.float32)
        mark = np.zeros(TILE, np.int32)
        head, tail = np.zeros(TILE, np.int32), np.zeros(TILE, np.int32)
        alive = np.zeros(TILE, np.uint8)
        alphas, depths = np.zeros(TILE, np.float32), np.zeros(TILE, np.float32)
        for y in range(max(0, g.y0 - top), min(TILE, g.y1 - top)):
            row = top + y - g.y0
            living = 0
            state[:] = np.float32(0)
            table[:] = np.float32(0)
            head[:], tail[:], alive[:] = 0, 0, 0
            mark[:] = NONE if o.mode == MEDIAN else np.int32(0)
            for x in range(max(0, g.x0 - left), min(TILE, g.x1 - left)):
                s, column = state[x], left + x - g.x0
                s[THROUGH] = s[SEEN] = np.float32(1)
                alive[x] = 1
                if o.mode == MEDIAN:
                    whole = image[row, column, 3]
                    alive[x] = whole > np.float32(0)
                    if covered.shape[0] > 0 and covered[row, column] == 1:
                        whole = np.float32(1)
                    s[GOAL] = whole * o.part
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
                            fields[f, k + i] = batch[f * LOOK + i]
                        spans[0, k + i], spans[1, k + i] = rows[i], rows[LOOK + i]
                    loaded += count
                if spans[0, k] <= y < spans[1, k]:
                    rank = lists[begin + k]
                    dy = np.float32(y) - fields[1, k]
                    u, a, slope = fields[0, k], fields[2, k], fields[3, k] * dy
                    rest = fields[4, k] * dy * dy + fields[5, k]
                    for x in range(TILE):
                        alphas[x] = alpha_at(np.float32(x) - u, a, slope, rest)
                    if o.by_ray or stops.shape[0] > 0:
                        peak = peaks[rank]
                        first = np.float32(1) + peak[HX] * dy
                        for x in range(TILE):
                            depths[x] = peak_at(
                                np.float32(x) - u, peak[GX], peak[GY], first, peak[HY] * dy,
                                peak[HZ] * dy, peak[CENTER], peak[REACH], o.is_parallel,
                            )  # fmt: skip
                    center = records[rank, DEPTH]
                    for x in range(TILE):
                        if alive[x] == 0 or alphas[x] <= np.float32(0):
                            continue
                        column = left + x - g.x0
                        depth = depths[x] if o.by_ray else center
                        if stops.shape[0] > 0:
                            stop = stops[row, column]
                            if depths[x] > stop:
                                continue
                            depth = min(depth, stop)
                        if o.by_ray:
                            insert(
                                near[x], strength[x], ranked[x], head[x], tail[x], depth,
                                alphas[x], k,
                            )  # fmt: skip
                            tail[x] += 1
                            continue
                        pixel = row * width + column
                        held = np.float32(1)
                        if hold_offsets.shape[0] > 0:
                            held = held_through(
                                hold_offsets, hold_depths, hold_through, pixel, depth
                            )
                        goes_on = take(
                            o, state[x], mark, x, rank, alphas[x], depth, held,
                            keeps[rank] if keeps.shape[0] > 0 else np.float32(1), paints,
                            local[k] if o.mode == WEIGH else NONE, table,
                            offsets[pixel] if o.mode == FILL else np.int64(0), deep,
                        )  # fmt: skip
                        if not goes_on:
                            alive[x] = 0
                            living -= 1
                k += 1
                if o.by_ray and (k % FLUSH == 0 or k == n):
                    for x in range(TILE):
                        pixel = row * width + left + x - g.x0
                        while alive[x] and head[x] < tail[x] and near[x, head[x]] <= bound[k]:
                            at = head[x]
                            head[x] += 1
                            place, depth = ranked[x, at], near[x, at]
                            rank = lists[begin + place]
                            held = np.float32(1)
                            if hold_offsets.shape[0] > 0:
                                held = held_through(
                                    hold_offsets, hold_depths, hold_through, pixel, depth
                                )
                            goes_on = take(
                                o, state[x], mark, x, rank, strength[x, at], depth, held,
                                keeps[rank] if keeps.shape[0] > 0 else np.float32(1), paints,
                                local[place] if o.mode == WEIGH else NONE, table,
                                offsets[pixel] if o.mode == FILL else np.int64(0), deep,
                            )  # fmt: skip
                            if not goes_on:
                                alive[x] = 0
                                living -= 1
            for x in range(max(0, g.x0 - left), min(TILE, g.x1 - left)):
                s, column = state[x], left + x - g.x0
                pixel = row * width + column
                if o.mode == PAINT:
                    image[row, column, 0] = s[FIRST]
                    image[row, column, 1] = s[SECOND]
                    image[row, column, 2] = s[THIRD]
                    image[row, column, 3] = s[COVER]
                    through[row, column] = s[THROUGH]
                elif o.mode == MEDIAN:
                    ranks[row, column] = mark[x]
                    depths_out[row, column] = s[SEEN]
                elif o.mode == WEIGH:
                    strongest(table, prims, x, names, ids[row, column], weights[row, column])
                else:
                    at = offsets[pixel] if o.mode == FILL else np.int64(0)
                    count = close_run(o.mode, s, mark[x], at, deep)
                    if o.mode == COUNT:
                        counts[row, column] = count
