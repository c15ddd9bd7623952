"""Triangulate UsdGeom's geometric primitives, with the normals of the exact shapes.

Round shapes have 128 sides and spheres 64 rows: surfaces and silhouettes are within 1e-3 of the
radius. In texture coordinates, u goes around the axis and v along the profile from bottom to top.
Each side of a cube, and a plane, has 0 to 1 in both directions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from usdsplat.core.cloud import F32, F64, I32

SIDES = 128
"""Number of sides of a round shape; a chord is within 3.1e-4 of the radius."""

Axis = Literal["X", "Y", "Z"]
Line = tuple[F64, F64]
"""Smooth part of a profile: (radius, height) and normal of each point, both (m, 2)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Shape:
    """A triangulated shape, counter-clockwise seen from outside."""

    points: F32
    """Points [scene unit], shape (p, 3)."""
    triangles: I32
    """Triangles as rows of `points`, shape (t, 3)."""
    normals: F32
    """Unit normal at each corner, shape (t, 3, 3)."""
    uvs: F32
    """Texture coordinates at each corner, shape (t, 3, 2)."""


def sphere(*, radius: float = 1.0) -> Shape:
    """Return a sphere about the origin with poles on z."""
    return _revolve([_arc(radius, 0.0, -np.pi / 2, np.pi / 2)], "Z")


def cylinder(
    *, radius: float = 1.0, height: float = 2.0, axis: Axis = "Z", top: float | None = None
) -> Shape:
    """Return a closed cylinder about an axis, centred at the origin.

    Args:
        radius: Radius of the bottom, and of the top unless `top` is given.
        height: Distance from bottom to top.
        axis: Which way is up.
        top: Radius of the top, as in Cylinder_1.
    """
    top = radius if top is None else top
    low, high = -height / 2, height / 2
    side = (height, radius - top)
    lines = [
        _segment((0.0, low), (radius, low), (0.0, -1.0)),
        _segment((radius, low), (top, high), side),
    ]
    if top > 0:
        lines.append(_segment((top, high), (0.0, high), (0.0, 1.0)))
    return _revolve(lines, axis)


def cone(*, radius: float = 1.0, height: float = 2.0, axis: Axis = "Z") -> Shape:
    """Return a closed cone with its apex up the axis, centred at the origin."""
    return cylinder(radius=radius, height=height, axis=axis, top=0.0)


def capsule(
    *, radius: float = 0.5, height: float = 1.0, axis: Axis = "Z", top: float | None = None
) -> Shape:
    """Return a capsule: two spheres about the ends of a segment of length `height`, and their hull.

    Args:
        radius: Radius of the lower sphere, and of the upper unless `top` is given.
        height: Length of the segment, without the spheres.
        axis: Which way is up.
        top: Radius of the upper sphere, as in Capsule_1.
    """
    top = radius if top is None else top
    slope = 0.0 if height <= 0 else (radius - top) / height
    tilt = float(np.arcsin(np.clip(slope, -1.0, 1.0)))
    lower = _arc(radius, -height / 2, -np.pi / 2, tilt)
    upper = _arc(top, height / 2, tilt, np.pi / 2)
    outline = np.concatenate([lower[0], upper[0]]), np.concatenate([lower[1], upper[1]])
    return _revolve([outline], axis)


def cube(*, size: float = 2.0) -> Shape:
    """Return a cube about the origin with edges of length `size` along the axes."""
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    points, normals = [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            face = np.empty((4, 3))
            face[:, axis] = sign
            face[:, (axis + 1) % 3] = square[:, 0] * sign
            face[:, (axis + 2) % 3] = square[:, 1]
            points.append(face * size / 2)
            normals.append(np.eye(3)[axis] * sign)
    return _sheets(np.array(points), np.array(normals))


def plane(*, width: float = 2.0, length: float = 2.0, axis: Axis = "Z") -> Shape:
    """Return a rectangle about the origin that faces up an axis.

    Width is along x, or along z for axis X; length is along y, or along z for axis Y.
    """
    up = "XYZ".index(axis)
    wide, long = {"X": (2, 1), "Y": (0, 2), "Z": (0, 1)}[axis]
    points = np.zeros((1, 4, 3))
    points[0, :, wide] = np.array([-0.5, 0.5, 0.5, -0.5]) * width
    points[0, :, long] = np.array([-0.5, -0.5, 0.5, 0.5]) * length
    return _sheets(points, np.eye(3)[up][None])


def _sheets(points: F64, normals: F64) -> Shape:
    """Return flat quads, shape (n, 4, 3), that face along their normals, shape (n, 3)."""
    facing = np.cross(points[:, 1] - points[:, 0], points[:, 3] - points[:, 0])
    turned = (facing * normals).sum(axis=1) < 0
    corners = np.where(turned[:, None, None], [[0, 2, 1], [0, 3, 2]], [[0, 1, 2], [0, 2, 3]])
    first = 4 * np.arange(len(points))[:, None, None]
    uvs = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    return Shape(
        points=points.reshape(-1, 3).astype(np.float32),
        triangles=(first + corners).reshape(-1, 3).astype(np.int32),
        normals=np.broadcast_to(normals[:, None, None], (len(points), 2, 3, 3))
        .reshape(-1, 3, 3)
        .astype(np.float32),
        uvs=uvs[corners].reshape(-1, 3, 2).astype(np.float32),
    )


def _arc(radius: float, height: float, first: float, last: float) -> Line:
    """Return part of a sphere's profile at a height, between two latitudes [radian]."""
    rows = max(1, round(SIDES / 2 * (last - first) / np.pi))
    latitude = np.linspace(first, last, rows + 1)
    normals = np.stack([np.cos(latitude), np.sin(latitude)], axis=1)
    normals[np.abs(normals) < 1e-15] = 0.0  # a pole lies on the axis
    return radius * normals + (0.0, height), normals


def _segment(
    first: tuple[float, float], last: tuple[float, float], normal: tuple[float, float]
) -> Line:
    """Return a straight part of a profile."""
    unit = np.array(normal) / max(float(np.hypot(*normal)), 1e-30)
    return np.array([first, last]), np.stack([unit, unit])


def _revolve(lines: list[Line], axis: Axis) -> Shape:
    """Revolve a profile, from bottom to top, about an axis."""
    angle = 2 * np.pi * np.arange(SIDES + 1) / SIDES
    steps = [np.linalg.norm(np.diff(line, axis=0), axis=1) for line, _ in lines]
    total = max(float(sum(step.sum() for step in steps)), 1e-30)
    points, triangles, normals, uvs = [], [], [], []
    begun, count = 0.0, 0
    for (line, facing), step in zip(lines, steps, strict=True):
        v = (begun + np.concatenate([[0.0], np.cumsum(step)])) / total
        begun += float(step.sum())
        rows = len(line)
        points.append(_turned(line[:, None], angle[:-1], axis).reshape(-1, 3))
        row, side = np.divmod(np.arange((rows - 1) * SIDES), SIDES)
        # Both triangles of each quad, as (row, side) of their corners.
        at_row = row[:, None, None] + np.array([[0, 0, 1], [0, 1, 1]])
        at_side = side[:, None, None] + np.array([[0, 1, 1], [0, 1, 0]])
        at_row, at_side = at_row.reshape(-1, 3), at_side.reshape(-1, 3)
        # At a pole, one triangle of a quad has no area; the apex of the other lies between its
        # sides.
        on_axis = line[at_row, 0] == 0
        kept = on_axis.sum(axis=1) < 2
        at_row, at_side, on_axis = at_row[kept], at_side[kept], on_axis[kept]
        turn = at_side.astype(float)
        middle = (at_side.min(axis=1) + at_side.max(axis=1)) / 2
        turn = np.where(on_axis, middle[:, None], turn)
        triangles.append(count + at_row * SIDES + at_side % SIDES)
        normals.append(_turned(facing[at_row], 2 * np.pi * turn / SIDES, axis))
        uvs.append(np.stack([turn / SIDES, v[at_row]], axis=-1))
        count += rows * SIDES
    return Shape(
        points=np.concatenate(points).astype(np.float32),
        triangles=np.concatenate(triangles).astype(np.int32),
        normals=np.concatenate(normals).astype(np.float32),
        uvs=np.concatenate(uvs).astype(np.float32),
    )


def _turned(outline: F64, angle: F64, axis: Axis) -> F64:
    """Return points or normals (radius, height), shape (..., 2), at angles about an axis."""
    up = "XYZ".index(axis)
    radius, height = np.broadcast_arrays(outline[..., 0], outline[..., 1])
    shape = np.broadcast_shapes(radius.shape, angle.shape)
    result = np.empty((*shape, 3))
    result[..., up] = height
    result[..., (up + 1) % 3] = radius * np.cos(angle)
    result[..., (up + 2) % 3] = radius * np.sin(angle)
    return result
