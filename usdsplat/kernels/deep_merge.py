"""Merge the deep samples of several pictures into those of their average.

A contribution of opacity a behind samples of transmittance T adds the weight a T to the opacity of
its picture. Averaging n pictures divides weights by n and joins the lists of contributions. Sorted
by depth, they are deep samples again: the opacity of each is its weight divided by the
transmittance of those in front, 1 minus the sum of their weights. In front of any depth, opacity
and colour are the averages over the pictures.

An entry of a list is a contribution: its depth, its weight, its colour times its weight, and its
ids, if they are requested. The entries of a pixel are sorted, the nearest first. Only the CPU
merges: samples of a GPU are on the host already.

Source: OpenEXR's "Interpreting OpenEXR Deep Pixels", for the meaning of samples.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from .jit import parallel, scalar

# --- 1. mathematics: one pixel ----------------------------------------------------------


@scalar
def same_ids(first, i, second, j):
    """Return whether two entries have the same ids, which rows i and j of the arrays hold."""
    same = True
    for k in range(first.shape[1]):
        same = same and first[i, k] == second[j, k]
    return same


@scalar
def copy_entry(entries, i, out, at):
    """Copy entry `i` of a list to index `at` of another."""
    depth, weights, paints, ids = entries
    out_depth, out_weights, out_paints, out_ids = out
    out_depth[at], out_weights[at] = depth[i], weights[i]
    for c in range(3):
        out_paints[at, c] = paints[i, c]
    for k in range(ids.shape[1]):
        out_ids[at, k] = ids[i, k]


@scalar
def join_pixel(first, i, i_end, second, j, j_end, at, writes, out):
    """Join the entries i to i_end of a list with j to j_end of another, sorted by depth.

    Two entries of equal depth and ids become one, with the sums of weights and paints. Otherwise
    those of the first list precede those of the same depth of the second.

    Args:
        first, second, out: (depths, weights, paints, ids).
        at: Index in `out` of the first entry.
        writes: Whether entries are written.

    Returns:
        The number of joined entries.
    """
    depth, ids = first[0], first[3]
    other_depth, other_ids = second[0], second[3]
    start = at
    while i < i_end or j < j_end:
        if j == j_end or (i < i_end and depth[i] < other_depth[j]):
            if writes:
                copy_entry(first, i, out, at)
            i += 1
        elif i == i_end or other_depth[j] < depth[i]:
            if writes:
                copy_entry(second, j, out, at)
            j += 1
        else:
            if writes:
                copy_entry(first, i, out, at)
            if same_ids(ids, i, other_ids, j):
                if writes:
                    out[1][at] += second[1][j]
                    for c in range(3):
                        out[2][at, c] += second[2][j, c]
                j += 1
            i += 1
        at += 1
    return at - start


@scalar
def merge_pixel(entries, first, end, error, at, writes, out):
    """Write the samples of a pixel, or count them.

    Args:
        entries: (depths, weights, paints, ids) of a list.
        first, end: The pixel's entries.
        error: Maximum weight of a sample that is merged from several entries.
        at: Index in `out` of the pixel's first sample.
        writes: Whether samples are written.
        out: (near, far, color, ids), see `merge`.

    Returns:
        The number of samples.
    """
    depth, weights, paints, ids = entries
    near, far, color, out_ids = out
    start = at
    seen = 1.0
    j = first
    while j < end:
        if weights[j] <= np.float32(0):
            j += 1
            continue
        run, red, green, blue = 0.0, 0.0, 0.0, 0.0
        begin, last = j, j
        while j < end and (run == 0.0 or run + weights[j] <= error):
            if not same_ids(ids, j, ids, begin):
                break
            if weights[j] > np.float32(0):
                run += weights[j]
                red += paints[j, 0]
                green += paints[j, 1]
                blue += paints[j, 2]
                last = j
            j += 1
        if writes:
            own = run / seen if run < seen else 1.0
            scale = own / run
            near[at], far[at] = depth[begin], depth[last]
            color[at, 0], color[at, 1] = np.float32(red * scale), np.float32(green * scale)
            color[at, 2], color[at, 3] = np.float32(blue * scale), np.float32(own)
            for k in range(ids.shape[1]):
                out_ids[at, k] = ids[begin, k]
        seen = max(seen - run, 0.0)
        at += 1
    return at - start


# --- 2. CPU ----------------------------------------------------------------------------


@parallel(writes=("weights", "paints"))
def weigh(offsets, color, share, weights, paints):
    """Compute weights and paints of the contributions to one picture.

    Args:
        offsets: First sample of each pixel and, last, their number, shape (pixels + 1,) i64.
        color: Premultiplied RGBA of each sample, near to far in each pixel, shape (n, 4) f32.
        share: Share of the picture in the average, f64.
        weights: Receives the weights, shape (n,) f32.
        paints: Receives the colours times weights, shape (n, 3) f32.
    """
    for pixel in prange(offsets.shape[0] - 1):
        through = share
        for j in range(offsets[pixel], offsets[pixel + 1]):
            own = np.float64(color[j, 3])
            weights[j] = np.float32(through * own)
            for c in range(3):
                paints[j, c] = np.float32(through * color[j, c])
            through *= 1.0 - own


@parallel(writes=("places", "out"))
def join(first, second, writes, places, out):
    """Join two lists, or count the entries of the result.

    Args:
        first, second: (offsets, depths, weights, paints, ids): offsets as in `weigh`; depths and
            weights, shape (n,) f32; paints, shape (n, 3) f32; ids, shape (n, k) i32, k may be 0.
        writes: Whether entries are written. If not, `places` receives their number in each pixel.
        places: Offset of each pixel's entries in `out`, shape (pixels,) i64.
        out: (depths, weights, paints, ids): receive the entries.
    """
    offsets, depth, weights, paints, ids = first
    other_offsets, other_depth, other_weights, other_paints, other_ids = second
    out_depth, out_weights, out_paints, out_ids = out
    for pixel in prange(offsets.shape[0] - 1):
        found = join_pixel(
            (depth, weights, paints, ids), offsets[pixel], offsets[pixel + 1],
            (other_depth, other_weights, other_paints, other_ids),
            other_offsets[pixel], other_offsets[pixel + 1],
            places[pixel] if writes else 0, writes,
            (out_depth, out_weights, out_paints, out_ids),
        )  # fmt: skip
        if not writes:
            places[pixel] = found


@parallel(writes=("places", "out"))
def merge(entries, error, writes, places, out):
    """Write the samples of all pixels, or count them.

    Consecutive entries of equal ids become one sample while their weights sum to `error` or less,
    so the opacity in front of any depth changes by at most `error`. 0 merges none.

    Args:
        entries: A list, see `join`.
        error: See above, f64.
        writes: Whether samples are written. If not, `places` receives their number in each pixel.
        places: Offset of each pixel's samples in `out`, shape (pixels,) i64.
        out: (near, far, color, ids): receive nearest and farthest depth, shape (n,) f32,
            premultiplied RGBA, shape (n, 4) f32, and ids, shape (n, k) i32.
    """
    offsets, depth, weights, paints, ids = entries
    near, far, color, out_ids = out
    for pixel in prange(offsets.shape[0] - 1):
        found = merge_pixel(
            (depth, weights, paints, ids), offsets[pixel], offsets[pixel + 1], error,
            places[pixel] if writes else 0, writes, (near, far, color, out_ids),
        )  # fmt: skip
        if not writes:
            places[pixel] = found
