"""A mesh that splats conform to: closest points, smooth normals, and a frame for each triangle."""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim.facets import measure, smooth
from usdsplat.sim.closest import Hits, Triangles
from usdsplat.sim.specs import Surface


class TargetMesh:
    """A mesh whose points may move.

    Args:
        device: Runs the kernels.
        surface: The mesh.

    Raises:
        StageError: If it has no triangle, or a point that is not finite.
    """

    def __init__(self, device: Device, surface: Surface) -> None:
        self._device = device
        self.tree = Triangles(device, surface)
        t, corners = len(surface.triangles), surface.triangles.reshape(-1)
        self._starts = np.zeros(len(surface.points) + 1, np.int64)
        np.cumsum(np.bincount(corners, minlength=len(surface.points)), out=self._starts[1:])
        self._around = np.argsort(corners, kind="stable").astype(np.int32)
        self.normals: F32 = np.empty((t, 3, 3), np.float32)
        """Unit normals of the corners of triangles."""
        self.frames: F32 = np.empty((t, 4), np.float32)
        """Frames of triangles, as quaternions."""
        self.sizes: F32 = np.empty(t, np.float32)
        """Square roots of the areas of triangles [unit]."""
        self.surface = surface
        self._measure()

    def update(self, surface: Surface) -> None:
        """Move the points.

        Raises:
            StageError: If the triangles differ, or a point is not finite.
        """
        if self.surface is surface or np.array_equal(self.surface.points, surface.points):
            return
        self.tree.refit(surface)
        self.surface = surface
        self._measure()

    def ups(self, hits: Hits) -> F32:
        """Return the unit normals at points of the mesh, shape (n, 3)."""
        found = np.einsum("nk,nki->ni", hits.weights, self.normals[hits.faces])
        found /= np.maximum(np.linalg.norm(found, axis=1, keepdims=True), np.float32(1e-30))
        return found

    def onto(self, points: F32) -> tuple[F32, F32]:
        """Return the closest points of the mesh, and the unit normals there."""
        found = self.tree.closest(points)
        return found.points, self.ups(found)

    def _measure(self) -> None:
        points, triangles = self.surface.points, self.surface.triangles
        flat, angles = np.empty_like(self.frames[:, :3]), np.empty_like(self.frames[:, :3])
        self._device.run(measure, points, triangles, flat, angles, self.frames, self.sizes)
        around = self._starts, self._around
        self._device.run(smooth, triangles, *around, flat, angles, self.normals)
