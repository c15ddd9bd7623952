"""Cull blocks of splats: bounds of each block, and the test against a view.

A splat is visible only if its centre lies between the clipping planes and its ellipse touches the
data window. For a whole block, both are bounded by the box of its centres and the largest reach of
its splats. No splat that `project` would keep is culled.
"""

from __future__ import annotations

import math

import numpy as np

from .jit import scalar
from .launch import kernel
from .project import BLOCK, LOG_CUTOFF, ORTHOGRAPHIC

BOX = 8
"""Floats of a block: centre x y z | half extent x y z | largest reach: standard deviation times the
number of deviations above the cutoff | largest number of deviations."""

SLACK = 1e-5
"""Relative margin for rounding."""


# --- 1. mathematics: one block ---------------------------------------------------------


@scalar
def lowest(m, box, gx, gy, gz):
    """Return the minimum of gx x + gy y + gz z over a box, in camera space without its origin, and
    the sum of all magnitudes, for rounding."""
    a = gx * m[0, 0] + gy * m[1, 0] + gz * m[2, 0]
    b = gx * m[0, 1] + gy * m[1, 1] + gz * m[2, 1]
    c = gx * m[0, 2] + gy * m[1, 2] + gz * m[2, 2]
    d = gx * m[0, 3] + gy * m[1, 3] + gz * m[2, 3]
    middle = a * box[0] + b * box[1] + c * box[2] + d
    spread = abs(a) * box[3] + abs(b) * box[4] + abs(c) * box[5]
    size = abs(a * box[0]) + abs(b * box[1]) + abs(c * box[2]) + abs(d) + spread
    return middle - spread - SLACK * size


@scalar
def is_outside(cam, m, box):
    """Return whether no splat of the block can touch the data window.

    Along the screen's x a splat reaches at most `deviations` times sqrt(|J M|² σ² + low-pass), and
    |J| is at most f / z times sqrt(1 + t²), where t is the clamp of the affine approximation.
    Multiplied by z, all terms are linear, so their minimum over the box decides.
    """
    if lowest(m, box, 0.0, 0.0, 1.0) > cam.far or lowest(m, box, 0.0, 0.0, -1.0) > -cam.near:
        return True
    stretch = 0.0
    for i in range(3):
        for j in range(3):
            stretch += m[i, j] * m[i, j]
    reach = math.sqrt(stretch) * box[6]
    blur = box[7] * math.sqrt(cam.low_pass)
    fx, fy = np.float64(cam.fx), np.float64(cam.fy)
    if cam.projection == ORTHOGRAPHIC:
        right = lowest(m, box, fx, 0.0, 0.0) + cam.cx - cam.right > fx * reach + blur
        left = lowest(m, box, -fx, 0.0, 0.0) - cam.cx + cam.left > fx * reach + blur
        below = lowest(m, box, 0.0, fy, 0.0) + cam.cy - cam.bottom > fy * reach + blur
        above = lowest(m, box, 0.0, -fy, 0.0) - cam.cy + cam.top > fy * reach + blur
        return right or left or below or above
    across = max(abs(cam.low_u), abs(cam.high_u))
    down = max(abs(cam.low_v), abs(cam.high_v))
    x_reach = fx * math.sqrt(1.0 + across * across) * reach
    y_reach = fy * math.sqrt(1.0 + down * down) * reach
    right = lowest(m, box, fx, 0.0, cam.cx - cam.right - blur) > x_reach
    left = lowest(m, box, -fx, 0.0, cam.left - cam.cx - blur) > x_reach
    below = lowest(m, box, 0.0, fy, cam.cy - cam.bottom - blur) > y_reach
    above = lowest(m, box, 0.0, -fy, cam.top - cam.cy - blur) > y_reach
    return right or left or below or above


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="out", writes=("out",), grain=1)
def boxes(block, positions, scales, opacities, out):
    """Bound the blocks of a field.

    Args:
        positions, scales, opacities: A SplatCloud's arrays, n rows.
        out: Receives (blocks, BOX) f32. A block with a centre that is not finite is not bounded.
    """
    n = positions.shape[0]
    first, end = block * BLOCK, min(n, (block + 1) * BLOCK)
    for a in range(3):
        low, high = np.float32(np.inf), np.float32(-np.inf)
        for i in range(first, end):
            low, high = min(low, positions[i, a]), max(high, positions[i, a])
        middle = np.float32(0.5) * low + np.float32(0.5) * high
        half = max(high - middle, middle - low)
        out[block, a] = middle
        out[block, 3 + a] = half if half >= np.float32(0) else np.float32(np.inf)
    reach, most = np.float32(0), np.float32(0)
    for i in range(first, end):
        opacity = opacities[i]
        if opacity > np.float32(0):
            count = np.float32(2) * (np.float32(math.log(opacity)) - LOG_CUTOFF)
            count = np.float32(math.sqrt(max(count, np.float32(0))))
            most = max(most, count)
            largest = max(scales[i, 0], max(scales[i, 1], scales[i, 2]))
            reach = max(reach, largest * count)
    out[block, 6], out[block, 7] = reach, most


@kernel(over=("matrices", "boxes"), writes=("closed",), axes=2)
def cull(instance, block, camera, matrices, boxes, closed):
    """Find the blocks that a view cannot see.

    Args:
        camera, matrices: See `project.project`, m instances.
        boxes: Result of `boxes`.
        closed: Receives 1 for each block of each instance that is culled, (m * blocks,) u8.
    """
    is_closed = is_outside(camera[0], matrices[instance], boxes[block])
    closed[instance * boxes.shape[0] + block] = is_closed
