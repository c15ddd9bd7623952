"""A camera that nobody has authored: orbit, pan, dolly, fly, frame. Each move gives a new value.

Directions are the stage's; angles are radians; distances scene units. A drag is measured in parts
of the viewport's height, so that it feels the same in every size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from usdsplat.core.cloud import F64
from usdsplat.delegate.default_camera import Box
from usdsplat.render.framing import conform
from usdsplat.render.specs import CameraSpec, Framing

Vector = tuple[float, float, float]
UpAxis = Literal["Y", "Z"]

ORBIT = math.pi
"""What a drag over the viewport's height turns about the target [radian]."""
LOOK_AROUND = 2.0
"""What a drag over the viewport's height turns about the eye, in fields of view."""
POLE = 5e-7
"""How far from straight up or down every camera stays, so that it has a heading [radian]."""
MARGIN = 1.05
"""How much farther away than where a framed box just fits."""
NEAREST = 1e-3
"""The near plane inside of what is seen, a part of the way to the target."""
NEAREST_OF_FAR = 1e-4
"""And at most this part of the far plane, for targets that are far beyond everything."""
SHORTEST = 1e-6
"""How near a dolly gets, a part of the target's distance from the origin."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeCamera:
    """Looks from `eye` at `target`."""

    eye: Vector = (0.0, 0.0, 5.0)
    target: Vector = (0.0, 0.0, 0.0)
    """What an orbit turns about and a dolly goes to."""
    up_axis: UpAxis = "Y"
    field_of_view: float = 45.0
    """Of the shorter side [degree]; for an orthographic camera as it is at the target."""
    is_orthographic: bool = False
    roll: float = 0.0
    """Counter-clockwise turn of the camera about its axis [degree]."""
    exposure: float = 1.0
    """What linear light is multiplied by."""

    @property
    def distance(self) -> float:
        """From the eye to the target."""
        return math.dist(self.eye, self.target)

    @property
    def axes(self) -> F64:
        """Rows right, up and back in the world, unit lengths, shape (3, 3)."""
        axes = _level_axes(np.subtract(self.target, self.eye), self.up_axis)
        sine, cosine = math.sin(math.radians(self.roll)), math.cos(math.radians(self.roll))
        turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray(turn @ axes)

    def half_height(self, aspect: float) -> float:
        """Half of the viewport's height at distance 1 from the eye."""
        return math.tan(math.radians(0.5 * self.field_of_view)) * max(1.0 / aspect, 1.0)

    # --- moves -----------------------------------------------------------------------------

    def orbited(self, right: float, down: float) -> FreeCamera:
        """Turn about the target by a drag; never over the top."""
        forward = self._turned(-ORBIT * right, -ORBIT * down)
        return replace(self, eye=_vector(np.asarray(self.target) - self.distance * forward))

    def panned(self, right: float, down: float, *, aspect: float) -> FreeCamera:
        """Move with a drag, so that what lies at the target's depth stays under the pointer."""
        height = 2.0 * self.half_height(aspect) * self.distance
        return self.flown(-right * height, down * height, 0.0)

    def dollied(self, factor: float) -> FreeCamera:
        """Multiply the distance from the target."""
        shortest = max(SHORTEST * math.hypot(*self.target), 1e-9)
        distance = min(max(factor * self.distance, shortest), 1e12)
        back = self.axes[2]
        return replace(self, eye=_vector(np.asarray(self.target) + distance * back))

    def looked_around(self, right: float, down: float) -> FreeCamera:
        """Turn about the eye by a drag; never over the top."""
        rate = LOOK_AROUND * math.radians(self.field_of_view)
        forward = self._turned(-rate * right, -rate * down)
        return replace(self, target=_vector(np.asarray(self.eye) + self.distance * forward))

    def flown(self, right: float, up: float, forward: float) -> FreeCamera:
        """Move eye and target alike [scene unit]."""
        shift = np.array((right, up, -forward)) @ self.axes
        return replace(
            self, eye=_vector(self.eye + shift), target=_vector(np.asarray(self.target) + shift)
        )

    def aimed(self, target: Vector) -> FreeCamera:
        """Have something in the middle, from the same direction and as far away."""
        return self.flown(*(self.axes @ np.subtract(target, self.target) * (1.0, 1.0, -1.0)))

    def framing(self, box: Box, *, aspect: float) -> FreeCamera:
        """Look at all of a box from the same direction, level; at a point from as far away."""
        level = replace(self, roll=0.0)
        center = 0.5 * (box[0] + box[1])
        top = level.half_height(aspect)
        x, y, z = ((_corners(box) - center) @ level.axes.T).T
        across = np.maximum(abs(x) / (top * aspect), abs(y) / top)
        distance = MARGIN * float(np.max(across if self.is_orthographic else across + z))
        distance = distance if distance > 0 else self.distance
        eye = center + distance * level.axes[2]
        return replace(level, eye=_vector(eye), target=_vector(center))

    def towards(self, other: FreeCamera, part: float) -> FreeCamera:
        """On the way to one that looks in the same direction: 0 is here and 1 is there."""
        if not 0.0 < part < 1.0:
            return other if part >= 1.0 else self
        mix = replace(other, roll=self.roll + part * math.remainder(other.roll - self.roll, 360.0))
        distance = self.distance * (other.distance / self.distance) ** part
        target = np.asarray(self.target) + part * np.subtract(other.target, self.target)
        return replace(mix, target=_vector(target), eye=_vector(target + distance * mix.axes[2]))

    # --- to and from what renders ----------------------------------------------------------

    def spec(self, *, aspect: float, bounds: Box | None) -> CameraSpec:
        """What renders; clipping holds all of `bounds` that is before the eye.

        An eye within them sees from `NEAREST` on; an orthographic camera steps back until all of
        them are before it.
        """
        axes, eye = self.axes, np.asarray(self.eye, np.float64)
        depths = None if bounds is None else (eye - _corners(bounds)) @ axes[2]
        top = self.half_height(aspect)
        if self.is_orthographic:
            top *= self.distance
            if depths is not None:
                back = max(1e-3 * float(np.ptp(depths)) - float(depths.min()), 0.0)
                eye, depths = eye + back * axes[2], depths + back
        matrix = np.eye(4)
        matrix[:3, :3] = axes
        matrix[:3, 3] = -axes @ eye
        return CameraSpec(
            world_to_camera=tuple(matrix.ravel().tolist()),
            orthographic=self.is_orthographic,
            window=(-top * aspect, -top, top * aspect, top),
            clipping_range=self._clipping_range(depths),
            exposure=self.exposure,
        )

    @classmethod
    def like(
        cls, spec: CameraSpec, *, target: Vector, up_axis: UpAxis, aspect: float
    ) -> FreeCamera:
        """One that sees what a camera of a stage sees in a viewport of that aspect.

        It turns about the point of its axis that is as deep as `target`. What is lost: the blur of
        lens and shutter, and the shift of a perspective lens: the camera then looks at what was in
        the middle of the picture.
        """
        framing = Framing(resolution=(1, 1), pixel_aspect_ratio=aspect)
        (left, bottom, right, top), _ = conform(spec.window, framing)
        to_camera = np.reshape(spec.world_to_camera, (4, 4))
        rotation = to_camera[:3, :3]
        eye = -rotation.T @ to_camera[:3, 3]
        shift = np.array((0.5 * (left + right), 0.5 * (bottom + top), 0.0))
        half = 0.5 * min(right - left, top - bottom)
        back = rotation[2]
        if spec.orthographic:
            eye = eye + shift @ rotation
        elif shift.any():
            back = (np.array((0.0, 0.0, 1.0)) - shift) @ rotation
            half /= float(np.linalg.norm(back))
            back = back / np.linalg.norm(back)
        depth = float((eye - target) @ back)
        if depth <= 0.0:
            depth = math.sqrt(max(spec.clipping_range[0], 1e-6) * max(spec.clipping_range[1], 1e-6))
        forward, roll = _steep(-back, rotation[1], up_axis)
        return cls(
            eye=_vector(eye),
            target=_vector(eye + depth * forward),
            up_axis=up_axis,
            field_of_view=math.degrees(2.0 * math.atan(half / (depth if spec.orthographic else 1))),
            is_orthographic=spec.orthographic,
            roll=roll,
            exposure=spec.exposure,
        )

    # --- private ---------------------------------------------------------------------------

    def _turned(self, left: float, up: float) -> F64:
        """Forward, after turns about the stage's up axis and upwards, unit length."""
        level = _level_axes(np.subtract(self.target, self.eye), self.up_axis)
        top = _up(self.up_axis)
        elevation = math.asin(max(-1.0, min(1.0, float(-level[2] @ top))))
        steepest = 0.5 * math.pi - POLE
        elevation = max(-steepest, min(steepest, elevation + up))
        side = level[0]
        ahead = np.cross(top, side)
        heading = math.cos(left) * ahead - math.sin(left) * side
        return np.asarray(math.cos(elevation) * heading + math.sin(elevation) * top)

    def _clipping_range(self, depths: F64 | None) -> tuple[float, float]:
        distance = max(self.distance, 1e-9)
        if depths is None:
            return NEAREST * distance, distance / NEAREST
        far = 1.01 * max(float(depths.max()), 2.0 * distance)
        nearest = 0.5 * float(depths.min())
        return nearest if nearest > 0 else min(NEAREST * distance, NEAREST_OF_FAR * far), far


class Glide:
    """The way of a camera, slow at both ends; its clock starts when it is first asked."""

    def __init__(self, here: FreeCamera, there: FreeCamera, seconds: float) -> None:
        self.here, self.there, self.seconds = here, there, seconds
        self.began: float | None = None

    def at(self, now: float) -> tuple[FreeCamera, bool]:
        """Where it is, and whether that is the end."""
        if self.began is None:
            self.began = now
        part = min((now - self.began) / self.seconds, 1.0)
        eased = part * part * (3.0 - 2.0 * part)
        return self.here.towards(self.there, eased), part >= 1.0


def _up(up_axis: str) -> F64:
    return np.array((0.0, 1.0, 0.0) if up_axis == "Y" else (0.0, 0.0, 1.0))


def _level_axes(forward: F64, up_axis: str) -> F64:
    """Rows right, up, back of a camera without roll; one that looks along up has x at its right."""
    length = np.linalg.norm(forward)
    up = _up(up_axis)
    back = -forward / length if length > 0 else np.cross(up, (-1.0, 0.0, 0.0))
    right = np.cross(up, back)
    size = np.linalg.norm(right)
    right = right / size if size > 1e-12 else np.array((1.0, 0.0, 0.0))
    return np.stack([right, np.cross(back, right), back])


def _steep(forward: F64, up: F64, up_axis: str) -> tuple[F64, float]:
    """Where a camera looks and its roll [degree]; one that looks straight up or down rolls not.

    A heading is what it has instead: such a camera is tilted by less than can be seen.
    """
    top = _up(up_axis)
    if math.hypot(*np.cross(forward, top)) < POLE:
        pole = math.copysign(1.0, float(forward @ top))
        return np.asarray(pole * (top - POLE * up)), 0.0
    right, level_up, _ = _level_axes(forward, up_axis)
    return forward, math.degrees(math.atan2(-float(up @ right), float(up @ level_up)))


def _vector(array: F64) -> Vector:
    x, y, z = (float(value) for value in array)
    return x, y, z


def _corners(box: Box) -> F64:
    """The eight corners of a box, shape (8, 3)."""
    return np.array(np.meshgrid(*zip(*box, strict=True))).reshape(3, 8).T
