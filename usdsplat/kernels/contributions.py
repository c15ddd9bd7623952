"""Find the contributions to a row of 16 pixels, each pixel's in its own order.

If pixels are sorted by ray hits, the list of a tile is processed in the order of the least depth at
which a ray of the tile may hit each splat. No later splat is hit in front of the least depth of the
next one. A row of pixels is therefore complete as soon as the contributions in front of that depth
have saturated all 16 pixels. Then the keys of the row are sorted, see `lane_keys`. The order is
exact, and the number of waiting contributions is not limited.

Source: Radl et al. 2024, "StopThePop", for the order.
"""

from __future__ import annotations

import numpy as np

from .batch import FIELDS, LOOK, load_batch
from .bins import TILE
from .blend import END, alphas_at, ray_hits_at
from .jit import scalar
from .lane_keys import FAR, any_of, depths_of, look_up, store_keys
from .lanes import bits, choose, higher, load, lower, lowest_bit, ramp, size, spread, store
from .project import DEPTH
from .ray_hit import CENTER, GX, GY, HX, HY, HZ, REACH, least_hit, row_at

SPLAT = 16
"""Floats of a splat of a tile: u v a b c ln(opacity), as in `batch`; its ray hit; the first row of
the tile that it touches, and one past the last; depth of its centre."""
HIT, FIRST, LAST, MIDDLE = 6, 13, 14, 15
ENDED = np.float32(0.99) * END
"""Transmittance below which a pixel is certainly saturated, for any rounding of products."""


# --- 1. mathematics: one splat in one tile ----------------------------------------------


@scalar
def least_depth(fields, splat, is_parallel):
    """Return a depth in front of which no ray of a tile hits the splat of fields[splat:]."""
    hit = splat + HIT
    return least_hit(
        fields[splat], fields[splat + 1], np.float32(TILE - 1), fields[hit + GX], fields[hit + GY],
        fields[hit + HX], fields[hit + HY], fields[hit + HZ], fields[hit + CENTER],
        fields[hit + REACH], is_parallel,
    )  # fmt: skip


# --- 2. CPU ----------------------------------------------------------------------------


@scalar
def load_tile(records, ray_hits, lists, begin, left, top, fields, batch, rows):
    """Load all splats of a tile.

    Args:
        lists: The tile's list begins at `begin`.
        left, top: First column and row of the tile [pixel].
        fields: Receives SPLAT floats of each splat, in the order of the list.
        batch, rows: Scratch of `load_batch`.
    """
    n = fields.shape[0] // SPLAT
    for first in range(0, n, LOOK):
        count = min(LOOK, n - first)
        load_batch(
            records, lists, begin + first, count, np.float32(left), np.float32(top), batch, rows
        )
        for i in range(count):
            at = (first + i) * SPLAT
            rank = lists[begin + first + i]
            for f in range(FIELDS - 1):
                fields[at + f] = batch[f * LOOK + i]
            for f in range(REACH + 1 if ray_hits.shape[0] > 0 else 0):
                fields[at + HIT + f] = ray_hits[rank, f]
            fields[at + FIRST], fields[at + LAST] = rows[i], rows[LOOK + i]
            fields[at + MIDDLE] = records[rank, DEPTH]


@scalar
def lay_out(fields, order, spans):
    """Write the rows that splats touch, in the order of processing.

    Args:
        fields: Result of `load_tile`.
        order: Indices in the list, shape (n,).
        spans: Receives first rows, then rows past the last, each padded to whole lanes with empty
            ranges.
    """
    n, padded = order.shape[0], spans.shape[0] // 2
    for k in range(padded):
        spans[k] = spans[padded + k] = np.float32(-1)
        if k < n:
            at = order[k] * SPLAT
            spans[k], spans[padded + k] = fields[at + FIRST], fields[at + LAST]


@scalar
def is_complete(settled, count, places, depths, alphas, bound, product):
    """Multiply the contributions in front of `bound` into the transmittance of a row of pixels.

    Args:
        settled: Number of rows of `depths` that were in front of earlier bounds.
        count: Number of rows.
        places, depths, alphas: See `gather_row`.
        bound: Depth in front of which no later splat is hit.
        product: Transmittance of the first `settled` rows.

    Returns:
        Number of rows that are now in front, their transmittance, and that of all contributions in
        front.
    """
    whole = product
    for k in range(settled, count):
        is_front = load(depths, np.uint64(k * TILE)) < bound
        alpha = load(alphas, np.uint64(places[k] * TILE))
        whole = whole * (np.float32(1) - choose(is_front, alpha, np.float32(0)))
        if k == settled and bits(is_front) == np.uint64(0xFFFF):
            settled, product = k + 1, whole
    return settled, product, whole


@scalar
def gather_row(
    y, fields, order, spans, least, stop, near, is_parallel, sorts, inside, places, depths, alphas,
    keys,
):  # fmt: skip
    """Evaluate the splats of a tile at a row of 16 pixels, until the pixels are saturated.

    Args:
        y: Row of the tile.
        fields, order, spans: Results of `load_tile` and `lay_out`.
        least: `least_depth` of each splat, if `sorts`.
        stop: Depths of surfaces in the row, +inf where there are none, or empty.
        near: Depth of the near plane.
        sorts: Whether pixels are sorted by their ray hits.
        inside: Mask of the pixels that are drawn.
        places: Receives the index in the list for each row of `depths`.
        depths: Receives 16 depths, -FAR where a splat does not contribute, if `sorts`.
        alphas: Receives 16 contributions for each index in the list.
        keys: Receives 16 keys for each row; depths are FAR where a splat does not contribute.

    Returns:
        Number of rows of keys.
    """
    zero, one = np.float32(0), np.uint64(1)
    xs, count, padded = ramp(), 0, spans.shape[0] // 2
    dim, settled = choose(inside, np.float32(1), zero), 0
    front, whole = dim, dim
    n, row = order.shape[0], np.float32(y)
    for k in range(0, padded, TILE):
        at = np.uint64(k)
        touched = bits((load(spans, at) <= row) & (load(spans, at + np.uint64(padded)) > row))
        while touched != np.uint64(0):
            i = lowest_bit(touched)
            touched &= touched - one
            place = order[at + i]
            f = np.uint64(place * SPLAT)
            dx, dy = xs - fields[f], row - fields[f + np.uint64(1)]
            slope = fields[f + np.uint64(3)] * dy
            rest = fields[f + np.uint64(4)] * dy * dy + fields[f + np.uint64(5)]
            alpha = alphas_at(dx, fields[f + np.uint64(2)], slope, rest)
            depth = spread(fields[f + np.uint64(MIDDLE)])
            if sorts or stop.shape[0] > 0:
                h = f + np.uint64(HIT)
                d0, d1, d2 = row_at(
                    fields[h + np.uint64(HX)], fields[h + np.uint64(HY)],
                    fields[h + np.uint64(HZ)], dy,
                )  # fmt: skip
                hit = ray_hits_at(
                    dx, fields[h], fields[h + np.uint64(GY)], d0, d1, d2,
                    fields[h + np.uint64(CENTER)], fields[h + np.uint64(REACH)], is_parallel,
                )  # fmt: skip
                if sorts:
                    depth = higher(hit, near)
                if stop.shape[0] > 0:
                    behind = load(stop, np.uint64(y * TILE))
                    alpha = choose(hit <= behind, alpha, zero)
                    depth = lower(depth, behind)
            contributes = alpha > zero
            if not any_of(contributes & (whole >= ENDED)):
                continue
            store(alphas, np.uint64(place * TILE), alpha)
            store_keys(keys, np.uint64(count * TILE), choose(contributes, depth, FAR), place)
            if sorts:
                places[count] = place
                store(depths, np.uint64(count * TILE), choose(contributes, depth, -FAR))
            dim = dim * (np.float32(1) - alpha)
            count += 1
        if any_of(dim >= ENDED):
            continue
        if not sorts:
            break
        if k + TILE < n:
            settled, front, whole = is_complete(
                settled, count, places, depths, alphas, least[order[k + TILE]], front
            )
            if not any_of(whole >= ENDED):
                break
    return count


@scalar
def pass_row(keys, count, alphas, inside, sorts, weights):
    """Compute the weights of the contributions to a row of 16 pixels, in the order of the keys.

    Args:
        keys, alphas: Results of `gather_row`; `count` rows.
        sorts: Whether keys are sorted, with those that do not contribute at the end.
        inside: Mask of the pixels that are drawn.
        weights: Receives the weight of each contribution, 0 after a pixel is saturated.

    Returns:
        Number of rows of weights, and the transmittance of all contributions.
    """
    zero = np.float32(0)
    through = choose(inside, np.float32(1), -np.float32(1))
    end = 0
    for k in range(count):
        at = np.uint64(k * TILE)
        alpha = look_up(keys, at, alphas, np.int64(TILE), np.int64(0), np.int64(1))
        is_left = through > zero
        if sorts:
            is_left = is_left & (depths_of(keys, at) < FAR)
        if not any_of(is_left):
            break
        weight = alpha * through
        remains = through - weight
        goes_on = remains >= END
        store(weights, at, choose(goes_on, weight, zero))
        through = choose(goes_on, remains, -size(through))
        end = k + 1
    return end, size(through)
