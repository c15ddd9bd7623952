"""Gather, over the samples of a picture, how much each prim covers of each pixel.

Source: Friedman & Jones 2015, "Fully automatic ID mattes with support for motion blur and
transparency".
"""

from __future__ import annotations

import numpy as np

from .jit import scalar
from .launch import kernel

SLOTS = 12
"""Prims that are remembered for each pixel: twice as many as a file keeps."""


# --- 1. mathematics: one pixel ---------------------------------------------------------


@scalar
def remember(prim, weight, ids, weights):
    """Add to what is known of a prim; one too many takes the place of the lightest, if lighter."""
    lightest = 0
    for slot in range(SLOTS):
        if ids[slot] == prim or ids[slot] < 0:
            ids[slot] = prim
            weights[slot] += weight
            return
        if weights[slot] < weights[lightest]:
            lightest = slot
    if weights[lightest] < weight:
        ids[lightest], weights[lightest] = prim, weight


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="all_ids", writes=("all_ids", "all_weights"), axes=2)
def begin(y, x, all_ids, all_weights):
    """Nothing has been gathered yet; shapes (h, w, SLOTS)."""
    for slot in range(SLOTS):
        all_ids[y, x, slot], all_weights[y, x, slot] = -1, np.float32(0)


@kernel(over="ids", writes=("all_ids", "all_weights"), axes=2)
def gather(y, x, ids, weights, numbers, all_ids, all_weights):
    """Add the prims of one sample to those of all.

    Args:
        ids, weights: Of one sample, shape (h, w, n); -1 where there is no more.
        numbers: What prims of the sample are called in all of them, shape (prims,) i32.
        all_ids, all_weights: What `begin` began; changed in place.
    """
    for rank in range(ids.shape[2]):
        prim = ids[y, x, rank]
        if prim >= 0:
            remember(
                numbers[prim], weights[y, x, rank], all_ids[y, x], all_weights[y, x]
            )  # fmt: skip


@kernel(over="out", writes=("out",), axes=2)
def rank(y, x, ids, weights, shown, left, hashes, out):
    """Write Cryptomatte's channels of a picture of one sample: what gathering it alone gives.

    Args:
        ids, weights: Prims of the splats and their weights, the heaviest first, shape (h, w, n);
            -1 where there is no more.
        shown: Prim of the surface behind the splats, -1 where there is none, shape (h, w) i32; or
            of no size where there are no surfaces.
        left: How much of it the splats let through, shape (h, w) f32; or of no size.
        hashes: Of each prim, as Cryptomatte's floats, shape (prims,) f32.
        out: Shape (h, w, 2 n) f32, of which all is written.
    """
    surface, total = -1, np.float32(0)
    if shown.shape[0] > 0:
        surface = shown[y, x]
        total = left[y, x] if surface >= 0 else np.float32(0)
        for slot in range(ids.shape[2]):
            if surface >= 0 and ids[y, x, slot] == surface:
                total = weights[y, x, slot] + total
    slot = 0
    for place in range(ids.shape[2]):
        while slot < ids.shape[2] and surface >= 0 and ids[y, x, slot] == surface:
            slot += 1
        prim, weight = -1, np.float32(0)
        if slot < ids.shape[2]:
            prim, weight = ids[y, x, slot], weights[y, x, slot]
        if total > weight:
            prim, weight = surface, total
            total = np.float32(0)
        else:
            slot += 1
        here = prim >= 0 and weight > np.float32(0)
        out[y, x, 2 * place] = hashes[prim] if here else np.float32(0)
        out[y, x, 2 * place + 1] = weight if here else np.float32(0)


@kernel(over="out", writes=("all_weights", "out"), axes=2)
def finish(y, x, all_ids, all_weights, scale, hashes, out):
    """Write Cryptomatte's channels: id and coverage, the heaviest prim first.

    Args:
        all_ids, all_weights: What was gathered; the weights are used up.
        scale: One over the number of samples.
        hashes: Of each prim, as Cryptomatte's floats, shape (prims,) f32.
        out: Shape (h, w, 2 n) f32, of which all is written.
    """
    for rank in range(out.shape[2] // 2):
        best = 0
        for slot in range(1, SLOTS):
            if all_weights[y, x, slot] > all_weights[y, x, best]:
                best = slot
        weight = all_weights[y, x, best]
        here = weight > np.float32(0)
        out[y, x, 2 * rank] = hashes[all_ids[y, x, best]] if here else np.float32(0)
        out[y, x, 2 * rank + 1] = weight * scale
        all_weights[y, x, best] = np.float32(0)
