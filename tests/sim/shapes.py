"""Meshes with known properties."""

from __future__ import annotations

import numpy as np

from usdsplat.sim.specs import Surface


def sphere(levels: int, radius: float = 1.0) -> Surface:
    """An octahedron split `levels` times: 8 * 4**levels triangles, points on the sphere."""
    corners = np.array(
        [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float64
    )
    faces = np.array(
        [
            [0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4],
            [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5],
        ]
    )  # fmt: skip
    for _ in range(levels):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        keys, inverse = np.unique(edges @ [len(corners), 1], return_inverse=True)
        unique = np.stack(np.divmod(keys, len(corners)), axis=1)
        middle = corners[unique].mean(axis=1)
        ab, bc, ca = (inverse.reshape(-1, 3) + len(corners)).T
        corners = np.concatenate([corners, middle / np.linalg.norm(middle, axis=1)[:, None]])
        a, b, c = faces.T
        rows = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = np.concatenate([np.stack(row, axis=1) for row in rows])
    return Surface(points=(radius * corners).astype(np.float32), triangles=faces.astype(np.int32))


def sheet(cells: int, size: float = 2.0) -> Surface:
    """A square about the origin in the plane z = 0, facing +z."""
    at = np.linspace(-size / 2, size / 2, cells + 1)
    y, x = np.meshgrid(at, at, indexing="ij")
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    row, column = np.divmod(np.arange(cells * cells), cells)
    a = row * (cells + 1) + column
    b, c, d = a + 1, a + cells + 2, a + cells + 1
    faces = np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)
    return Surface(points=points.astype(np.float32), triangles=faces.astype(np.int32))


def soup(count: int, seed: int) -> Surface:
    """Triangles anywhere in a cube of edge 2, a few of them without area."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (count, 1, 3)) + rng.normal(0, 0.1, (count, 3, 3))
    points[::50, 2] = points[::50, 1]
    points[::70, 1:] = points[::70, :1]
    triangles = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    return Surface(points=points.reshape(-1, 3).astype(np.float32), triangles=triangles)
