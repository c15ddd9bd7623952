"""The samples of deep pixels in the order of centres: counted, then written where they belong.

`walk` can do this for any order and any holdout, one contribution to one pixel after the other.
Here, as in `blend`, 16 pixels go at a time, and only what is written is written one by one.
Counting and writing are one function, compiled once, so that they cannot disagree about a sample.

Source: OpenEXR's "Interpreting OpenEXR Deep Pixels", for what a sample and a merged one mean.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from .batch import FIELDS, LOOK, lay_row, load_batch, load_paints
from .bins import TILE
from .blend import END, alphas_at
from .jit import parallel, scalar, serial
from .lanes import bits, choose, fused, load, lower, lowest_bit, ramp, size, store
from .project import DEPTH

STATE = 3
ROW = STATE * TILE
"""Floats of a row of a tile's state, 16 pixels each: transmittance, negative where it has ended;
transmittance of the samples so far; weight of the run that is merged."""
SEEN, RUN = np.uint64(TILE), np.uint64(2 * TILE)


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
        y0, y1 = max(0, g.y0 - top), min(TILE, g.y1 - top)
        width = g.x1 - g.x0
        xs, zero, one = ramp(), np.float32(0), np.uint64(1)
        inside = (xs >= np.float32(x0)) & (xs < np.float32(x1))
        state = np.zeros(TILE * ROW, np.float32)
        live = np.zeros(TILE, np.uint8)
        merges = error > zero
        samples = np.zeros(TILE * TILE, np.float32)
        last = np.empty(TILE * TILE, np.int64)
        held = np.int64(0)
        for y in range(y0, y1):
            at = np.uint64(y * ROW)
            store(state, at, choose(inside, np.float32(1), -np.float32(1)))
            store(state, at + SEEN, choose(inside, np.float32(1), np.float32(1)))
            live[y] = 1
            if writes:  # the place of each pixel's last sample so far, in the tile
                pixel = (top + y - g.y0) * width + left + x0 - g.x0
                for x in range(x0, x1):
                    last[y * TILE + x] = held + offsets[pixel + x - x0] - offsets[pixel] - 1
                held += offsets[pixel + x1 - x0] - offsets[pixel]
        alive = y1 - y0
        # Samples go to memory in the order of splats, all over a tile: first within the cache.
        nears, fars = np.empty(held, np.float32), np.empty(held if merges else 0, np.float32)
        colors = np.empty((held, 4), np.float32)
        batch = np.ones((FIELDS + 3) * LOOK, np.float32)
        rows = np.empty(2 * LOOK, np.float32)
        slopes = np.empty(2 * LOOK, np.float32)
        owns, begun = np.empty(TILE, np.float32), np.empty(TILE, np.float32)
        end = starts[tile + 1]
        for first in range(starts[tile], end, LOOK):
            if alive == 0:
                break
            count = min(LOOK, end - first)
            load_batch(records, lists, first, count, np.float32(left), np.float32(top), batch, rows)
            if writes:
                load_paints(records, column, lists, first, count, batch)
            there = ~np.uint64(0) >> np.uint64(64 - count)
            for y in range(y0, y1):
                if live[y] == 0:
                    continue
                touched = lay_row(batch, rows, np.float32(y), slopes) & there
                at = np.uint64(y * ROW)
                through, seen, run = load(state, at), load(state, at + SEEN), load(state, at + RUN)
                total = load(samples, np.uint64(y * TILE))
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
                        total = total + begins
                        continue
                    written = bits(own > zero)
                    store(owns, np.uint64(0), own)
                    store(begun, np.uint64(0), begins)
                    depth = records[np.uint64(lists[first + np.int64(i)]), DEPTH]
                    red, green = batch[i + np.uint64(7 * LOOK)], batch[i + np.uint64(8 * LOOK)]
                    blue = batch[i + np.uint64(9 * LOOK)]
                    while written != np.uint64(0):
                        x = lowest_bit(written)
                        written &= written - one
                        pixel = np.uint64(y * TILE) + x
                        part = owns[x]
                        if begun[x] > zero:
                            last[pixel] += 1
                            j = np.uint64(last[pixel])
                            nears[j] = depth
                            colors[j, 0], colors[j, 1] = part * red, part * green
                            colors[j, 2], colors[j, 3] = part * blue, part
                        else:
                            j = np.uint64(last[pixel])
                            part = (np.float32(1) - colors[j, 3]) * part
                            colors[j, 0] += part * red
                            colors[j, 1] += part * green
                            colors[j, 2] += part * blue
                            colors[j, 3] += part
                        if merges:
                            fars[j] = depth
                store(state, at, through)
                store(state, at + SEEN, seen)
                store(state, at + RUN, run)
                store(samples, np.uint64(y * TILE), total)
                goes_on = np.uint8(bits(through > zero) != np.uint64(0))
                live[y] = goes_on
                alive -= 1 - goes_on
        at_row = np.int64(0)
        for y in range(y0, y1):
            if writes:
                pixel = (top + y - g.y0) * width + left + x0 - g.x0
                place_of, count = offsets[pixel], offsets[pixel + x1 - x0] - offsets[pixel]
                for k in range(count):
                    near[place_of + k] = nears[at_row + k]
                    for c in range(4):
                        color[place_of + k, c] = colors[at_row + k, c]
                if merges:
                    for k in range(count):
                        far[place_of + k] = fars[at_row + k]
                at_row += count
            else:
                for x in range(x0, x1):
                    counts[top + y - g.y0, left + x - g.x0] = np.uint32(samples[y * TILE + x])
