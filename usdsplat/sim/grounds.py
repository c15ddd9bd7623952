"""What splats land on: the triangles of a mesh, or the surface through the points of a capture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from usdsplat.core.cloud import F32, I32
from usdsplat.kernels.device import Device
from usdsplat.sim.sheets import Sheet, SheetGoal
from usdsplat.sim.specs import Surface
from usdsplat.sim.target_mesh import TargetMesh


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Footing:
    """Points of a surface under n splats."""

    points: F32
    """[unit], shape (n, 3)."""
    ups: F32
    """Unit normals, shape (n, 3)."""
    faces: I32
    """Triangles in whose frame the splats are placed, shape (n,)."""
    places: F32
    """Barycentric weights, shape (n, 3)."""


class Ground(Protocol):
    """A surface, with triangles in whose frames splats are placed."""

    @property
    def frames(self) -> F32:
        """Frames of the triangles, as quaternions, shape (t, 4)."""

    @property
    def sizes(self) -> F32:
        """Square roots of their areas [unit], shape (t,)."""

    def under(self, points: F32) -> Footing:
        """Return the points of the surface that are near to points, shape (n, 3)."""

    def placed(self, footing: Footing, heights: F32, depths: F32) -> tuple[F32, F32, F32]:
        """Return barycentric weights, heights of which a part is kept, and depths, of splats at
        heights over the surface and depths below it [unit], shape (n,)."""


class MeshGround:
    """The surface of a mesh."""

    def __init__(self, mesh: TargetMesh) -> None:
        self._mesh = mesh
        self.frames, self.sizes = mesh.frames, mesh.sizes

    def under(self, points: F32) -> Footing:
        """Return the closest points."""
        hits = self._mesh.tree.closest(points)
        return Footing(
            points=hits.points, ups=self._mesh.ups(hits), faces=hits.faces, places=hits.weights
        )

    def placed(self, footing: Footing, heights: F32, depths: F32) -> tuple[F32, F32, F32]:
        """Return the weights on the splats' own triangles."""
        return footing.places, heights, depths


class SheetGround:
    """The surface through a sheet, in the frame of one triangle.

    Args:
        device: Runs the kernels.
        sheet: The sheet.
        mesh: Triangles that do not move against the sheet.
        face: The triangle in whose frame splats are placed.
        keep: Part of their heights that they keep.
    """

    def __init__(
        self, device: Device, sheet: Sheet, mesh: TargetMesh, face: int, keep: float
    ) -> None:
        self.goal = SheetGoal(device, sheet)
        self.frames, self.sizes = mesh.frames, mesh.sizes
        self._mesh, self._face, self._keep = mesh, face, np.float32(keep)

    def under(self, points: F32) -> Footing:
        """Return close points."""
        found, ups = self.goal.onto(points)
        faces = np.full(len(points), self._face, np.int32)
        return Footing(points=found, ups=ups, faces=faces, places=np.zeros_like(found))

    def placed(self, footing: Footing, heights: F32, depths: F32) -> tuple[F32, F32, F32]:
        """Return weights on the triangle and depths below it; nothing is left of the heights."""
        over = self._keep * heights - depths
        goals = footing.points.astype(np.float64) + over[:, None] * footing.ups
        surface = self._mesh.surface
        first, second, third = surface.points[surface.triangles[self._face]].astype(np.float64)
        along, across = second - first, third - first
        normal = np.cross(along, across)
        normal /= np.linalg.norm(normal)
        axes = np.linalg.inv(np.stack([along, across, normal]))
        local = np.einsum("ni,ij->nj", goals - first, axes)
        weights = np.stack([1 - local[:, 0] - local[:, 1], local[:, 0], local[:, 1]], axis=1)
        none = np.zeros_like(heights)
        return weights.astype(np.float32), none, -local[:, 2].astype(np.float32)


def frame_triangle(points: F32) -> Surface:
    """Return a triangle as large as some points, as a frame for places near them."""
    low, high = points.min(axis=0), points.max(axis=0)
    size = float(np.linalg.norm(high - low)) or 1.0
    corners = low + size * np.eye(3, dtype=np.float32)
    return Surface(points=corners.astype(np.float32), triangles=np.array([[0, 1, 2]], np.int32))
