"""Accumulate the coverage of each pixel by each prim over the samples of a picture.

Source: Friedman & Jones 2015, "Fully automatic ID mattes with support for motion blur and
transparency".
"""

from __future__ import annotations

import numpy as np

from .jit import scalar
from .launch import kernel

SLOTS_PER_PRIM = 2
"""Accumulated prims per kept prim of one sample. The prims with the largest weights in the picture
are not always those of one sample."""


# --- 1. mathematics: one pixel ---------------------------------------------------------


@scalar
def remember(prim, weight, ids, weights):
    """Add to the weight of a prim. If all slots have other prims, replace the one with the smallest
    weight, if its weight is smaller."""
    lightest = 0
    for slot in range(ids.shape[0]):
        if ids[slot] == prim or ids[slot] < 0:
            ids[slot] = prim
            weights[slot] += weight
            return
        if weights[slot] < weights[lightest]:
            lightest = slot
    if weights[lightest] < weight:
        ids[lightest], weights[lightest] = prim, weight


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="out", writes=("out",))
def regroup(k, labels, groups, out):
    """Set out[k] to the group of splat `k`.

    Args:
        labels: Number of each splat's prim, shape (n,) i32.
        groups: Group of each prim, shape (prims,) i32.
        out: Shape (n,) i32.
    """
    out[k] = groups[labels[k]]


@kernel(over="all_ids", writes=("all_ids", "all_weights"), axes=2)
def begin(y, x, all_ids, all_weights):
    """Clear the accumulated prims and weights, shapes (h, w, slots)."""
    for slot in range(all_ids.shape[2]):
        all_ids[y, x, slot], all_weights[y, x, slot] = -1, np.float32(0)


@kernel(over="ids", writes=("all_ids", "all_weights"), axes=2)
def gather(y, x, ids, weights, numbers, all_ids, all_weights):
    """Add the prims of one sample to the accumulated ones.

    Args:
        ids, weights: Prims and weights of the sample, shape (h, w, n); -1 for unused slots.
        numbers: Prim number in the sample -> number over all samples, shape (prims,) i32.
        all_ids, all_weights: Accumulated prims and weights; changed in place.
    """
    for rank in range(ids.shape[2]):
        prim = ids[y, x, rank]
        if prim >= 0:
            remember(
                numbers[prim], weights[y, x, rank], all_ids[y, x], all_weights[y, x]
            )  # fmt: skip


@kernel(over="out", writes=("out",), axes=2)
def rank(y, x, ids, weights, shown, left, hashes, out):
    """Write Cryptomatte's channels of a picture of one sample.

    The result is the same as that of `gather` and `finish` for a single sample.

    Args:
        ids, weights: Prims of the splats and their weights, the heaviest first, shape (h, w, n);
            -1 for unused slots.
        shown: Prim of the surface behind the splats, -1 where there is none, shape (h, w) i32;
            empty without surfaces.
        left: Transmittance of the splats to the surface, shape (h, w) f32; or empty.
        hashes: Cryptomatte's hash of each prim as a float, shape (prims,) f32.
        out: Receives all channels, shape (h, w, 2 r) f32 with r <= n.
    """
    surface, total = -1, np.float32(0)
    if shown.shape[0] > 0:
        surface = shown[y, x]
        total = left[y, x] if surface >= 0 else np.float32(0)
        for slot in range(ids.shape[2]):
            if surface >= 0 and ids[y, x, slot] == surface:
                total = weights[y, x, slot] + total
    slot = 0
    for place in range(out.shape[2] // 2):
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
        all_ids, all_weights: Accumulated prims and weights; the weights are overwritten.
        scale: One over the number of samples.
        hashes: Cryptomatte's hash of each prim as a float, shape (prims,) f32.
        out: Receives all channels, shape (h, w, 2 n) f32.
    """
    for rank in range(out.shape[2] // 2):
        best = 0
        for slot in range(1, all_weights.shape[2]):
            if all_weights[y, x, slot] > all_weights[y, x, best]:
                best = slot
        weight = all_weights[y, x, best]
        here = weight > np.float32(0)
        out[y, x, 2 * rank] = hashes[all_ids[y, x, best]] if here else np.float32(0)
        out[y, x, 2 * rank + 1] = weight * scale
        all_weights[y, x, best] = np.float32(0)
