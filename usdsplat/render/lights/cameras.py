"""Place the camera of a sample of a light, so that it sees everything that casts shadows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64
from usdsplat.kernels import lighting
from usdsplat.render.fields import Box
from usdsplat.render.lights.sampling import frame_about
from usdsplat.render.scene import RenderScene
from usdsplat.render.screen import Screen

LOW_PASS = 1e-3
"""Variance added to the footprints of casters [pixel²]: receivers are points, so nothing needs a
filter; it keeps flat splats seen edge-on invertible."""
MARGIN = 0.5
"""Part of the extent of all splats but strays by which their pictures are larger on each side."""
SPLAT_PIXELS = 4080
"""Longer side of the pictures of splats [pixel]. Their shadows do not depend on it; tiles of 16
pixels hold lists of a few hundred splats. There are 255 x 255 tiles at most: a GPU sorts their
numbers, and one for no tile, as 16 bits."""
WIDEST = math.radians(50.0)
"""Largest half angle of one camera; a light that sees casters in more directions has six."""
NEAREST = 1e-4
"""Near plane of a point's camera as a fraction of its farthest caster's distance."""

AXES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float64)
"""Axes of the six cameras of a light, in the order of `kernels.lighting.face_of`."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LightCamera:
    """Camera of one sample of a light, with a screen for each kind of caster."""

    light: npt.NDArray[Any]
    """The LIGHT record of the sample, shape (1,)."""
    splats: Screen | None
    """Screen that sees all splats; None if there are none."""
    surfaces: Screen | None
    """Screen that sees all meshes; None if there are none."""

    @property
    def world_to_screen(self) -> F64:
        """World to camera space, shape (3, 4)."""
        screen = self.splats or self.surfaces
        matrix = np.eye(4) if screen is None else screen.world_to_camera
        return np.ascontiguousarray(matrix[:3])


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CasterBounds:
    """Bounds in the world of what casts shadows."""

    splats: Box | None
    """Most splats: without strays. Pictures are fitted to it."""
    surfaces: Box | None
    everything: Box | None
    """All of it, with strays."""


def bounds_of(scene: RenderScene) -> CasterBounds:
    """Return the bounds of everything visible."""
    splats, surfaces = scene.caster_bounds()
    everything = scene.bounds()
    if splats is not None and everything is not None:
        more = MARGIN * float((splats[1] - splats[0]).max())
        low, high = np.maximum(splats[0] - more, everything[0]), splats[1] + more
        splats = (low, np.minimum(high, everything[1])) if more > 0 else everything
    return CasterBounds(splats=splats, surfaces=surfaces, everything=everything)


def cameras_of(
    light: npt.NDArray[Any], bounds: CasterBounds, resolution: int
) -> tuple[LightCamera, ...]:
    """Return the cameras of a sample, one or six.

    Args:
        light: A LIGHT record, shape (1,).
        resolution: Length of the longer side of the picture of surfaces [pixel].
    """
    if bounds.everything is None or not light["casts"][0]:
        return (LightCamera(light=light, splats=None, surfaces=None),)
    corners = _corners(bounds.everything)
    place = np.array([light["x"][0], light["y"][0], light["z"][0]])
    if light["kind"][0] == lighting.DISTANT:
        matrix = _looking(-place, corners.mean(axis=0))
        matrix[2, 3] -= (corners @ matrix[2, :3] + matrix[2, 3]).min()
        return (_one(light, matrix, bounds, resolution, is_parallel=True),)
    away = corners.mean(axis=0) - place
    distance, radius = (
        float(np.linalg.norm(away)),
        0.5 * float(np.linalg.norm(np.ptp(corners, axis=0))),
    )
    if distance * math.sin(WIDEST) > radius:
        matrix = _looking(away / distance, place)
        return (_one(light, matrix, bounds, resolution, is_parallel=False),)
    found = []
    for face, axis in enumerate(AXES):
        matrix, far = _looking(axis, place), distance + radius
        one = light.copy()
        one["face"] = face
        found.append(
            LightCamera(
                light=one,
                splats=None if bounds.splats is None else _face(matrix, far, SPLAT_PIXELS // 2),
                surfaces=None if bounds.surfaces is None else _face(matrix, far, resolution),
            )
        )
    return tuple(found)


def _one(
    light: npt.NDArray[Any],
    matrix: F64,
    bounds: CasterBounds,
    resolution: int,
    *,
    is_parallel: bool,
) -> LightCamera:
    """Return a camera that sees everything."""
    found = [
        None if box is None else _fitted(matrix, box, pixels, is_parallel=is_parallel)
        for box, pixels in ((bounds.splats, SPLAT_PIXELS), (bounds.surfaces, resolution))
    ]
    return LightCamera(light=light, splats=found[0], surfaces=found[1])


def _corners(box: Box) -> F64:
    """Return the corners of a box, shape (8, 3)."""
    low, high = box
    pick = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), axis=-1).reshape(-1, 3)
    return np.where(pick == 1, high, low).astype(np.float64)


def _looking(axis: F64, place: F64) -> F64:
    """Return world-to-camera of an eye at `place` that looks along a unit axis, shape (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = frame_about(axis).T
    matrix[:3, 3] = -matrix[:3, :3] @ place
    return matrix


def _fitted(matrix: F64, box: Box, resolution: int, *, is_parallel: bool) -> Screen:
    """Return a screen that shows a box."""
    seen = _corners(box) @ matrix[:3, :3].T + matrix[:3, 3]
    plane = seen[:, :2] if is_parallel else seen[:, :2] / seen[:, 2:]
    low, high = plane.min(axis=0), plane.max(axis=0)
    pixel = max(float((high - low).max()) / resolution, 1e-30)
    size = np.maximum(1, np.ceil((high - low) / pixel - 1e-6)).astype(int)
    middle = 0.5 * (low + high)
    far = float(np.linalg.norm(seen, axis=1).max())
    return Screen(
        world_to_camera=matrix,
        orthographic=is_parallel,
        focal=(1.0 / pixel, 1.0 / pixel),
        center=(
            float(0.5 * (size[0] - 1) - middle[0] / pixel),
            float(0.5 * (size[1] - 1) - middle[1] / pixel),
        ),
        size=(int(size[0]), int(size[1])),
        window=(0, 0, int(size[0]), int(size[1])),
        clipping_range=(0.0 if is_parallel else NEAREST * far, math.inf),
        low_pass=LOW_PASS,
    )


def _face(matrix: F64, far: float, resolution: int) -> Screen:
    """Return the screen of one face of the cube around a point."""
    return Screen(
        world_to_camera=matrix,
        orthographic=False,
        focal=(0.5 * resolution, 0.5 * resolution),
        center=(0.5 * (resolution - 1), 0.5 * (resolution - 1)),
        size=(resolution, resolution),
        window=(0, 0, resolution, resolution),
        clipping_range=(NEAREST * far, math.inf),
        low_pass=LOW_PASS,
    )
