"""A camera for a scene that has none."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from usdsplat.core.axes import UP_AXIS_FRAME, change
from usdsplat.core.cloud import F64
from usdsplat.render.specs import CameraSpec

FIELD_OF_VIEW = math.radians(45)
"""Of the shorter side of the picture."""
DIRECTION = (0.42, 0.3, 1.0)
"""From the scene towards the eye, x right, y up, z back: a front three-quarter view from above."""
MARGIN = 1.05
"""How much farther away than where the subject just fits."""
NEAREST = 1e-3
"""The near plane is at least this part of the way to the subject."""

Box = tuple[F64, F64]


def frame_subject(
    subject: Box | None, bounds: Box | None, *, up_axis: str, aspect: float
) -> CameraSpec:
    """Return a perspective camera that has all of `subject` in the picture.

    Args:
        subject: What to look at: lowest and highest corner in the world [scene unit], shape (3,)
            each; None for an empty scene, which is framed as a unit cube.
        bounds: Of everything, for the clipping range.
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
    """The box around boxes; None if there is none."""
    found = [box for box in boxes if box is not None]
    if not found:
        return None
    lows, highs = zip(*found, strict=True)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def _corners(box: Box) -> F64:
    """The eight corners of a box, shape (8, 3)."""
    return np.array(np.meshgrid(*zip(*box, strict=True))).reshape(3, 8).T


def _looking_along(direction: F64) -> F64:
    """Rotation to a camera that looks that way with y up, rows right, up and back, shape (3, 3)."""
    back = -direction / np.linalg.norm(direction)
    right = np.cross((0.0, 1.0, 0.0), back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back])
