"""Project world points to a viewport, and pixels to rays.

Positions in the viewport are (x, y) from the top left corner of its first pixel, y down [pixel].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64
from usdsplat.render.framing import conform
from usdsplat.render.specs import CameraSpec, Framing

Pixel = tuple[float, float]
Ray = tuple[F64, F64]
"""Origin and unit direction, shape (3,) each."""


@dataclass(frozen=True, slots=True, eq=False)
class Projection:
    """The projection of a camera on a viewport of its picture's size."""

    to_camera: F64
    """World to camera: x right, y up, looking down -z; shape (4, 4)."""
    is_orthographic: bool
    focal: tuple[float, float]
    """Focal lengths [pixel]; for an orthographic camera scales [pixel / scene unit]."""
    center: Pixel
    """Intersection of the camera's axis with the viewport."""
    near: float
    """Near plane [scene unit]."""

    @classmethod
    def of(cls, camera: CameraSpec, size: tuple[int, int]) -> Projection:
        """Create the projection of a camera for a viewport of a width and height [pixel].

        Raises:
            UsageError: If the camera's aperture has no area.
        """
        (left, bottom, right, top), _ = conform(camera.window, Framing(resolution=size))
        focal = size[0] / (right - left), size[1] / (top - bottom)
        near, far = camera.clipping_range
        return cls(
            to_camera=np.reshape(camera.world_to_camera, (4, 4)),
            is_orthographic=camera.orthographic,
            focal=focal,
            center=(-left * focal[0], top * focal[1]),
            near=near if near > 0 or camera.orthographic else 1e-6 * far,
        )

    @property
    def axes(self) -> F64:
        """Vectors right, up and back in the world, as rows, shape (3, 3)."""
        return self.to_camera[:3, :3]

    @property
    def eye(self) -> F64:
        """Position of the camera, shape (3,)."""
        return -self.axes.T @ self.to_camera[:3, 3]

    def depths(self, points: npt.ArrayLike) -> F64:
        """Return planar depths of points (n, 3), shape (n,)."""
        return np.asarray(-(np.atleast_2d(points) @ self.axes[2] + self.to_camera[2, 3]))

    def pixels(self, points: npt.ArrayLike) -> F64:
        """Project points (n, 3) to pixels (n, 2); invalid for points behind the eye."""
        local = np.atleast_2d(points) @ self.axes.T + self.to_camera[:3, 3]
        depth = 1.0 if self.is_orthographic else -local[:, 2:]
        with np.errstate(divide="ignore", invalid="ignore"):
            flat = local[:, :2] / depth
        return np.asarray(flat * (self.focal[0], -self.focal[1]) + self.center)

    def ray(self, pixel: Pixel) -> Ray:
        """Return the ray through a point of the viewport, from the eye or the eye's plane."""
        x = (pixel[0] - self.center[0]) / self.focal[0]
        y = (self.center[1] - pixel[1]) / self.focal[1]
        if self.is_orthographic:
            return self.eye + np.array((x, y)) @ self.axes[:2], -self.axes[2]
        direction = np.array((x, y, -1.0)) @ self.axes
        return self.eye, direction / np.linalg.norm(direction)

    def towards(self, point: F64) -> F64:
        """Return the unit view direction to a point, shape (3,)."""
        if self.is_orthographic:
            return -self.axes[2]
        way = point - self.eye
        return np.asarray(way / max(float(np.linalg.norm(way)), 1e-300))

    def unit(self, point: F64) -> float:
        """Return the height of a pixel at the depth of a point [scene unit]."""
        depth = 1.0 if self.is_orthographic else float(self.depths(point)[0])
        return depth / self.focal[1]

    def line(self, start: F64, end: F64) -> tuple[Pixel, Pixel] | None:
        """Project a line, clipped at the near plane; None if it is invisible."""
        first, last = self.depths([start, end]) - self.near
        if first < 0 and last < 0:
            return None
        part = first / (first - last) if first * last < 0 else 0.0
        if first < 0:
            start = start + part * (end - start)
        elif last < 0:
            end = start + part * (end - start)
        (x0, y0), (x1, y1) = self.pixels([start, end])
        return (float(x0), float(y0)), (float(x1), float(y1))
