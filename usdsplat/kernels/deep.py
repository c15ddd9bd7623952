"""The samples of deep pixels in the order of centres: counted, then written where they belong.

`walk` can do this for any order and any holdout, one contribution to one pixel after the other.
Here, as in `blend`, 16 pixels go at a time, and only what is written is written one by one.
Counting and writing are one function, compiled once, so that they cannot disagree about a sample.

Source: OpenEXR's "Interpreting OpenEXR Deep Pixels", for what a sample and a merged one mean.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from .batch import FIELDS, LOOK, load_batch, load_paints, look
from .bins import TILE
from .blend import END, alpha_at
from .jit import parallel, scalar, serial
from .project import DEPTH

STATE = 6
ROW = STATE * TILE
"""Floats of a row of a tile's state, 16 pixels each: transmittance, negative where it has ended;
the same of what the samples so far hold; weight of the run that is merged; samples; then of the
last splat its opacity behind what is in front, 0 where it does not count, and whether a sample
begins."""
SEEN, RUN, SAMPLES, OWN, BEGINS = (np.uint64(i * TILE) for i in range(1, STATE))


# --- 1. mathematics: one splat over one row of 16 pixels --------------------------------


@scalar
def deep_row(state, row, u, a, slope, rest, error):
    """What `walk` does with a contribution to a deep pixel, but for writing the sample."""
    at = np.uint64(row * ROW)
    for x in range(TILE):
        j = at + np.uint64(x)
        alpha = alpha_at(np.float32(x) - u, a, slope, rest)
        t = state[j]
        weight = alpha * t
        left = t - weight
        goes_on = left >= END
        weight = weight if goes_on else np.float32(0)
        state[j] = left if goes_on else -abs(t)
        seen = state[j + SEEN]
        own = min(weight / seen, np.float32(1))
        state[j + SEEN] = seen - seen * own
        run = state[j + RUN]
        sum_of_run = run + weight
        counts = weight > np.float32(0)
        begins = counts and (run <= np.float32(0) or sum_of_run > error)
        state[j + RUN] = weight if begins else sum_of_run
        begun = np.float32(1) if begins else np.float32(0)
        state[j + SAMPLES] += begun
        state[j + OWN] = own
        state[j + BEGINS] = begun


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
        state = np.zeros(TILE * ROW, np.float32)
        for y in range(TILE):
            for x in range(TILE):
                inside = y0 <= y < y1 and x0 <= x < x1
                state[y * ROW + x] = np.float32(1) if inside else np.float32(-1)
                state[y * ROW + TILE + x] = np.float32(1)
        live = np.ones(TILE, np.uint8)
        batch = np.ones((FIELDS + 3) * LOOK, np.float32)
        rows = np.empty(2 * LOOK, np.float32)
        end = starts[tile + 1]
        look(state, ROW, live)
        for first in range(starts[tile], end, LOOK):
            count = min(LOOK, end - first)
            load_batch(records, lists, first, count, np.float32(left), np.float32(top), batch, rows)
            load_paints(records, column, lists, first, count, batch)
            for i in range(count):
                u, v = batch[i], batch[LOOK + i]
                a, b, c = batch[2 * LOOK + i], batch[3 * LOOK + i], batch[4 * LOOK + i]
                log_opacity = batch[5 * LOOK + i]
                red, green, blue = batch[7 * LOOK + i], batch[8 * LOOK + i], batch[9 * LOOK + i]
                depth = records[lists[first + i], DEPTH]
                for y in range(np.int64(rows[i]), np.int64(rows[LOOK + i])):
                    if live[y] == 0:
                        continue
                    dy = np.float32(y) - v
                    rest = c * dy * dy + log_opacity
                    deep_row(state, y, u, a, b * dy, rest, error)
                    if not writes:
                        continue
                    pixels = (top + y - g.y0) * width + left - g.x0
                    row = np.uint64(y * ROW)
                    for x in range(x0, x1):
                        j = row + np.uint64(x)
                        own = state[j + OWN]
                        if own <= np.float32(0):
                            continue
                        at = offsets[pixels + x] + np.int64(state[j + SAMPLES]) - 1
                        far[at] = depth
                        if state[j + BEGINS] > np.float32(0):
                            near[at] = depth
                            color[at, 0], color[at, 1] = own * red, own * green
                            color[at, 2], color[at, 3] = own * blue, own
                        else:
                            part = (np.float32(1) - color[at, 3]) * own
                            color[at, 0] += part * red
                            color[at, 1] += part * green
                            color[at, 2] += part * blue
                            color[at, 3] += part
            if look(state, ROW, live) == 0:
                break
        if not writes:
            for y in range(y0, y1):
                for x in range(x0, x1):
                    samples = state[y * ROW + 3 * TILE + x]
                    counts[top + y - g.y0, left + x - g.x0] = np.uint32(samples)
