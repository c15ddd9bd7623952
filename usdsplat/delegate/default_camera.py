"""Create a default camera for a scene."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from usdsplat.core.axes import UP_AXIS_FRAME, change
from usdsplat.core.cloud import F64
from usdsplat.render.specs import CameraSpec

FIELD_OF_VIEW = math.radians(45)
"""Field of view of the shorter side of the picture [radian]."""
DIRECTION = (0.42, 0.3, 1.0)
"""Direction from the scene to the eye, x right, y up, z back: front three-quarter, from above."""
MARGIN = 1.05
"""Factor on the distance at which the subject just fits."""
NEAREST = 1e-3
"""Minimum distance of the near plane, as a fraction of the distance to the subject."""

Box = tuple[F64, F64]


def frame_subject(
    subject: Box | None, bounds: Box | None, *, up_axis: str, aspect: float
) -> CameraSpec:
    """Return a perspective camera that frames all of `subject`.

    Args:
        subject: Lower and upper corner of the subject in the world [scene unit], shape (3,) each;
            None for an empty scene, which is framed as a unit cube.
        bounds: Bounding box of the whole scene, for the clipping range.
        up_axis: The stage's upAxis, "Y" or "Z".
        aspect: Width over height of the picture.
    """
    subject = subject or (np.full(3, -0.5), np.full(3, 0.5))
    center = 0.5 * (subject[0] + subject[1])
    size = float(np.linalg.norm(subject[1] - subject[0])) or 1.0
    rotation = _looking_along(-np.array(DIRECTION)) @ change(UP_AXIS_FRAME[up_axis], "rub")
    half = math.tan(0.5 * FIELD_OF_VIEW)
    right, top = half * max(aspect, 1.0), half * max(1.0 / aspect, 1.0)
    x, y, z = ((_corners(subject) - center) @ rotation.T).T
    distance = MARGIN * float(np.max(np.maximum(abs(x) / right, abs(y) / top) + z))
    distance = max(distance, size)
    depths = distance - ((_corners(bounds or subject) - center) @ rotation.T)[:, 2]
    far = 1.01 * max(float(depths.max()), distance) + 1e-3 * size
    near = max(0.5 * float(depths.min()), NEAREST * distance)
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3] = rotation
    world_to_camera[:3, 3] = -rotation @ center - (0.0, 0.0, distance)
    return CameraSpec(
        world_to_camera=tuple(world_to_camera.ravel().tolist()),
        window=(-right, -top, right, top),
        clipping_range=(near, far),
    )


def union(boxes: Iterable[Box | None]) -> Box | None:
    """Return the bounding box of boxes; None if there is none."""
    found = [box for box in boxes if box is not None]
    if not found:
        return None
    lows, highs = zip(*found, strict=True)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def _corners(box: Box) -> F64:
    """Return the eight corners of a box, shape (8, 3)."""
    return np.array(np.meshgrid(*zip(*box, strict=True))).reshape(3, 8).T


def _looking_along(direction: F64) -> F64:
    """Return the rotation to a camera with this view direction, y up, (3, 3): rows right, up,
    back."""
    back = -direction / np.linalg.norm(direction)
    right = np.cross((0.0, 1.0, 0.0), back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back])
