"""Affectors for tests, and their distances in float64 NumPy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from usdsplat.core.cloud import F64, SplatCloud
from usdsplat.sim.parameters import AffectorParameters
from usdsplat.sim.specs import Affector, Solid, SolidKind, Surface
from usdsplat.sim.state import State


def state_at(positions: Any, *, sigma: float = 1e-3, velocity: Any = (0, 0, 0)) -> State:
    """Splats at points, all of one size and velocity."""
    points = np.ascontiguousarray(positions, np.float32)
    n = len(points)
    cloud = SplatCloud(
        positions=points,
        scales=np.full((n, 3), sigma, np.float32),
        rotations=np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        opacities=np.ones(n, np.float32),
        sh=np.zeros((n, 1, 3), np.float32),
        velocities=np.tile(np.array(velocity, np.float32), (n, 1)),
    )
    return State.of(cloud)


def rotation(axis: Any, angle: float) -> F64:
    """Rodrigues' formula, shape (3, 3)."""
    x, y, z = np.array(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def placed(place: Any = (0, 0, 0), turn: F64 | None = None) -> F64:
    """A rigid matrix."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.eye(3) if turn is None else turn
    matrix[:3, 3] = place
    return matrix


def affector(
    kind: SolidKind,
    size: tuple[float, float, float] = (0.0, 0.0, 0.0),
    matrix: F64 | None = None,
    *,
    surface: Surface | None = None,
    path: str = "/a",
    **knobs: Any,
) -> Affector:
    """One solid, by default without clearance, friction and blend."""
    knobs = {"clearance": 0.0, "friction": 0.0, "blend": 0.0, **knobs}
    solid = Solid(
        kind=kind, size=size, matrix=placed() if matrix is None else matrix, surface=surface
    )
    return Affector(path=path, parameters=AffectorParameters(**knobs), solids=(solid,))


def capsules(
    time: float, *, count: int, radius: float, half: float, spread: float, seed: int, **knobs: Any
) -> list[Affector]:
    """Capsules about the origin that overlap, drift and turn."""
    rng = np.random.default_rng(seed)
    out = []
    for k in range(count):
        turn = rotation(rng.normal(size=3), time * 2) @ rotation(rng.normal(size=3), k)
        place = rng.uniform(-spread, spread, 3) + spread * np.sin(3 * time + rng.uniform(0, 6, 3))
        size = (radius, radius, half)
        out.append(affector("capsule", size, placed(place, turn), path=f"/a{k:02}", **knobs))
    return out


def capsule_gaps(affectors: Sequence[Affector], points: Any, sigma: Any) -> tuple[F64, F64]:
    """(joined, least) distance less clearance of points from capsules with like ends, float64."""
    points = np.asarray(points, np.float64)
    joined = least = np.full(len(points), np.nan)
    for k, each in enumerate(affectors):
        solid, knobs = each.solids[0], each.parameters
        local = (points - solid.matrix[:3, 3]) @ solid.matrix[:3, :3]
        local[:, 2] -= np.clip(local[:, 2], -solid.size[2], solid.size[2])
        gap = np.linalg.norm(local, axis=1) - solid.size[0] - knobs.clearance * sigma
        if k == 0:
            joined = least = gap
            continue
        least = np.minimum(least, gap)
        if knobs.blend == 0:
            joined = np.minimum(joined, gap)
            continue
        part = np.clip(0.5 + 0.5 * (joined - gap) / knobs.blend, 0, 1)
        joined = joined * (1 - part) + gap * part - knobs.blend * part * (1 - part)
    return joined, least


def icosphere(levels: int, radius: float = 1.0) -> Surface:
    """A sphere of 20 * 4^levels triangles, corners on it."""
    g = (1 + 5**0.5) / 2
    points = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g),
              (0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]  # fmt: skip
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4),
             (11, 10, 2), (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8),
             (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]  # fmt: skip
    corners = np.array(points, float)[np.array(faces)]
    for _ in range(levels):
        a, b, c = corners.transpose(1, 0, 2)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        pieces = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        corners = np.concatenate([np.stack(piece, axis=1) for piece in pieces])
        corners /= np.linalg.norm(corners, axis=2, keepdims=True)
    corners *= radius / np.linalg.norm(corners, axis=2, keepdims=True)
    unique, rows = np.unique(corners.reshape(-1, 3).round(9), axis=0, return_inverse=True)
    return Surface(points=unique.astype(np.float32), triangles=rows.reshape(-1, 3).astype(np.int32))
