"""Ray casting of surfaces in float64 NumPy: the oracle of the rasterizer; no formula is shared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F64, I64


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """The nearest triangle of each ray."""

    depth: F64
    """+inf where nothing is."""
    triangle: I64
    """-1 where nothing is."""
    bary: F64
    """Weights of corners 1 and 2, shape (..., 2)."""


def rays(screen, offset=(0.0, 0.0)) -> tuple[F64, F64]:
    """Origins and directions (z = 1) in camera space of all pixels of a screen's data window."""
    x0, y0, x1, y1 = screen.window
    u, v = np.meshgrid(np.arange(x0, x1) + offset[0], np.arange(y0, y1) + offset[1])
    x, y = (u - screen.center[0]) / screen.focal[0], (v - screen.center[1]) / screen.focal[1]
    plane = np.stack([x, y, np.ones_like(x)], axis=-1)
    if screen.orthographic:
        return plane * [1, 1, 0], np.broadcast_to([0.0, 0.0, 1.0], plane.shape)
    return np.zeros_like(plane), plane


def cast(corners: F64, screen, *, one_sided=None, offset=(0.0, 0.0)) -> Hits:
    """Cast a ray through each pixel at `corners`, (n, 3, 3) in camera space.

    Source: Möller and Trumbore 1997. `one_sided` says of which triangles the back is not there.
    """
    origins, directions = rays(screen, offset)
    shape = directions.shape[:-1]
    depth, which, bary = np.full(shape, np.inf), np.full(shape, -1), np.zeros((*shape, 2))
    near, far = screen.clipping_range
    for i, (a, b, c) in enumerate(corners):
        e1, e2 = b - a, c - a
        p = np.cross(directions, e2)
        det = p @ e1
        with np.errstate(all="ignore"):
            s = origins - a
            one = np.sum(s * p, axis=-1) / det
            q = np.cross(s, e1)
            two = np.sum(directions * q, axis=-1) / det
            z = q @ e2 / det
            found = (one >= 0) & (two >= 0) & (one + two <= 1) & (z >= near) & (z <= far)
            if one_sided is not None and one_sided[i]:
                found &= det > 0
            found &= z.astype(np.float32) < depth.astype(np.float32)
        depth[found], which[found] = z[found], i
        bary[found] = np.stack([one, two], axis=-1)[found]
    return Hits(depth, which, bary)


def steady(corners: F64, screen, *, one_sided=None, by=1e-3) -> F64:
    """Where moving the pixel a little does not change which triangle is hit."""
    here = cast(corners, screen, one_sided=one_sided).triangle
    same = np.ones(here.shape, bool)
    for offset in ((by, by), (-by, by), (by, -by), (-by, -by)):
        same &= cast(corners, screen, one_sided=one_sided, offset=offset).triangle == here
    return same
