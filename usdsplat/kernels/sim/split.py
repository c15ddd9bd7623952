"""Divide splats along an axis into children that together look like them.

`usdsplat.sim.split_table` has the children of a splat that is flat or thin. A splat that is also
thick, seen along its longest axis, shows all children behind one another, so that they are too
opaque there. No choice of opacities suits all views. They are chosen such that opacity times area
is the splat's in the mean over all directions: by Cauchy, the mean area of the shadow of a convex
body is a quarter of its surface.

Sources: Cauchy 1841, "Note sur divers théorèmes relatifs à la rectification des courbes"; the
surface of an ellipsoid by Thomsen's formula (2004), off by 1 % at most.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel

from .matrix import quat_matrix

KEEP = -1
"""Entry of splats that are not divided."""
NEEDLE = 0.25
"""Length, as a fraction of the limit, below which splats are not divided because of their
anisotropy."""

_ZERO, _ONE, _THIRD = np.float32(0), np.float32(1), np.float32(1 / 3)
_NEEDLE = np.float32(NEEDLE)
_POWER = np.float32(1.6075)


# --- 1. mathematics: one splat ---------------------------------------------------------


@scalar
def longest(x, y, z):
    """Return the index of the largest number, the first of equal ones, and the two largest."""
    if (x >= y) & (x >= z):
        return 0, x, max(y, z)
    if y >= z:
        return 1, y, max(x, z)
    return 2, z, max(x, y)


@scalar
def surface(x, y, z):
    """Return the surface of an ellipsoid with these half axes, divided by 4 pi."""
    x, y, z = x**_POWER, y**_POWER, z**_POWER
    return ((x * y + y * z + z * x) * _THIRD) ** (_ONE / _POWER)


@scalar
def shared(opacity, along, across, y, z):
    """Return the opacity of a child of a splat with half axes 1, y and z, from that of a child of a
    flat splat, for its sizes along and across."""
    now = surface(along, across * y, across * z)
    if not now > _ZERO:
        return opacity
    part = min(_ONE, along * across * surface(_ONE, y, z) / now)
    return _ONE - (_ONE - opacity) ** part


@scalar
def mixed(children, at, child, column, part, wide):
    """Interpolate a number of a child between two opacities and between both sizes."""
    a = children[0, at, child, column]
    a += part * (children[0, at + 1, child, column] - a)
    b = children[1, at, child, column]
    b += part * (children[1, at + 1, child, column] - b)
    return a + wide * (b - a)


# --- 2. kernels ------------------------------------------------------------------------


@kernel(over="scales", writes=("axes", "entries", "sizes"))
def choose(
    i, positions, scales, opacities, limit, anisotropy, faint, sigmas, axes, entries, sizes
):  # fmt: skip
    """Choose the axis along which each splat is divided, and how.

    Args:
        positions, scales: (n, 3) f32. opacities: (n,) f32.
        limit: Largest standard deviation [unit], f32. anisotropy: Largest ratio of the longest axis
            to the middle one of splats longer than a quarter of the limit, f32.
        faint: Opacity below which splats are not divided, f32.
        sigmas: Least and largest size of the children of each entry of the table, the least ones
            descending, (e, 2) f32.
        axes: Receives the longest axis, (n,) i32.
        entries: Receives the first entry that suffices, or the last; KEEP for splats that are small
            enough, faint or not finite, (n,) i32.
        sizes: Receives the size of the children along the axis, in that of the splat, (n,) f32.
    """
    axis, size, middle = longest(scales[i, 0], scales[i, 1], scales[i, 2])
    axes[i] = axis
    entries[i] = KEEP
    sizes[i] = _ONE
    most = min(limit, max(anisotropy * middle, _NEEDLE * limit))
    place = positions[i, 0] + positions[i, 1] + positions[i, 2]
    if not ((size > most) & (opacities[i] >= faint) & math.isfinite(size + place)):
        return
    entry = 0
    while (entry < sigmas.shape[0] - 1) & (sigmas[entry, 0] * size > most):
        entry += 1
    entries[i] = entry
    sizes[i] = min(sigmas[entry, 1], max(sigmas[entry, 0], most / size))


@kernel(over="rows", writes=("new_positions", "new_scales", "new_opacities"))
def divide(
    k, rows, numbers, cuts, table, positions, rotations, scales, opacities, new_positions,
    new_scales, new_opacities,
):  # fmt: skip
    """Compute one child of a splat.

    Args:
        rows: Row of the splat, (m,) i64. numbers: Which of its children it is, (m,) i32.
        cuts: (axes, entries, sizes) of the splats, see `choose`.
        table: (firsts, sigmas, opacities, children) of a `SplitTable`.
        positions, scales: (n, 3) f32. rotations: (n, 4) f32. opacities: (n,) f32.
        new_positions, new_scales: (m, 3) f32. new_opacities: (m,) f32.
    """
    axes, entries, sizes = cuts
    firsts, sigmas, nodes, children = table
    i = rows[k]
    axis, entry, along, whole = axes[i], entries[i], sizes[i], opacities[i]
    least, most = sigmas[entry, 0], sigmas[entry, 1]
    child = firsts[entry] + numbers[k]
    at = 0
    while (at < nodes.shape[0] - 2) & (whole > nodes[at + 1]):
        at += 1
    part = (whole - nodes[at]) / (nodes[at + 1] - nodes[at])
    part = min(_ONE, max(_ZERO, part))
    wide = (along - least) / (most - least)
    offset = mixed(children, at, child, 0, part, wide)
    across = mixed(children, at, child, 1, part, wide)
    opacity = min(_ONE, whole * mixed(children, at, child, 2, part, wide))
    size = scales[i, axis]
    y, z = scales[i, (axis + 1) % 3] / size, scales[i, (axis + 2) % 3] / size
    new_opacities[k] = shared(opacity, along, across, y, z)
    turn = quat_matrix(rotations[i, 0], rotations[i, 1], rotations[i, 2], rotations[i, 3])
    far = offset * size
    new_positions[k, 0] = positions[i, 0] + far * turn[axis]
    new_positions[k, 1] = positions[i, 1] + far * turn[3 + axis]
    new_positions[k, 2] = positions[i, 2] + far * turn[6 + axis]
    for other in range(3):
        new_scales[k, other] = scales[i, other] * (along if other == axis else across)
