"""Measure nodes of a splat tree in a view, one item for each pair of an instance and a node.

A view has four edges for each of its windows: rows (axis, sign, slope, turn). Axis 0 is x, 1 is y;
the sign is 1 for the right or lower edge, -1 for the left or upper one. The slope is x / z or y / z
of the edge, for parallel rays x or y. The turn is the largest difference between the slope and that
of a splat beyond the edge, at which the affine approximation is taken.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar, serial

ROUNDING = 1e-6
OUTSIDE = 2e-3
"""Part of a box's size by which the nodes below may exceed it: more than what `check_nodes` lets
pass, on all levels together."""


@serial(writes=("errors", "shown", "in_window", "inside"))
def measure(
    instances, nodes, low, high, sizes, to_camera, scales, eyes, edges, lens, is_parallel,
    is_tangential, errors, shown, in_window, inside,
):  # fmt: skip
    """Measure p pairs; see `render.lod.measure.Measured` for the results.

    Args:
        instances, nodes: The pairs, shape (p,) i64 each.
        low, high: Corners of the nodes' boxes [local unit], shape (n, 3) f32 each.
        sizes: Errors of the nodes [local unit], shape (n,) f32.
        to_camera: Local to camera of each instance, shape (m, 4, 4).
        scales: Largest and smallest singular value of each instance, shape (m, 2).
        eyes: Camera in the local space of each instance, shape (m, 3).
        edges: Edges of the data window, and of the union with the display window, shape (w, 4, 4).
        lens: Near and far plane, focal length [pixel], and least cosine of an angle between the
            axis and a ray, shape (4,).
        is_parallel: Whether the rays are parallel.
        is_tangential: Whether splats are projected on the planes across their viewing rays.
        errors: Receives projected errors [pixel], shape (p,).
        shown, in_window, inside: Receive masks, shape (p,) each.
    """
    near, far, focal, least_cosine = lens[0], lens[1], lens[2], lens[3]
    for p in range(instances.shape[0]):
        i, n = instances[p], nodes[p]
        a0, b0 = np.float64(low[n, 0]), np.float64(high[n, 0])
        a1, b1 = np.float64(low[n, 1]), np.float64(high[n, 1])
        a2, b2 = np.float64(low[n, 2]), np.float64(high[n, 2])
        half = 0.5 * (b0 - a0), 0.5 * (b1 - a1), 0.5 * (b2 - a2)
        center = 0.5 * (a0 + b0), 0.5 * (a1 + b1), 0.5 * (a2 + b2)
        placed = to_camera[i]
        at = _at(placed, 0, center), _at(placed, 1, center), _at(placed, 2, center)
        deep = _extent(placed, 0.0, 0.0, 1.0, half)
        nearest, farthest = at[2] - deep, at[2] + deep
        slack = ROUNDING * (abs(nearest) + abs(farthest))
        more = (1 + OUTSIDE) * deep
        is_between = at[2] - more >= near and at[2] + more <= far
        is_seen = farthest + slack >= near and nearest - slack <= far
        is_near, is_within = _touches(edges[0], placed, at, half, deep, is_parallel, is_tangential)
        is_shown = is_near
        if edges.shape[0] > 1:
            is_shown, is_within = _touches(
                edges[1], placed, at, half, deep, is_parallel, is_tangential
            )
        in_window[p] = is_seen and is_near
        shown[p] = is_seen and is_shown
        inside[p] = is_between and is_within
        errors[p] = 0.0
        if not shown[p]:
            continue
        found = sizes[n] * scales[i, 0] * focal
        if not is_parallel:
            x = max(0.0, max(a0 - eyes[i, 0], eyes[i, 0] - b0))
            y = max(0.0, max(a1 - eyes[i, 1], eyes[i, 1] - b1))
            z = max(0.0, max(a2 - eyes[i, 2], eyes[i, 2] - b2))
            apart = scales[i, 1] * math.sqrt(x * x + y * y + z * z) * least_cosine
            found /= max(max(nearest, apart), max(near, TINY))
        errors[p] = found if found >= 0 else 0.0  # not a number where infinities meet


TINY = 2.2250738585072014e-308


@scalar
def _at(placed, row, point):
    """Return one coordinate of a point in camera space."""
    moved = placed[row, 0] * point[0] + placed[row, 1] * point[1] + placed[row, 2] * point[2]
    return moved + placed[row, 3]


@scalar
def _extent(placed, x, y, z, half):
    """Return half of the extent of a box along a direction in camera space."""
    a = abs(x * placed[0, 0] + y * placed[1, 0] + z * placed[2, 0]) * half[0]
    b = abs(x * placed[0, 1] + y * placed[1, 1] + z * placed[2, 1]) * half[1]
    c = abs(x * placed[0, 2] + y * placed[1, 2] + z * placed[2, 2]) * half[2]
    return a + b + c


@scalar
def _touches(edges, placed, at, half, deep, is_parallel, is_tangential):
    """Return whether a splat in a box can touch a window, and whether the whole box is in it: then
    splats of every smaller box in it can touch the window too."""
    touches, inside = True, True
    for e in range(4):
        sign, slope, turn = edges[e, 1], edges[e, 2], edges[e, 3]
        x, y = (sign, 0.0) if edges[e, 0] == 0 else (0.0, sign)
        along = at[0] if edges[e, 0] == 0 else at[1]
        if is_parallel:
            z, reach, slack = 0.0, 0.0, ROUNDING * (1 + abs(slope))
            middle = sign * along - sign * slope
            extent = _extent(placed, x, y, z, half)
        else:
            z, slack = -sign * slope, ROUNDING * (1 + abs(slope)) * abs(at[2])
            middle = sign * along + z * at[2]
            extent = _extent(placed, x, y, z, half)
            reach = turn * deep
            if is_tangential:
                wide = _extent(placed, 1.0, 0.0, 0.0, half)
                high = _extent(placed, 0.0, 1.0, 0.0, half)
                reach = math.sqrt(wide * wide + high * high + deep * deep) + extent
        if middle - extent - reach > slack:
            touches = False
        if not middle + (1 + OUTSIDE) * extent <= 0:
            inside = False
    return touches, inside
