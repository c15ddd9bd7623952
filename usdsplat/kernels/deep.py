"""Count or write the samples of deep pixels, in the order of the splats' centres.

`walk` does the same for other orders and for holdouts. Here, as in `blend`, 16 pixels are processed
at a time, even if contributions are merged. The samples of a row of 16 pixels are first staged in
the cache, splat by splat, and then written to memory pixel by pixel. One function counts and writes
samples, so both follow the same rules.

Source: OpenEXR's "Interpreting OpenEXR Deep Pixels", for the definition of samples and of merging.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from .batch import FIELDS, LOOK, lay_row, load_batch
from .bins import TILE
from .blend import END, alphas_at
from .jit import parallel, scalar, serial
from .lane_keys import any_of
from .lanes import bits, choose, fused, lower, lowest_bit, ramp, size, spread, store, store_mixed
from .project import DEPTH
from .quads import copy_quad, scale_quad

BATCH = FIELDS * LOOK
"""Floats of a batch of splats."""
PAINT = 4
"""Floats of the paint of a splat: red, green, blue, 1."""
MERGED = 6 * TILE
"""Floats of 16 staged samples: RGBA of each sample, then 16 near depths, then 16 far depths."""
WORD = 64
"""Number of staged rows whose bits for one pixel form one 64-bit mask."""


# --- 1. mathematics: one splat over one row of 16 pixels --------------------------------


@scalar
def merge(seen, run, weight, error):
    """Add a contribution to the samples of 16 deep pixels.

    Args:
        seen: Transmittance of the samples so far.
        run: Sum of the weights that are merged in the current sample.
        weight: Weight of the contribution, 0 for pixels without it.
        error: Maximum change of the opacity in front of any depth by merging.

    Returns:
        (seen, run), updated; opacity of the contribution, which is its weight divided by the
        transmittance in front; 1 if it begins a new sample, else 0.
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
def load_splats(records, column, lists, begin, first, count, paints, depths):
    """Load paint and depth of `count` splats of a tile's list, from index `first` on."""
    for i in range(first, first + count):
        k, j = np.uint64(lists[begin + i]), np.uint64(i * PAINT)
        paints[j] = records[k, column]
        paints[j + np.uint64(1)] = records[k, column + 1]
        paints[j + np.uint64(2)] = records[k, column + 2]
        depths[i] = records[k, DEPTH]


@scalar
def stage_merged(number, red, green, blue, cover, front, back, staged):
    """Write the current merged samples of 16 pixels to row `number` of `staged`."""
    at = np.uint64(number * MERGED)
    store_mixed(staged, at, red, green, blue, cover)
    store(staged, at + np.uint64(4 * TILE), front)
    store(staged, at + np.uint64(5 * TILE), back)


@scalar
def rows_of_pixel(x, first, masks):
    """Return a mask of the WORD staged rows from `first` on in which pixel x has a sample."""
    found = np.uint64(0)
    for k in range(WORD):
        bit = masks[np.uint64(first + k)] >> np.uint64(x) & np.uint64(1)
        found |= bit << np.uint64(k)
    return found


@scalar
def write_contributions(x, first, end, number, masks, opacities, paints, depths, out):
    """Write the samples of pixel x of a row, one for each contribution.

    Args:
        first, end: Index of the pixel's first sample, and one past its last.
        number: Number of staged rows.
        masks: Mask of the pixels that have a sample, for each staged row, followed by WORD zeros.
        opacities: Opacities of the samples, 16 for each staged row.
        paints, depths: Paint and depth of the splat of each staged row.
        out: (near, far, color), see `deep`; color is flat.
    """
    near, _, color = out
    j = np.uint64(first)
    for k in range(0, number, WORD):
        left = rows_of_pixel(x, k, masks)
        while left != np.uint64(0) and j != np.uint64(end):
            at = np.uint64(k) + lowest_bit(left)
            left &= left - np.uint64(1)
            opacity = opacities[at * np.uint64(TILE) + np.uint64(x)]
            scale_quad(color, j * np.uint64(PAINT), opacity, paints, at * np.uint64(PAINT))
            near[j] = depths[at]
            j += np.uint64(1)


@scalar
def write_merged(x, first, end, number, masks, staged, out):
    """Write the samples of pixel x of a row, each merged from contributions.

    Args:
        staged: Rows that `stage_merged` has written.
        first, end, number, masks, out: See `write_contributions`.
    """
    near, far, color = out
    j = np.uint64(first)
    for k in range(0, number, WORD):
        left = rows_of_pixel(x, k, masks)
        while left != np.uint64(0) and j != np.uint64(end):
            at = (np.uint64(k) + lowest_bit(left)) * np.uint64(MERGED)
            left &= left - np.uint64(1)
            copy_quad(color, j * np.uint64(PAINT), staged, at + np.uint64(x * PAINT))
            near[j] = staged[at + np.uint64(4 * TILE + x)]
            far[j] = staged[at + np.uint64(5 * TILE + x)]
            j += np.uint64(1)


@scalar
def draw_row(y, tile, splats, loaded, inside, error, writes, merges, staging):
    """Count or stage the samples of 16 pixels.

    Each call is inlined with constant `writes` and `merges`, so the compiler specialises the loop.

    Args:
        y: Row of the tile.
        tile: (records, column, lists, begin, n, left, top): the tile and its n splats.
        splats: (batches, spans, paints, depths, slopes): receive the values of loaded splats, for
            later rows too. `slopes` is scratch for `lay_row`.
        loaded: Number of splats loaded so far, in whole batches.
        inside: Mask of the pixels that are drawn.
        error, writes: See `deep`.
        merges: Whether `error` is not 0.
        staging: (masks, staged, paints, depths): receive the arguments of `write_contributions` or
            `write_merged`. If `writes` is false, `staged` receives 16 counts.

    Returns:
        (loaded, number of staged rows).
    """
    records, column, lists, begin, n, left, top = tile
    batches, spans, paints, depths, slopes = splats
    masks, staged, staged_paints, staged_depths = staging
    xs, zero, one = ramp(), np.float32(0), np.uint64(1)
    through = choose(inside, np.float32(1), -np.float32(1))
    seen, run, samples = spread(np.float32(1)), spread(zero), spread(zero)
    red = green = blue = cover = front = back = spread(zero)
    opened, number = np.uint64(0), 0
    for first in range(0, n, LOOK):
        if not any_of(through > zero):
            break
        count = min(LOOK, n - first)
        batch = batches[first // LOOK * BATCH : (first // LOOK + 1) * BATCH]
        rows = spans[2 * first : 2 * (first + LOOK)]
        if first == loaded:
            load_batch(
                records, lists, begin + first, count, np.float32(left), np.float32(top), batch, rows
            )
            if writes:
                load_splats(records, column, lists, begin, first, count, paints, depths)
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
            if not writes and not merges:
                samples = samples + choose(weight > zero, np.float32(1), zero)
                continue
            seen, run, own, begins = merge(seen, run, weight, error)
            if not writes:
                samples = samples + begins
                continue
            splat = np.uint64(first) + i
            paint, depth = splat * np.uint64(PAINT), depths[splat]
            counted, begun = own > zero, begins > zero
            if not merges:
                if any_of(counted):
                    masks[np.uint64(number)] = bits(counted)
                    store(staged, np.uint64(number * TILE), own)
                    copy_quad(staged_paints, np.uint64(number * PAINT), paints, paint)
                    staged_depths[np.uint64(number)] = depth
                    number += 1
                continue
            done = bits(begun) & opened
            if done != np.uint64(0):
                stage_merged(number, red, green, blue, cover, front, back, staged)
                masks[np.uint64(number)] = done
                number += 1
            opened |= bits(begun)
            here = paints[paint]
            part = (np.float32(1) - cover) * own
            red = choose(begun, own * here, choose(counted, red + part * here, red))
            here = paints[paint + np.uint64(1)]
            green = choose(begun, own * here, choose(counted, green + part * here, green))
            here = paints[paint + np.uint64(2)]
            blue = choose(begun, own * here, choose(counted, blue + part * here, blue))
            cover = choose(begun, own, cover + part)
            front, back = choose(begun, depth, front), choose(counted, depth, back)
    if not writes:
        store(staged, np.uint64(0), samples)
        return loaded, number
    if merges:
        stage_merged(number, red, green, blue, cover, front, back, staged)
        masks[np.uint64(number)] = opened
        number += 1
    for k in range(WORD):
        masks[np.uint64(number + k)] = np.uint64(0)
    return loaded, number


@serial(writes=("offsets",), gpu="deep.place")
def place(counts, offsets):
    """Compute the offset of each pixel's samples. Return the number of all samples.

    Args:
        counts: Number of samples of each pixel, shape (h, w) u32.
        offsets: Receives the number of samples before each pixel and, last, of all pixels, shape
            (h * w + 1,) i64.
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
    """Count or write the samples of all pixels of a band.

    Args:
        records, starts, lists, grid: See `blend`.
        column: First column of the paint in the records.
        error: Maximum change of the opacity in front of any depth by merging, f32; 0 merges
            nothing.
        writes: Whether samples are written; if not, they are counted.
        offsets: Result of `place`; read only if `writes`.
        counts: Receives the number of samples of each pixel if not `writes`, shape (h, w) u32.
        near, far, color: Receive nearest and farthest depth of each sample, shape (n,) f32, and its
            premultiplied RGBA, shape (n, 4) f32, if `writes`. `near` and `far` may be the same
            array if `error` is 0.
    """
    for tile in prange(starts.shape[0] - 1):
        g = grid[0]
        left = g.left + tile % g.columns * TILE
        top = g.top + tile // g.columns * TILE
        x0, x1 = max(0, g.x0 - left), min(TILE, g.x1 - left)
        xs, merges = ramp(), error > np.float32(0)
        inside = (xs >= np.float32(x0)) & (xs < np.float32(x1))
        begin, n = starts[tile], starts[tile + 1] - starts[tile]
        whole = (n + LOOK - 1) // LOOK
        batches = np.ones(whole * BATCH, np.float32)
        spans = np.empty(whole * 2 * LOOK, np.float32)
        slopes, loaded = np.empty(2 * LOOK, np.float32), 0
        kept = n if writes else 0
        paints, depths = np.ones(kept * PAINT, np.float32), np.empty(kept, np.float32)
        # Each splat stages at most one row, and the last merged samples take one more.
        staged = np.empty((kept + 1) * (MERGED if merges else TILE), np.float32)
        staged_paints, staged_depths = np.empty_like(paints), np.empty_like(depths)
        masks = np.empty(kept + 1 + WORD, np.uint64)
        of_tile = records, column, lists, begin, n, left, top
        splats = batches, spans, paints, depths, slopes
        staging = masks, staged, staged_paints, staged_depths
        out = near, far, color.reshape(color.size)
        # Row by row, so that staged samples stay in the cache until they are written.
        for y in range(max(0, g.y0 - top), min(TILE, g.y1 - top)):
            row, first_pixel = top + y - g.y0, left + x0 - g.x0
            pixel = row * (g.x1 - g.x0) + first_pixel
            if writes and merges:
                loaded, number = draw_row(
                    y, of_tile, splats, loaded, inside, error, True, True, staging
                )
            elif writes:
                loaded, number = draw_row(
                    y, of_tile, splats, loaded, inside, error, True, False, staging
                )
            elif merges:
                loaded, number = draw_row(
                    y, of_tile, splats, loaded, inside, error, False, True, staging
                )
            else:
                loaded, number = draw_row(
                    y, of_tile, splats, loaded, inside, error, False, False, staging
                )
            for x in range(x0, x1):
                at = pixel + x - x0
                if not writes:
                    counts[row, first_pixel + x - x0] = np.uint32(staged[x])
                elif merges:
                    write_merged(x, offsets[at], offsets[at + 1], number, masks, staged, out)
                else:
                    write_contributions(
                        x, offsets[at], offsets[at + 1], number, masks, staged, staged_paints,
                        staged_depths, out,
                    )  # fmt: skip
