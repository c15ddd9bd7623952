"""Count the samples of deep pixels in the order of centres, or write them where they belong.

`walk` does this for any order and any holdout. Here, as in `blend`, 16 pixels are treated at a
time, also while contributions are merged; only finished samples are written one by one. Counting
and writing are one function, compiled once, so that they cannot disagree about a sample.

Source: OpenEXR's "Interpreting OpenEXR Deep Pixels", for what a sample and a merged one mean.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from .batch import FIELDS, LOOK, lay_row, load_batch, load_paints
from .bins import TILE
from .blend import END, alphas_at
from .jit import parallel, scalar, serial
from .lane_keys import any_of
from .lanes import bits, choose, fused, lower, lowest_bit, ramp, size, spread, store
from .project import DEPTH

BATCH = (FIELDS + 3) * LOOK
"""Floats of a batch of splats and their paint."""


# --- 1. mathematics: one splat over one row of 16 pixels --------------------------------


@scalar
def merge(seen, run, weight, error):
    """Put a contribution into the samples of 16 deep pixels.

    Args:
        seen: Transmittance of the samples so far; run: weight of the run that is merged.
        weight: Of the contribution, 0 where it does not count.
        error: By how much merging may change the opacity in front of any depth.

    Returns:
        (seen, run) behind the contribution; its opacity behind what is in front, 0 where it does
        not count; whether a sample begins with it, 1 or 0.
    """
    zero, one = np.float32(0), np.float32(1)
    own = lower(weight / seen, one)
    seen = fused(-seen, own, seen)
    total = run + weight
    begins = choose(run <= zero, one, choose(total > error, one, zero))
    begins = choose(weight > zero, begins, zero)
    run = choose(begins > zero, weight, total)
    return seen, run, own, begins


# --- 2. CPU ----------------------------------------------------------------------------


@scalar
def store_samples(planes, red, green, blue, cover, front, back):
    """Lay the samples that are made of 16 pixels out in memory."""
    store(planes, np.uint64(0), red)
    store(planes, np.uint64(TILE), green)
    store(planes, np.uint64(2 * TILE), blue)
    store(planes, np.uint64(3 * TILE), cover)
    store(planes, np.uint64(4 * TILE), front)
    store(planes, np.uint64(5 * TILE), back)


@scalar
def write_samples(planes, done, last, near, far, color):
    """Write finished samples, and go on to the next place.

    Args:
        planes: What `store_samples` laid out.
        done: Bits of the pixels whose samples are finished.
        last: Places of the samples.
        near, far, color: As `deep` takes them.
    """
    while done != np.uint64(0):
        x = lowest_bit(done)
        done &= done - np.uint64(1)
        j = np.uint64(last[x])
        last[x] += 1
        near[j] = planes[x + np.uint64(4 * TILE)]
        far[j] = planes[x + np.uint64(5 * TILE)]
        for c in range(4):
            color[j, c] = planes[x + np.uint64(c * TILE)]


@serial(writes=("offsets",), gpu="deep.place")
def place(counts, offsets):
    """Find where the samples of each pixel go; returns how many there are.

    Args:
        counts: Samples of each pixel, shape (h, w) u32.
        offsets: Receives how many come before each pixel, and all of them, shape (h * w + 1,) i64.
    """
    total = np.int64(0)
    for row in range(counts.shape[0]):
        for column in range(counts.shape[1]):
            offsets[row * counts.shape[1] + column] = total
            total += np.int64(counts[row, column])
    offsets[counts.size] = total
    return total


@parallel(writes=("counts", "near", "far", "color"), gpu="deep.deep")
def deep(
    records, starts, lists, grid, column, error, writes, offsets, counts, near, far, color
):  # fmt: skip
    """Count the samples of all pixels of a band, or write them.

    Args:
        records, starts, lists, grid: As `blend` takes them; the paint is in the records from
            `column` on.
        error: By how much merging may change the opacity in front of any depth, f32.
        writes: Whether to write; else counts are.
        offsets: Where the samples of each pixel go, as `place` says; read if `writes`.
        counts: Receives how many there are, shape (h, w) u32.
        near, far, color: Receive depths of both ends, shape (n,) f32, and premultiplied RGBA, shape
            (n, 4) f32, if `writes`. `near` and `far` may be one array where nothing is merged.
    """
    for tile in prange(starts.shape[0] - 1):
        g = grid[0]
        left = g.left + tile % g.columns * TILE
        top = g.top + tile // g.columns * TILE
        x0, x1 = max(0, g.x0 - left), min(TILE, g.x1 - left)
        width = g.x1 - g.x0
        xs, zero, one = ramp(), np.float32(0), np.uint64(1)
        inside = (xs >= np.float32(x0)) & (xs < np.float32(x1))
        begin, n = starts[tile], starts[tile + 1] - starts[tile]
        batches = np.ones((n + LOOK - 1) // LOOK * BATCH, np.float32)
        spans = np.empty((n + LOOK - 1) // LOOK * 2 * LOOK, np.float32)
        slopes, loaded = np.empty(2 * LOOK, np.float32), 0
        depths, planes = np.empty(n, np.float32), np.empty(6 * TILE, np.float32)
        last = np.empty(TILE, np.int64)
        # Row by row: the samples of 16 pixels stay in the cache until all of them are there.
        for y in range(max(0, g.y0 - top), min(TILE, g.y1 - top)):
            row, first_pixel = top + y - g.y0, left + x0 - g.x0
            if writes:  # the place of the sample that is made of each pixel
                for x in range(x0, x1):
                    last[x] = offsets[row * width + first_pixel + x - x0]
            through = choose(inside, np.float32(1), -np.float32(1))
            seen, run, samples = spread(np.float32(1)), spread(zero), spread(zero)
            red = green = blue = cover = front = back = spread(zero)
            opened = np.uint64(0)
            for first in range(0, n, LOOK):
                if not any_of(through > zero):
                    break
                count = min(LOOK, n - first)
                batch = batches[first // LOOK * BATCH : (first // LOOK + 1) * BATCH]
                rows = spans[2 * first : 2 * (first + LOOK)]
                if first == loaded:
                    load_batch(
                        records, lists, begin + first, count, np.float32(left), np.float32(top),
                        batch, rows,
                    )  # fmt: skip
                    load_paints(records, column, lists, begin + first, count, batch)
                    for i in range(count):
                        depths[first + i] = records[lists[begin + first + i], DEPTH]
                    loaded += LOOK
                there = ~np.uint64(0) >> np.uint64(64 - count)
                touched = lay_row(batch, rows, np.float32(y), slopes) & there
                while touched != np.uint64(0):
                    i = lowest_bit(touched)
                    touched &= touched - one
                    alpha = alphas_at(
                        xs - batch[i], batch[i + np.uint64(2 * LOOK)], slopes[i],
                        slopes[i + np.uint64(LOOK)],
                    )  # fmt: skip
                    weight = alpha * through
                    remains = through - weight
                    goes_on = remains >= END
                    weight = choose(goes_on, weight, zero)
                    through = choose(goes_on, remains, -size(through))
                    seen, run, own, begins = merge(seen, run, weight, error)
                    if not writes:
                        samples = samples + begins
                        continue
                    counted, begun = own > zero, begins > zero
                    done = bits(begun) & opened
                    if done != np.uint64(0):
                        store_samples(planes, red, green, blue, cover, front, back)
                        write_samples(planes, done, last, near, far, color)
                    opened |= bits(begun)
                    depth = depths[np.uint64(first) + i]
                    here = batch[i + np.uint64(7 * LOOK)]
                    part = (np.float32(1) - cover) * own
                    red = choose(begun, own * here, choose(counted, red + part * here, red))
                    here = batch[i + np.uint64(8 * LOOK)]
                    green = choose(begun, own * here, choose(counted, green + part * here, green))
                    here = batch[i + np.uint64(9 * LOOK)]
                    blue = choose(begun, own * here, choose(counted, blue + part * here, blue))
                    cover = choose(begun, own, cover + part)
                    front, back = choose(begun, depth, front), choose(counted, depth, back)
            if writes:
                store_samples(planes, red, green, blue, cover, front, back)
                write_samples(planes, opened, last, near, far, color)
            if not writes:
                store(planes, np.uint64(0), samples)
                for x in range(x0, x1):
                    counts[row, first_pixel + x - x0] = np.uint32(planes[x])
