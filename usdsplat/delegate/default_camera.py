"""A camera for a scene that has none."""

from __future__ import annotations

import math

import numpy as np

from usdsplat.core.axes import UP_AXIS_FRAME, change
from usdsplat.core.cloud import F64
from usdsplat.delegate.specs import CameraSpec

FIELD_OF_VIEW = math.radians(45)
"""Of the shorter side of the picture."""
DIRECTION = (0.42, 0.3, 1.0)
"""From the scene towards the eye, x right, y up, z back: a front three-quarter view from above."""
MARGIN = 1.05
"""How much farther away than where the bounds just fit."""
NEAREST = 1e-3
"""Near plane as a part of the far plane, at least: float32 depths stay distinct."""


def frame_bounds(bounds: tuple[F64, F64] | None, *, up_axis: str, aspect: float) -> CameraSpec:
    """Return a perspective camera that sees all of `bounds`.

    Args:
        bounds: Lowest and highest corner in the world [scene unit], shape (3,) each; None for an
            empty scene, which is framed as a unit cube.
        up_axis: The stage's upAxis, "Y" or "Z".
        aspect: Width over height of the picture.
    """
    low, high = bounds or (np.full(3, -0.5), np.full(3, 0.5))
    center = 0.5 * (low + high)
    size = float(np.linalg.norm(high - low)) or 1.0
    axes = change(UP_AXIS_FRAME[up_axis], "rub")
    camera = _looking_along(-np.array(DIRECTION)) @ axes
    half = math.tan(0.5 * FIELD_OF_VIEW)
    right, top = half * max(aspect, 1.0), half * max(1.0 / aspect, 1.0)
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, 8).T - center
    x, y, z = (corners @ camera.T).T
    distance = MARGIN * float(np.max(np.maximum(np.abs(x) / right, np.abs(y) / top) + z))
    distance = max(distance, MARGIN * float(np.max(z)) + 1e-3 * size)
    far = 1.01 * (distance - float(np.min(z))) + 1e-3 * size
    near = max(0.5 * (distance - float(np.max(z))), NEAREST * far)
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3] = camera
    world_to_camera[:3, 3] = -camera @ center - (0.0, 0.0, distance)
    return CameraSpec(
        world_to_camera=tuple(world_to_camera.ravel().tolist()),
        window=(-right, -top, right, top),
        clipping_range=(near, far),
    )


def _looking_along(direction: F64) -> F64:
    """Rotation to a camera that looks that way with y up, rows right, up and back, shape (3, 3)."""
    back = -direction / np.linalg.norm(direction)
    right = np.cross((0.0, 1.0, 0.0), back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back])
