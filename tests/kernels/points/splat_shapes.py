"""Shapes made of flat splats, with known normals."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from usdsplat.kernels.device import Device
from usdsplat.kernels.points.surface_normals import SurfaceNormals, surface_normals

GOLDEN = math.pi * (3 - math.sqrt(5))
"""Turn from one point of a spiral to the next [rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """Splats, and the normals of the surface that they lie on."""

    splats: tuple[Any, ...]
    """Arguments of `surface_normals`."""
    normals: Any
    spacing: float

    @property
    def positions(self) -> Any:
        return self.splats[0]

    def found(self, device: Device) -> SurfaceNormals:
        return surface_normals(device, *self.splats)

    def errors(self, found: SurfaceNormals) -> Any:
        """Angles to the true normals [degree], 180 where they point inwards."""
        cosines = np.einsum("ij,ij->i", found.normals.astype(np.float64), self.normals)
        return np.degrees(np.arccos(np.clip(cosines, -1, 1)))


def shape_of(points: Any, normals: Any, area: float, *, jitter: float = 0.5) -> Shape:
    """Splats with uneven positions, axes, sizes and opacities.

    Args:
        points: On the surface, evenly distributed.
        normals: Unit vectors there.
        area: That of the surface.
        jitter: Standard deviation of the splats' thin axes from the normals [rad], a third of it.
    """
    rng = np.random.default_rng(len(points))
    n, spacing = len(points), math.sqrt(area / len(points))
    positions = points + 0.05 * spacing * rng.normal(size=(n, 1)) * normals
    axes = normals + jitter / 3 * rng.normal(size=(n, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    # the shortest turn from z to the axis, or half a turn about x
    turns = np.stack([1 + axes[:, 2], -axes[:, 1], axes[:, 0], np.zeros(n)], axis=1)
    turns[turns[:, 0] < 1e-6] = 0, 1, 0, 0
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    scales = spacing * np.concatenate([rng.uniform(0.5, 1, (n, 2)), np.full((n, 1), 0.1)], axis=1)
    splats = positions, turns, scales, rng.uniform(0.5, 1, n)
    return Shape(tuple(np.float32(array) for array in splats), normals, spacing)


def sphere(n: int) -> Shape:
    """A sphere of radius 1."""
    i = np.arange(n) + 0.5
    z, turn = 1 - 2 * i / n, i * GOLDEN
    r = np.sqrt(1 - z * z)
    points = np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)
    return shape_of(points, points, 4 * math.pi)


def squares(rows: int, seed: int = 1) -> Any:
    """Uneven points in the square [-1, 1]^2, shape (rows^2, 2)."""
    at = np.stack(np.meshgrid(np.arange(rows), np.arange(rows), indexing="ij"), -1).reshape(-1, 2)
    return 2 * (at + np.random.default_rng(seed).uniform(0.15, 0.85, at.shape)) / rows - 1


def plane(rows: int) -> Shape:
    """The square [-1, 1]^2 at z = 0, with normals that point to +z."""
    points = np.concatenate([squares(rows), np.zeros((rows * rows, 1))], axis=1)
    return shape_of(points, np.tile([0.0, 0, 1], (rows * rows, 1)), 4)


def cube(rows: int) -> Shape:
    """The surface of [-1, 1]^3."""
    points, normals = np.empty((6, rows * rows, 3)), np.zeros((6, rows * rows, 3))
    for side in range(6):
        axis, sign = side % 3, 1 - 2 * (side // 3)
        points[side][:, [(axis + 1) % 3, (axis + 2) % 3]] = squares(rows, side)
        points[side][:, axis] = normals[side][:, axis] = sign
    return shape_of(points.reshape(-1, 3), normals.reshape(-1, 3), 24)


def torus(n: int, tube: float = 0.35) -> Shape:
    """A torus of radius 1 about z, whose tube has this radius; about n splats."""
    spacing = math.sqrt(4 * math.pi**2 * tube / n)
    rings = round(2 * math.pi * tube / spacing)
    u, v = [], []
    for ring in range(rings):
        around = 2 * math.pi * ring / rings
        count = round(2 * math.pi * (1 + tube * math.cos(around)) / spacing)
        u.append(2 * math.pi * (np.arange(count) + 0.5 * (ring % 2)) / count)
        v.append(np.full(count, around))
    a, b = np.concatenate(u), np.concatenate(v)
    normals = np.stack([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)], axis=1)
    middle = np.stack([np.cos(a), np.sin(a), np.zeros(len(a))], axis=1)
    return shape_of(middle + tube * normals, normals, 4 * math.pi**2 * tube)
