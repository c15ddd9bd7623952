"""Create a default camera for a scene."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from usdsplat.core.axes import UP_AXIS_FRAME, change
from usdsplat.core.cloud import F64
from usdsplat.render.fields import Box
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import CameraSpec
from usdsplat.render.subject import Subject, corners, joined, of_box

FIELD_OF_VIEW = math.radians(45)
"""Field of view of the shorter side of the picture [radian]."""
DIRECTION = (0.42, 0.3, 1.0)
"""Direction from the scene to the eye, x right, y up, z back: front three-quarter, from above."""
Seen = tuple[Subject | None, Box | None]
"""What is seen of a scene, and its bounds; None where nothing is."""
NEAREST = 1e-3
"""Minimum distance of the near plane, as a fraction of the distance to the subject."""


def frame_subject(
    subject: Subject | None, bounds: Box | None, *, up_axis: str, aspect: float
) -> CameraSpec:
    """Return a perspective camera that frames a subject, see `Subject.frame`.

    Args:
        subject: The subject; None for an empty scene, which is framed as a unit cube.
        bounds: Bounding box of the whole scene, for the clipping range; None for an empty one.
        up_axis: The stage's upAxis, "Y" or "Z".
        aspect: Width over height of the picture.
    """
    cube = np.full(3, -0.5), np.full(3, 0.5)
    subject = of_box(cube) if subject is None else subject
    rotation = _looking_along(-np.array(DIRECTION)) @ change(UP_AXIS_FRAME[up_axis], "rub")
    half = math.tan(0.5 * FIELD_OF_VIEW)
    right, top = half * max(aspect, 1.0), half * max(1.0 / aspect, 1.0)
    center, distance = subject.frame(rotation, (right, top))
    distance = distance or 1.0
    depths = distance - ((corners(bounds or cube) - center) @ rotation.T)[:, 2]
    far = 1.01 * max(float(depths.max()), distance) + NEAREST * distance
    near = max(0.5 * float(depths.min()), NEAREST * distance)
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3] = rotation
    world_to_camera[:3, 3] = -rotation @ center - (0.0, 0.0, distance)
    return CameraSpec(
        world_to_camera=tuple(world_to_camera.ravel().tolist()),
        window=(-right, -top, right, top),
        clipping_range=(near, far),
    )


def seen_of(scene: RenderScene) -> Seen:
    """Return what is seen of a scene, and its bounds."""
    return scene.seen(), scene.bounds()


def frame_all(views: Iterable[Seen], *, up_axis: str, aspect: float) -> CameraSpec:
    """Return a camera that frames what is seen at any of several times, see `frame_subject`."""
    subjects, bounds = zip(*views, strict=True) if (views := list(views)) else ((), ())
    return frame_subject(joined(subjects), union(bounds), up_axis=up_axis, aspect=aspect)


def union(boxes: Iterable[Box | None]) -> Box | None:
    """Return the bounding box of boxes; None if there is none."""
    found = [box for box in boxes if box is not None]
    if not found:
        return None
    lows, highs = zip(*found, strict=True)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def _looking_along(direction: F64) -> F64:
    """Return the rotation to a camera with this view direction, y up, (3, 3): rows right, up,
    back."""
    back = -direction / np.linalg.norm(direction)
    right = np.cross((0.0, 1.0, 0.0), back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back])
