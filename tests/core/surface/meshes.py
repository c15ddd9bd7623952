"""Small meshes for the tests of surfaces."""

from __future__ import annotations

from typing import Any

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.core.surface.refine import Surface
from usdsplat.core.surface.topology import Topology

CUBE_POINTS = np.float32([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)])
CUBE_FACES = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
CUBE_EDGES = [
    *((0, 1), (2, 3), (4, 5), (6, 7)),
    *((0, 2), (1, 3), (4, 6), (5, 7)),
    *((0, 4), (1, 5), (2, 6), (3, 7)),
]
OCTAHEDRON_POINTS = np.float32(
    [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
)
OCTAHEDRON_FACES = [
    [0, 2, 4],
    [2, 1, 4],
    [1, 3, 4],
    [3, 0, 4],
    [2, 0, 5],
    [1, 2, 5],
    [3, 1, 5],
    [0, 3, 5],
]


def topology(faces: list[list[int]], creases: Any = None, **rest: Any) -> Topology:
    """A topology of listed faces; creases map pairs of points to sharpness."""
    creases = creases or {}
    return Topology(
        counts=np.array([len(face) for face in faces], np.int32),
        indices=np.array([point for face in faces for point in face], np.int32),
        crease_indices=np.array(list(creases), np.int32).ravel(),
        crease_lengths=np.full(len(creases), 2, np.int32),
        crease_sharpnesses=np.array(list(creases.values()), np.float32),
        **rest,
    )


def surface(
    faces: list[list[int]], points: int, creases: Any = None, levels: int = 1, **rest: Any
) -> Surface:
    """The surface of listed faces."""
    return Surface(topology(faces, creases, **rest), points=points, levels=levels)


def grid(columns: int, rows: int) -> tuple[F32, list[list[int]]]:
    """Unit quads in the plane z = 0."""
    points = [[x, y, 0] for y in range(rows + 1) for x in range(columns + 1)]
    across = columns + 1
    faces = [
        [y * across + x, y * across + x + 1, (y + 1) * across + x + 1, (y + 1) * across + x]
        for y in range(rows)
        for x in range(columns)
    ]
    return np.float32(points), faces


def volume(points: F32, triangles: Any) -> float:
    """Signed volume that triangles enclose: positive when they face outwards."""
    p = points.astype(np.float64)[triangles]
    return float(np.einsum("tk,tk->", p[:, 0], np.cross(p[:, 1], p[:, 2])) / 6)
