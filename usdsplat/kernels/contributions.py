"""Find the contributions to a row of 16 pixels, each pixel's in its own order.

Where pixels are sorted by their ray hits, the list of a tile is taken in the order of the least
depth at which a ray of the tile may hit each splat. No splat that is still to come is hit in front
of that depth, so a row of pixels is complete as soon as what lies in front of it has ended all 16
pixels. Then the keys of the row are sorted, see `lane_keys`: the order is exact, and there is no
cap on how many contributions wait.

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
"""Floats of a splat of a tile: u v a b c ln(opacity), as `batch` has them; its ray hit; the first
row of the tile that it touches and one past the last; depth of its centre."""
HIT, FIRST, LAST, MIDDLE = 6, 13, 14, 15
ENDED = np.float32(0.99) * END
"""A transmittance that has passed END, however products are rounded."""


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
    """Fetch all splats of a tile.

    Args:
        lists: The tile's list begins at `begin`.
        left, top: Of the tile [pixel].
        fields: Receives SPLAT floats of each, in the order of the list.
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
    """Write the rows that splats touch, in the order in which they are taken.

    Args:
        fields: What `load_tile` made.
        order: Places in the list, shape (n,).
        spans: Receives first rows, then those past the last, each padded to whole lanes with rows
            that nothing touches.
    """
    n, padded = order.shape[0], spans.shape[0] // 2
    for k in range(padded):
        spans[k] = spans[padded + k] = np.float32(-1)
        if k < n:
            at = order[k] * SPLAT
            spans[k], spans[padded + k] = fields[at + FIRST], fields[at + LAST]


@scalar
def is_complete(settled, count, places, depths, alphas, bound, product):
    """Take what lies in front of `bound` into the transmittance of a row of pixels.

    Args:
        settled: How many rows of `depths` were in front of it before.
        count: How many rows there are.
        places, depths, alphas: As `gather_row` has them.
        bound: Nothing that is still to come is in front of this depth.
        product: Transmittance of the first `settled` rows.

    Returns:
        How many rows are in front now, their transmittance, and that of all contributions in front.
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
    """Evaluate the splats of a tile at a row of 16 pixels, until the pixels have ended.

    Args:
        y: Row of the tile.
        fields, order, spans: What `load_tile` and `lay_out` made.
        least: `least_depth` of each splat, if `sorts`.
        stop: Depths of surfaces in the row, +inf where there are none, or of no size.
        near: Depth of the near plane.
        sorts: Whether pixels are sorted by their ray hits.
        inside: Mask of the pixels that are drawn.
        places: Receives the place in the list of each row of `depths`.
        depths: Receives 16 depths, -FAR where a splat does not contribute, if `sorts`.
        alphas: Receives 16 contributions for each place in the list.
        keys: Receives 16 keys; depths are FAR where a splat does not contribute.

    Returns:
        How many rows of keys there are.
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
    """Let light pass through the contributions to a row of 16 pixels, in the order of the keys.

    Args:
        keys, alphas: What `gather_row` made; `count` rows.
        sorts: Whether keys are sorted, those that do not contribute at the end.
        inside: Mask of the pixels that are drawn.
        weights: Receives what each contribution weighs, 0 from the end of a pixel on.

    Returns:
        How many rows of weights there are, and the transmittance of all.
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
