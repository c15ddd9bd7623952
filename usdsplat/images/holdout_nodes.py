"""Compute the transmittance of deep samples as nodes, between which it is log-linear.

A sample of opacity a that extends from Z to ZBack attenuates within: the part t of its extent hides
1 - (1 - a)^t. Samples that overlap multiply, which is the result of splitting them at each front
and back, and merging those that coincide.

Source: OpenEXR's "Interpreting OpenEXR Deep Pixels", "Splitting and Merging".
"""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import F32, F64, I64

HoldoutNodes = tuple[I64, F32, F32]
"""Transmittance along each pixel's ray: offsets of the pixels' nodes, shape (h*w + 1,); planar
camera depths, shape (n,), ascending in each pixel; and transmittances, shape (n,) [0..1].
The transmittance is 1 in front of the first node, log-linear between two, and constant behind the
last. Two nodes of equal depth are a step, which does not act at that depth itself."""

STRIP = 64
"""Number of rows of a deep file whose nodes are computed at a time, because that takes several
times the memory of the nodes."""


def nodes_of(offsets: I64, front: F32, back: F32, alpha: F32) -> HoldoutNodes:
    """Return the nodes of deep samples, two for each sample that hides something.

    Each pixel is computed alone, so that it does not depend on the pixels that are read with it.

    Args:
        offsets: Offset of each pixel's samples, which are in any order.
        front, back: Ends of the samples. One whose `back` is not finite, or not behind `front`,
            acts at `front`; one whose `front` is not finite has no effect.
        alpha: Opacities; NaN has no effect, others are clamped to 0..1.
    """
    pixel = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    acts = np.isfinite(front) & (alpha > 0)
    pixel, front, back = pixel[acts], front[acts], back[acts]
    alpha = np.minimum(alpha[acts], 1)
    # An opaque sample hides everything behind its front, whatever its extent.
    is_step = ~(np.isfinite(back) & (back > front)) | (alpha == 1)
    depth = np.stack([front, np.where(is_step, front, back)], axis=1).ravel()
    passed = np.ones(len(depth))
    passed[1::2][is_step] -= alpha[is_step]
    starts = np.zeros(len(offsets), np.int64)
    np.cumsum(2 * np.bincount(pixel, minlength=len(offsets) - 1), out=starts[1:])
    if len(starts) == 1:
        return starts, depth, passed.astype(np.float32)
    density = np.zeros(0)
    if not is_step.all():
        density = np.zeros(len(depth))
        density[::2][~is_step] = _density(front, back, alpha, ~is_step)
        density[1::2] = -density[::2]
    pixel = np.repeat(pixel, 2)
    falls = (depth[1:] < depth[:-1]) & (pixel[1:] == pixel[:-1])
    if falls.any():
        order = np.argsort(_keys(pixel, depth), kind="stable")
        depth, passed = depth[order], passed[order]
        density = density[order] if len(density) else density
    return starts, depth, _accumulated(starts, depth, passed, density)


def _keys(pixel: I64, depth: F32) -> I64:
    """Return integers in the order of pixels, then depths.

    One key that is almost sorted is sorted several times faster than two.
    """
    bits = depth.view(np.int32)
    ordered = np.where(bits < 0, bits ^ np.int32(0x7FFFFFFF), bits)
    return (pixel.astype(np.int64) << 32) + ordered


def _density(front: F32, back: F32, alpha: F32, some: np.ndarray) -> F64:
    """Return the optical depth per unit of some samples."""
    extent = back[some].astype(np.float64) - front[some]
    return -np.log1p(-alpha[some].astype(np.float64)) / extent


def _accumulated(starts: I64, depth: F32, passed: F64, density: F64) -> F32:
    """Return the transmittance behind each node.

    Args:
        starts: Offset of each pixel's nodes.
        depth: Depths of the nodes.
        passed: Transmittance of what acts at the depth of each node alone.
        density: Change of the optical depth per unit at each node; empty if there is none.
    """
    counts = np.diff(starts)
    # The pixels with the most nodes first: those that have a further node are the first ones.
    order = np.argsort(-counts, kind="stable")
    first, length = starts[:-1][order], counts[order]
    through, found = np.ones(len(order)), np.empty(len(depth), np.float32)
    dense, inside, last = np.zeros(len(order)), np.zeros(len(order), np.int64), np.zeros(len(order))
    for k in range(int(length.max(initial=0))):
        n = int(np.searchsorted(-length, -k, side="left"))
        at = first[:n] + k
        if len(density):
            # Nothing remains of a sum of densities behind the last sample, not even its rounding.
            rate = np.where(inside[:n] > 0, np.maximum(dense[:n], 0), 0)
            through[:n] *= np.exp(-rate * (depth[at] - last[:n]))
            dense[:n] = np.where(inside[:n] > 0, dense[:n], 0) + density[at]
            inside[:n] += np.sign(density[at]).astype(np.int64)
            last[:n] = depth[at]
        through[:n] *= passed[at]
        found[at] = through[:n]
    return found
