"""Triangulate polygons: fans for convex ones, ear clipping for concave ones.

Source of ear clipping: Meisters 1975. Polygons that are not planar are projected along their area
normal (Newell). Polygons that intersect themselves are clipped while ears are left.
"""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import F64, I64
from usdsplat.core.surface.level import Bools, sizes


def triangulate(counts: I64, indices: I64, points: F64 | None) -> tuple[I64, I64]:
    """Return corners of triangles, shape (t, 3), and the polygon of each, shape (t,), in order.

    Args:
        counts: Corners of each polygon, three or more, shape (f,).
        indices: Point at each corner, shape (sum(counts),).
        points: Points, shape (p, 3); None assumes that all polygons are convex.
    """
    first = np.cumsum(counts) - counts
    pieces, owners = [], []
    for n in sizes(counts):
        polygons = np.flatnonzero(counts == n)
        fan = np.stack([np.zeros(n - 2, int), np.arange(1, n - 1), np.arange(2, n)], axis=1)
        local = np.broadcast_to(fan, (len(polygons), n - 2, 3))
        if points is not None and n > 3:
            local = local.copy()
            shapes = points[indices[first[polygons, None] + np.arange(n)]]
            with np.errstate(over="ignore", invalid="ignore"):
                for each in np.flatnonzero(_is_concave(shapes)):
                    local[each] = _clip(_flat(shapes[each]))
        pieces.append((first[polygons, None, None] + local).reshape(-1, 3))
        owners.append(np.repeat(polygons, n - 2))
    if not pieces:
        return np.zeros((0, 3), np.int64), np.zeros(0, np.int64)
    if len(pieces) == 1:
        return pieces[0], owners[0]
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return np.concatenate(pieces)[order], owner[order]


def _is_concave(shapes: F64) -> Bools:
    """Return which polygons, shape (f, n, 3), are concave."""
    arms = np.roll(shapes, -1, axis=1) - shapes
    turns = np.cross(np.roll(arms, 1, axis=1), arms)
    spokes = shapes - shapes[:, :1]
    normals = np.cross(spokes, np.roll(spokes, -1, axis=1)).sum(axis=1)
    return np.asarray((np.einsum("fnk,fk->fn", turns, normals) < 0).any(axis=1))


def _flat(shape: F64) -> F64:
    """Project a polygon, shape (n, 3), along its normal: counter-clockwise, shape (n, 2)."""
    spokes = shape - shape[0]
    normal = np.cross(spokes, np.roll(spokes, -1, axis=0)).sum(axis=0)
    axis = int(np.abs(normal).argmax())
    u, v = (axis + 1) % 3, (axis + 2) % 3
    # Dropping the largest axis of the normal keeps the orientation of a planar polygon's corners.
    flat = spokes[:, [u, v]]
    return flat if normal[axis] >= 0 else flat * np.array([-1.0, 1.0])


def _clip(shape: F64) -> I64:
    """Return triangles of a polygon, shape (n, 2), counter-clockwise: n - 2 rows of corners."""
    left = list(range(len(shape)))
    cut = []
    while len(left) > 3:
        at = next((i for i in range(len(left)) if _is_ear(shape, left, i)), 1)
        cut.append((left[at - 1], left[at], left[(at + 1) % len(left)]))
        del left[at]
    return np.array([*cut, tuple(left)], np.int64)


def _is_ear(shape: F64, left: list[int], at: int) -> bool:
    """Return whether the corner is convex and no other lies in its triangle."""
    a, b, c = shape[[left[at - 1], left[at], left[(at + 1) % len(left)]]]
    if _turn(a, b, c) <= 0:
        return False
    others = shape[left]
    inside = (_turn(a, b, others) >= 0) & (_turn(b, c, others) >= 0) & (_turn(c, a, others) >= 0)
    # Corners that coincide with one of the three do not count: they form a bridge to a hole.
    same = (others[:, None] == np.stack([a, b, c])).all(axis=2).any(axis=1)
    return not (inside & ~same).any()


def _turn(a: F64, b: F64, c: F64) -> F64:
    """Return twice the signed area of a triangle; `c` may be many points."""
    return np.asarray((b[0] - a[0]) * (c[..., 1] - a[1]) - (b[1] - a[1]) * (c[..., 0] - a[0]))
