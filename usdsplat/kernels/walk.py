"""Compute all requested products of each pixel in one pass over its contributions.

`blend`, `median`, `weigh` and `deep` process splats in the order of their centres. This module can
also sort the contributions to each pixel by the depths at which its ray hits the splats. It
supports mattes, whose splats hide others without being drawn, and a holdout that hides in part,
whose transmittance reduces the weights of the contributions behind and within it.

`contributions` finds the contributions to one row of 16 pixels at a time, in their order. Sums,
medians, weights of prims and deep samples are computed from these rows.

Source: Radl et al. 2024, "StopThePop", for the order; OpenEXR's "Interpreting OpenEXR Deep Pixels".
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from .batch import FIELDS, LOOK, load_occluder_depth
from .bins import TILE
from .contributions import (
    SPLAT,
    gather_row,
    lay_out,
    least_depth,
    load_tile,
    pass_row,
)
from .deep import merge
from .feature import ALBEDO as ALBEDO_COLUMN
from .feature import AXIS, EXPECTED, FEATURES, NORMAL
from .jit import parallel, scalar
from .lane_keys import LINE, aligned, any_of, depths_of, look_up, place_of, sort_rows
from .lanes import bits, choose, load, lowest_bit, ramp, spread, store
from .project import RED
from .weigh import NONE, number_prims, strongest

COLOR, ALBEDO, NORMALS, DEPTHS, AXES, MEDIAN, FRONT, WEIGH, COUNT, FILL = (
    1 << k for k in range(10)
)
"""Products, as bits: sums of colours, albedos, normals, depths (with confidence and occlusion) and
thinnest axes over contributions; the contribution at which half of the coverage is reached; the
first contribution; the prims with the largest weights; the number of deep samples; the deep
samples."""
COLUMNS = 0, ALBEDO_COLUMN, NORMAL, EXPECTED, AXIS
"""First column of the features of each product, in the order of their bits, from ALBEDO on."""
HALF = np.float32(0.5)
"""Fraction of the coverage to reach for MEDIAN; FRONT uses 0."""


# --- 1. mathematics: 16 pixels, or one --------------------------------------------------


@scalar
def held_through(offsets, depths, through, pixel, depth):
    """Return the transmittance of a holdout in front of `depth`: log-linear between two nodes.

    Args:
        offsets, depths, through: The nodes, see `walk`.
    """
    first, end = offsets[pixel], offsets[pixel + 1]
    low, high = first, end
    while low < high:
        middle = (low + high) // 2
        if depths[middle] < depth:
            low = middle + 1
        else:
            high = middle
    if low == first:
        return np.float32(1)
    near = through[low - 1]
    if low == end or through[low] == near:
        return near
    ratio = through[low] / near
    if ratio <= np.float32(0):
        return np.float32(0)
    part = (depth - depths[low - 1]) / (depths[low] - depths[low - 1])
    return near * np.float32(math.exp(part * np.float32(math.log(ratio))))


@scalar
def sum_paints(keys, count, weights, paints, stride, first):
    """Return weighted sums of three numbers of each splat, for 16 pixels.

    Args:
        keys, weights: `count` rows, see `contributions`.
        paints: `stride` numbers of each splat of the tile, of which three are summed, from index
            `first` on.
    """
    red = spread(np.float32(0))
    green = blue = red
    for k in range(count):
        at = np.uint64(k * TILE)
        weight = load(weights, at)
        counts = weight > np.float32(0)
        if any_of(counts):
            here = look_up(keys, at, paints, stride, first, np.int64(0))
            red = choose(counts, red + weight * here, red)
            here = look_up(keys, at, paints, stride, first + np.int64(1), np.int64(0))
            green = choose(counts, green + weight * here, green)
            here = look_up(keys, at, paints, stride, first + np.int64(2), np.int64(0))
            blue = choose(counts, blue + weight * here, blue)
    return red, green, blue


@scalar
def find_part(keys, count, weights, goals, left, found, depths):
    """Find the contribution at which the coverage of each of 16 pixels reaches a given value.

    Args:
        keys, weights: `count` rows, see `contributions`.
        goals: Coverage to reach in each pixel.
        left: Mask of the pixels to process.
        found: Receives the index in the tile's list for each pixel, NONE if the value is not
            reached.
        depths: Receives the depth of each found contribution; entries 16 to 31 are scratch.
    """
    cover, goal, zero = spread(np.float32(0)), load(goals, np.uint64(0)), np.float32(0)
    for x in range(TILE):
        found[x], depths[x] = NONE, np.float32(1)
    for k in range(count):
        if left == np.uint64(0):
            break
        at = np.uint64(k * TILE)
        weight = load(weights, at)
        cover = cover + weight
        passed = bits((cover >= goal) & (weight > zero)) & left
        if passed == np.uint64(0):
            continue
        left &= ~passed
        store(depths, np.uint64(TILE), depths_of(keys, at))
        while passed != np.uint64(0):
            x = lowest_bit(passed)
            passed &= passed - np.uint64(1)
            found[x] = np.int32(place_of(keys[at + x]))
            depths[x] = depths[x + np.uint64(TILE)]


# --- 2. CPU ----------------------------------------------------------------------------


@scalar
def load_paints_of(paints, column, numbers, lists, begin, out):
    """Copy `numbers` columns of each splat of a tile, from `column` on."""
    for k in range(out.shape[0] // numbers):
        rank = lists[begin + k]
        for c in range(numbers):
            out[k * numbers + c] = paints[rank, column + c]


@scalar
def hold_out(keys, count, weights, keeps, lists, begin, holdout, pixel, x0, x1, scratch):
    """Multiply the weights of a row of pixels by `keeps` and the transmittance of the holdout.

    Args:
        keys, weights: `count` rows, see `contributions`.
        keeps, holdout: See `walk`.
        pixel: Index in `holdout` of the pixel in column `x0`.
        x0, x1: First column of the tile that is drawn, and one past the last.
        scratch: 16 numbers.
    """
    offsets, depths, through = holdout
    for k in range(count):
        at = np.uint64(k * TILE)
        store(scratch, np.uint64(0), depths_of(keys, at))
        for x in range(x0, x1):
            j = at + np.uint64(x)
            if weights[j] <= np.float32(0):
                continue
            if len(keeps) > 0:
                weights[j] *= keeps[lists[begin + place_of(keys[j])]]
            if offsets.shape[0] > 0:
                weights[j] *= held_through(offsets, depths, through, pixel + x - x0, scratch[x])


@parallel(writes=("out",), gpu="walk.walk")
def walk(
    options, records, features, keeps, labels, starts, lists, grid, ray_hits, occluder_depth,
    covered, holdout, out,
):  # fmt: skip
    """Compute the requested products of all pixels of a band.

    Args:
        options: (products as bits; whether pixels are sorted by their ray hits; whether rays are
            parallel; number of prims; maximum change of the opacity in front of any depth by
            merging; depth of the near plane, to which ray hits in front of it are clamped).
        records, starts, lists, grid, ray_hits, occluder_depth: See `blend`.
        features: Result of `feature.features`; not read for COLOR alone.
        keeps: 0 for splats of mattes, 1 for others, shape (n,) f32; empty without mattes.
        labels: Number of each splat's prim, shape (n,) i32; read only for WEIGH.
        covered: 1 where a surface is visible behind the splats, shape (h, w) u8; empty without
            surfaces.
        holdout: Nodes of the transmittance along each pixel's ray: (offsets (h * w + 1,) i64,
            depths f32, transmittances f32), sorted by depth in each pixel. It is 1 in front of the
            first node, log-linear between two, and constant behind the last; two nodes of equal
            depth are a step. The offsets are empty without a holdout.
        out: (color, albedo, normals, depth sums, axes, each (h, w, 4) f32: three numbers and
            coverage; through (h, w) f32: transmittance; median (ranks (h, w) i32, depths (h, w)
            f32); front likewise; prims (ids (h, w, ranks) i32, weights f32); counts (h, w) u32;
            offsets (h * w,) i64; deep (depth, back, color (n, 4)) f32). Arrays of products that
            are not requested are empty.

    COLOR also writes `through`. FILL writes `deep`, starting at the offset of each pixel. If there
    are surfaces, and mattes or a holdout, FILL also writes `through`: the transmittance of mattes
    and holdout to the surface.
    """
    images, (through, median, front, prims_out, counts, offsets, deep) = out[:5], out[5:]
    median_ranks, median_depths = median
    front_ranks, front_depths = front
    ids, prim_weights = prims_out
    hold_offsets, hold_depths, hold_through = holdout
    deep_near, deep_far, deep_color = deep
    wants, sorts, is_parallel, known_prims, error, near = options
    for tile in prange(starts.shape[0] - 1):
        g = grid[0]
        left = g.left + tile % g.columns * TILE
        top = g.top + tile // g.columns * TILE
        x0, x1 = max(0, g.x0 - left), min(TILE, g.x1 - left)
        begin, n = starts[tile], starts[tile + 1] - starts[tile]
        width = g.x1 - g.x0
        xs, zero, one = ramp(), np.float32(0), np.uint64(1)
        inside = (xs >= np.float32(x0)) & (xs < np.float32(x1))
        has_occluders, holds, has_keeps = (
            occluder_depth.shape[0] > 0,
            hold_offsets.shape[0] > 0,
            len(keeps) > 0,
        )
        stop = np.empty(TILE * TILE if has_occluders else 0, np.float32)
        if has_occluders:
            load_occluder_depth(occluder_depth, top, left, g, stop)
        fields = np.empty(SPLAT * n, np.float32)
        batch = np.ones(FIELDS * LOOK, np.float32)
        rows = np.empty(2 * LOOK, np.float32)
        load_tile(records, ray_hits, lists, begin, left, top, fields, batch, rows)
        least = np.empty(n if sorts else 0, np.float32)
        order = np.arange(n)
        if sorts:
            for k in range(n):
                least[k] = least_depth(fields, k * SPLAT, is_parallel)
            order = np.argsort(least)
        spans = np.empty(2 * ((n + TILE - 1) // TILE * TILE), np.float32)
        lay_out(fields, order, spans)
        colors = np.empty(3 * n if wants & (COLOR | FILL) else 0, np.float32)
        load_paints_of(records, RED, 3, lists, begin, colors)
        has_features = wants & (ALBEDO | NORMALS | DEPTHS | AXES)
        featured = np.empty(FEATURES * n if has_features else 0, np.float32)
        load_paints_of(features, 0, FEATURES, lists, begin, featured)
        weighed = n if wants & WEIGH else 0
        known = np.full(known_prims if weighed else 0, NONE, np.int32)
        local, names = np.empty(weighed, np.int32), np.empty(weighed, np.int32)
        prims = number_prims(labels, lists, begin, weighed, known, local, names)
        table = np.empty(TILE * prims, np.float32)
        size = TILE * n
        alphas = aligned(np.empty(size + LINE, np.float32), size)
        weights = aligned(np.empty(size + LINE, np.float32), size)
        hits = aligned(np.empty(size + LINE, np.float32), size)
        keys = aligned(np.empty(size + LINE, np.int64), size)
        places = np.empty(n if sorts else 0, np.int64)
        planes = np.empty(5 * TILE, np.float32)
        goals, found = np.empty(TILE, np.float32), np.empty(TILE, np.int32)
        last = np.empty(TILE, np.int64)
        for y in range(max(0, g.y0 - top), min(TILE, g.y1 - top)):
            row, first = top + y - g.y0, left + x0 - g.x0
            pixel = row * width + first
            count = gather_row(
                y, fields, order, spans, least, stop, near, is_parallel, sorts, inside, places,
                hits, alphas, keys,
            )  # fmt: skip
            if sorts:
                sort_rows(keys, count)
            count, dim = pass_row(keys, count, alphas, inside, sorts, weights)
            if has_keeps or holds:
                hold_out(keys, count, weights, keeps, lists, begin, holdout, pixel, x0, x1, planes)
            cover = spread(zero)
            for k in range(count):
                cover = cover + load(weights, np.uint64(k * TILE))
            store(planes, np.uint64(3 * TILE), cover)
            store(planes, np.uint64(4 * TILE), dim)
            if wants & (COLOR | ALBEDO | NORMALS | DEPTHS | AXES):
                for each in range(5):
                    if not wants & (1 << each):
                        continue
                    red = spread(zero)
                    green = blue = red
                    if each == 0:
                        red, green, blue = sum_paints(keys, count, weights, colors, 3, 0)
                    else:
                        red, green, blue = sum_paints(
                            keys, count, weights, featured, FEATURES, COLUMNS[each]
                        )
                    if each == 3:
                        red = spread(zero)
                        for k in range(count):
                            at = np.uint64(k * TILE)
                            weight = load(weights, at)
                            more = red + weight * depths_of(keys, at)
                            red = choose(weight > zero, more, red)
                    store(planes, np.uint64(0), red)
                    store(planes, np.uint64(TILE), green)
                    store(planes, np.uint64(2 * TILE), blue)
                    for x in range(x0, x1):
                        for c in range(4):
                            images[each][row, first + x - x0, c] = planes[c * TILE + x]
            if wants & COLOR:
                for x in range(x0, x1):
                    through[row, first + x - x0] = planes[4 * TILE + x]
            if wants & (MEDIAN | FRONT):
                some = np.uint64(0)
                for x in range(x0, x1):
                    whole = planes[3 * TILE + x]
                    if whole > zero:
                        some |= one << np.uint64(x)
                    if covered.shape[0] > 0 and covered[row, first + x - x0] == 1:
                        beyond = planes[4 * TILE + x]
                        if holds:
                            beyond *= held_through(
                                hold_offsets, hold_depths, hold_through, pixel + x - x0,
                                occluder_depth[row, first + x - x0],
                            )  # fmt: skip
                        whole += beyond
                    goals[x] = whole * HALF
                if wants & MEDIAN:
                    find_part(keys, count, weights, goals, some, found, planes)
                    for x in range(x0, x1):
                        rank = lists[begin + found[x]] if found[x] >= 0 else NONE
                        median_ranks[row, first + x - x0] = rank
                        median_depths[row, first + x - x0] = planes[x]
                if wants & FRONT:
                    goals[:] = zero
                    find_part(keys, count, weights, goals, some, found, planes)
                    for x in range(x0, x1):
                        rank = lists[begin + found[x]] if found[x] >= 0 else NONE
                        front_ranks[row, first + x - x0] = rank
                        front_depths[row, first + x - x0] = planes[x]
            if wants & WEIGH:
                table[:] = zero
                for k in range(count):
                    at = np.uint64(k * TILE)
                    there = bits(load(weights, at) > zero)
                    while there != np.uint64(0):
                        x = lowest_bit(there)
                        there &= there - one
                        label = local[place_of(keys[at + x])]
                        table[np.uint64(label * TILE) + x] += weights[at + x]
                for x in range(x0, x1):
                    strongest(table, x, prims, names, ids, prim_weights, row, first + x - x0)
            if wants & (COUNT | FILL):
                seen, run = spread(np.float32(1)), spread(zero)
                samples = run
                if wants & FILL:
                    for x in range(x0, x1):
                        last[x] = offsets[pixel + x - x0] - 1
                for k in range(count):
                    at = np.uint64(k * TILE)
                    weight = load(weights, at)
                    seen, run, own, begins = merge(seen, run, weight, error)
                    samples = samples + begins
                    if not wants & FILL:
                        continue
                    store(planes, np.uint64(0), own)
                    store(planes, np.uint64(TILE), begins)
                    store(planes, np.uint64(2 * TILE), depths_of(keys, at))
                    there = bits(weight > zero)
                    while there != np.uint64(0):
                        x = lowest_bit(there)
                        there &= there - one
                        paint = 3 * place_of(keys[at + x])
                        depth = planes[x + np.uint64(2 * TILE)]
                        if planes[x + np.uint64(TILE)] > zero:
                            last[x] += 1
                            deep_near[last[x]] = depth
                            for c in range(4):
                                deep_color[last[x], c] = zero
                        j = last[x]
                        deep_far[j] = depth
                        part = (np.float32(1) - deep_color[j, 3]) * planes[x]
                        for c in range(3):
                            deep_color[j, c] += part * colors[paint + c]
                        deep_color[j, 3] += part
                store(planes, np.uint64(0), samples)
                store(planes, np.uint64(TILE), seen)
                for x in range(x0, x1):
                    if wants & COUNT:
                        counts[row, first + x - x0] = np.uint32(planes[x])
                    elif has_occluders and (has_keeps or holds):
                        beyond = planes[4 * TILE + x] / planes[TILE + x]
                        if holds:
                            beyond *= held_through(
                                hold_offsets, hold_depths, hold_through, pixel + x - x0,
                                occluder_depth[row, first + x - x0],
                            )  # fmt: skip
                        through[row, first + x - x0] = min(beyond, np.float32(1))
