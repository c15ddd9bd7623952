"""Queries on a triangle mesh: closest point, ray intersection, inside test."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32, F64, I32
from usdsplat.core.errors import StageError
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim.bvh import LEAF, build_order, find_closest, find_hits, fit_boxes
from usdsplat.kernels.sim.winding import MOMENTS, fit_dipoles, sum_winding
from usdsplat.sim.specs import Surface

FAR = 3.0
"""Distance from which a group of triangles is approximated by one dipole in a winding number, in
radii of the group; the error is at most 0.02."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Hits:
    """Points on a surface, one per query."""

    faces: I32
    """Rows of `Surface.triangles`, -1 where nothing was found, shape (n,)."""
    weights: F32
    """Barycentric weights of the triangle's three corners, shape (n, 3)."""
    squared: F32
    """Squared distance to the query point [unit²], inf where nothing was found, shape (n,)."""
    points: F32
    """Positions [unit], the query points where nothing was found, shape (n, 3)."""


class Triangles:
    """A mesh in a bounding volume hierarchy.

    Args:
        device: Runs the kernels.
        surface: At least one triangle. Its arrays are not kept.

    Raises:
        StageError: If there is no triangle, a triangle names a point that does not exist, or a
            point is not finite.
    """

    def __init__(self, device: Device, surface: Surface) -> None:
        self._device = device
        _check(surface)
        t = len(surface.triangles)
        depth = max(0, math.ceil(math.log2(t / LEAF)))
        corners = surface.points[surface.triangles]
        order = np.arange(t, dtype=np.int32)
        device.run(build_order, corners.mean(axis=1, dtype=np.float32), order, depth)
        self._faces = order
        self._triangles = surface.triangles.copy()
        self._boxes: F32 = np.zeros((2 << depth, 6), np.float32)
        self._corners: F32
        self._moments: F64 | None = None
        self._fit(surface)

    def refit(self, surface: Surface) -> None:
        """Update the positions of the same triangles. Queries become much slower if they moved far
        apart.

        Raises:
            StageError: If the triangles differ, or a point is not finite.
        """
        _check(surface)
        if not np.array_equal(surface.triangles, self._triangles):
            raise StageError(
                "mesh", "other triangles than before", "the same triangles, with moved points"
            )
        self._fit(surface)

    def _fit(self, surface: Surface) -> None:
        corners = surface.points[self._triangles[self._faces]]
        self._corners = np.ascontiguousarray(corners, np.float32).reshape(-1, 9)
        self._moments = None
        self._device.run(fit_boxes, self._corners, self._boxes)

    def closest(self, points: F32, *, within: float = math.inf) -> Hits:
        """Find the closest point of the mesh; at equal distance that of the lowest row.

        Args:
            points: [unit], shape (n, 3).
            within: Ignore anything farther [unit], which is faster.
        """
        out = _empty(len(points))
        square = float(within) ** 2
        tree = (self._corners, self._faces, self._boxes)
        points = np.ascontiguousarray(points, np.float32)
        self._device.run(find_closest, points, square, *tree, out)
        return Hits(faces=out[0], weights=out[1], squared=out[2], points=out[3])

    def rays(self, origins: F32, directions: F32) -> Hits:
        """Find the first intersection of rays with the mesh, from either side.

        Args:
            origins: [unit], shape (n, 3).
            directions: Of any length, shape (n, 3).
        """
        out = _empty(len(origins))
        tree = (self._corners, self._faces, self._boxes)
        origins = np.ascontiguousarray(origins, np.float32)
        directions = np.ascontiguousarray(directions, np.float32)
        self._device.run(find_hits, origins, directions, *tree, out)
        return Hits(faces=out[0], weights=out[1], squared=out[2], points=out[3])

    def winding(self, points: F32, *, far: float = FAR) -> F32:
        """Return the winding number of the mesh at each point, shape (n,): above one half is
        inside.

        Args:
            points: [unit], shape (n, 3).
            far: Distance from which a group of triangles is approximated by one dipole, in radii of
                the group; inf sums every triangle.
        """
        if self._moments is None:
            self._moments = np.zeros((len(self._boxes), MOMENTS), np.float64)
            self._device.run(fit_dipoles, self._corners, self._moments)
        out = np.empty(len(points), np.float32)
        points = np.ascontiguousarray(points, np.float32)
        self._device.run(sum_winding, points, self._corners, self._moments, float(far), out)
        return out


def _empty(n: int) -> tuple[I32, F32, F32, F32]:
    return (
        np.empty(n, np.int32),
        np.empty((n, 3), np.float32),
        np.empty(n, np.float32),
        np.empty((n, 3), np.float32),
    )


def _check(surface: Surface) -> None:
    triangles, points = surface.triangles, surface.points
    if len(triangles) == 0:
        raise StageError("mesh", "no triangles", "at least one")
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise StageError(
            "mesh", "a triangle of a point that does not exist", f"rows 0 to {len(points) - 1}"
        )
    if not np.isfinite(points).all():
        raise StageError("mesh", "a point that is not finite", "finite points")
