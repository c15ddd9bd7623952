"""Convert camera and framing of a view to pixels, for kernels."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64
from usdsplat.core.errors import UsageError
from usdsplat.kernels import bins, position, project
from usdsplat.render.framing import conform
from usdsplat.render.scene import matrix
from usdsplat.render.specs import View

USD_TO_SCREEN = np.diag([1.0, -1.0, -1.0, 1.0])
"""Transform from camera space of USD (y up, view along -z) to that of kernels (y down, view along
z)."""
MARGIN = 0.3
"""Margin of the clamp of the affine approximation on each side, as a fraction of half the display
window."""
NEAREST = 1e-6
"""Near plane as a fraction of the far plane, for a perspective camera whose own near plane is not
in front of it. Nothing at or behind the eye can be visible."""


@dataclass(frozen=True, slots=True, eq=False)
class Screen:
    """Pinhole or parallel projection onto pixels; pixel (0, 0) is centred on (0, 0)."""

    world_to_camera: F64
    """Shape (4, 4): x right, y down, z forward."""
    orthographic: bool
    focal: tuple[float, float]
    """[pixel]; for an orthographic camera [pixel / scene unit]."""
    center: tuple[float, float]
    """Point of the picture on the optical axis [pixel]."""
    size: tuple[int, int]
    """Display window [pixel]."""
    window: tuple[int, int, int, int]
    """Data window (x0, y0, x1, y1) [pixel], end exclusive."""
    clipping_range: tuple[float, float]
    low_pass: float
    """Added to the screen covariances [pixel²]."""

    @classmethod
    def of(cls, view: View) -> Screen:
        """Conform the camera's aperture to the image and measure it in pixels.

        Raises:
            UsageError: If the aperture, the image, the data window or a pixel has no area.
        """
        camera, framing = view.camera, view.framing
        (left, bottom, right, top), _ = conform(camera.window, framing)
        width, height = framing.resolution
        focal = width / (right - left), height / (top - bottom)
        x0, y0, x1, y1 = framing.window
        if not (x0 < x1 and y0 < y1):
            raise UsageError("data window", str(framing.window), "x0 < x1 and y0 < y1")
        if not 0 < framing.pixel_scale < math.inf:
            raise UsageError("pixel scale", f"{framing.pixel_scale:g}", "a positive number")
        near, far = camera.clipping_range
        if near <= 0 and not camera.orthographic:
            near = NEAREST * far
        return cls(
            world_to_camera=USD_TO_SCREEN @ matrix(camera.world_to_camera),
            orthographic=camera.orthographic,
            focal=focal,
            center=(-left * focal[0] - 0.5, top * focal[1] - 0.5),
            size=framing.resolution,
            window=framing.window,
            clipping_range=(near, far),
            low_pass=float(project.LOW_PASS) / framing.pixel_scale**2,
        )

    @property
    def eye(self) -> F64:
        """Position of the camera in the world, shape (3,)."""
        return np.asarray(np.linalg.inv(self.world_to_camera)[:3, 3])

    @property
    def forward(self) -> F64:
        """View direction in the world, unit length, shape (3,)."""
        axis = np.linalg.inv(self.world_to_camera)[:3, 2]
        return np.asarray(axis / np.linalg.norm(axis))

    def through(
        self, lens: tuple[float, float], focus: float, offset: tuple[float, float]
    ) -> Screen:
        """Return the screen for another point of the lens and other points of the pixels.

        Points at the focus distance stay at the same pixel.

        Args:
            lens: Right and up from the middle of the lens [scene unit].
            focus: Planar depth in focus [scene unit]; used only with a lens.
            offset: From the pixels' centres, right and down [pixel].
        """
        shift = np.eye(4)
        (u, v), right, down = self.center, lens[0], -lens[1]
        if right or down:
            shift[:2, 3] = -right, -down
            u += self.focal[0] * right / focus
            v += self.focal[1] * down / focus
        return replace(
            self,
            world_to_camera=shift @ self.world_to_camera,
            center=(u - offset[0], v - offset[1]),
        )

    def view_record(self) -> npt.NDArray[Any]:
        """Return the VIEW record of `kernels.position`, shape (1,)."""
        values = (*self.focal, *self.center, self.orthographic)
        return np.array([values], position.VIEW)

    def bands(self, pixels: int) -> Iterator[tuple[int, int]]:
        """Divide the data window into bands of whole rows of tiles, of about `pixels` pixels
        each."""
        x0, y0, x1, y1 = self.window
        rows = max(1, pixels // max(1, x1 - x0) // bins.TILE) * bins.TILE
        while y0 < y1:
            end = min(y1, (y0 + rows) // bins.TILE * bins.TILE)
            yield y0, end
            y0 = end

    def record(
        self, *, tangential: bool, by_distance: bool, footprint: float, margin: int = 0
    ) -> npt.NDArray[Any]:
        """Return the CAMERA record of the kernels, shape (1,).

        Args:
            tangential: Whether each splat is projected on the plane across its viewing ray.
            by_distance: Whether splats are sorted by distance instead of planar depth.
            footprint: Size of a pixel of the photographs at the splats [local unit]: infinity for
                classic splats, 0 for antialiased ones.
            margin: Splats up to so many pixels outside the data window are kept.
        """
        (fx, fy), (cx, cy), (width, height) = self.focal, self.center, self.size
        x0, y0, x1, y1 = self.window
        record = np.zeros(1, project.CAMERA)
        record["fx"], record["fy"], record["cx"], record["cy"] = fx, fy, cx, cy
        record["near"], record["far"] = self.clipping_range
        extra_u, extra_v = MARGIN * 0.5 * width / fx, MARGIN * 0.5 * height / fy
        record["low_u"], record["high_u"] = (
            (-0.5 - cx) / fx - extra_u,
            (width - 0.5 - cx) / fx + extra_u,
        )
        record["low_v"], record["high_v"] = (
            (-0.5 - cy) / fy - extra_v,
            (height - 0.5 - cy) / fy + extra_v,
        )
        record["left"], record["top"] = x0 - margin, y0 - margin
        record["right"], record["bottom"] = x1 - 1 + margin, y1 - 1 + margin
        record["low_pass"] = self.low_pass
        record["projection"] = (
            project.ORTHOGRAPHIC
            if self.orthographic
            else project.TANGENTIAL
            if tangential
            else project.PERSPECTIVE
        )
        record["sorting"] = project.SORT_DISTANCE if by_distance else project.SORT_Z
        record["trained"] = project.LOW_PASS * footprint**2 * fx * fy
        return record
