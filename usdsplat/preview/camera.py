"""A free camera: orbit, pan, dolly, fly, frame. Each move returns a new value.

Directions are the stage's; angles are radians; distances scene units. A drag is measured as a
fraction of the viewport's height, so that it works the same at every size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from usdsplat.core.cloud import F64
from usdsplat.render.fields import Box
from usdsplat.render.framing import conform
from usdsplat.render.specs import CameraSpec, Framing
from usdsplat.render.subject import Subject, corners

Vector = tuple[float, float, float]
UpAxis = Literal["Y", "Z"]
Side = Literal["front", "right", "top"]
_Z_UP = np.array([[1.0], [1.0], [-1.0]])
"""Signs of right, up and back of the front view of a stage with z up, whose front is −y."""

ORBIT = math.pi
"""Rotation about the target by a drag over the viewport's height [radian]."""
LOOK_AROUND = 2.0
"""Rotation about the eye by a drag over the viewport's height, in fields of view."""
POLE = 5e-7
"""Minimum angle to the up axis, so that a heading exists [radian]."""
NEAREST = 1e-3
"""Near plane inside the visible scene, as a fraction of the distance to the target."""
NEAREST_OF_FAR = 1e-4
"""Minimum near plane as a fraction of the far plane, for very distant targets."""
SHORTEST = 1e-6
"""Minimum distance of a dolly, as a fraction of the target's distance from the origin."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeCamera:
    """A camera at `eye` that looks at `target`."""

    eye: Vector = (0.0, 0.0, 5.0)
    target: Vector = (0.0, 0.0, 0.0)
    """Centre of orbits and target of dollies."""
    up_axis: UpAxis = "Y"
    field_of_view: float = 45.0
    """Field of view of the shorter side [degree]; for an orthographic camera as at the target."""
    is_orthographic: bool = False
    roll: float = 0.0
    """Counter-clockwise rotation of the camera about its axis [degree]."""
    exposure: float = 1.0
    """Factor on linear light."""

    @property
    def distance(self) -> float:
        """Distance from the eye to the target."""
        return math.dist(self.eye, self.target)

    @property
    def axes(self) -> F64:
        """Unit vectors right, up and back in the world, as rows, shape (3, 3)."""
        axes = _level_axes(np.subtract(self.target, self.eye), self.up_axis)
        sine, cosine = math.sin(math.radians(self.roll)), math.cos(math.radians(self.roll))
        turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray(turn @ axes)

    def half_height(self, aspect: float) -> float:
        """Return half of the viewport's height at distance 1 from the eye."""
        return math.tan(math.radians(0.5 * self.field_of_view)) * max(1.0 / aspect, 1.0)

    # --- moves -----------------------------------------------------------------------------

    def orbited(self, right: float, down: float) -> FreeCamera:
        """Return the camera rotated about the target by a drag, never past the poles."""
        forward = self._turned(-ORBIT * right, -ORBIT * down)
        return replace(self, eye=_vector(np.asarray(self.target) - self.distance * forward))

    def panned(self, right: float, down: float, *, aspect: float) -> FreeCamera:
        """Return the camera moved by a drag; points at the target's depth follow the pointer."""
        height = 2.0 * self.half_height(aspect) * self.distance
        return self.flown(-right * height, down * height, 0.0)

    def dollied(self, factor: float) -> FreeCamera:
        """Return the camera with its distance from the target multiplied."""
        shortest = max(SHORTEST * math.hypot(*self.target), 1e-9)
        distance = min(max(factor * self.distance, shortest), 1e12)
        back = self.axes[2]
        return replace(self, eye=_vector(np.asarray(self.target) + distance * back))

    def facing(self, side: Side) -> FreeCamera:
        """Return a level camera that sees the target from a side, at the same distance."""
        right, up, back = np.eye(3) if self.up_axis == "Y" else np.eye(3)[[0, 2, 1]] * _Z_UP
        out = {"front": back, "right": right, "top": up}[side]
        forward, roll = _steep(-out, -back if side == "top" else up, self.up_axis)
        eye = np.asarray(self.target) - self.distance * forward
        return replace(self, eye=_vector(eye), roll=roll)

    def looked_around(self, right: float, down: float) -> FreeCamera:
        """Return the camera rotated about the eye by a drag, never past the poles."""
        rate = LOOK_AROUND * math.radians(self.field_of_view)
        forward = self._turned(-rate * right, -rate * down)
        return replace(self, target=_vector(np.asarray(self.eye) + self.distance * forward))

    def flown(self, right: float, up: float, forward: float) -> FreeCamera:
        """Return the camera with eye and target moved by the same vector [scene unit]."""
        shift = np.array((right, up, -forward)) @ self.axes
        return replace(
            self, eye=_vector(self.eye + shift), target=_vector(np.asarray(self.target) + shift)
        )

    def aimed(self, target: Vector) -> FreeCamera:
        """Return the camera centred on a point, from the same direction and distance."""
        return self.flown(*(self.axes @ np.subtract(target, self.target) * (1.0, 1.0, -1.0)))

    def framing(self, subject: Subject, *, aspect: float) -> FreeCamera:
        """Return a level camera that frames a subject from the same direction; a point keeps the
        distance."""
        level = replace(self, roll=0.0)
        top = level.half_height(aspect)
        center, distance = subject.frame(
            level.axes, (top * aspect, top), is_orthographic=self.is_orthographic
        )
        distance = distance if distance > 0 else self.distance
        eye = center + distance * level.axes[2]
        return replace(level, eye=_vector(eye), target=_vector(center))

    def towards(self, other: FreeCamera, part: float) -> FreeCamera:
        """Interpolate to a camera with the same view direction: 0 is this one and 1 the other."""
        if not 0.0 < part < 1.0:
            return other if part >= 1.0 else self
        mix = replace(other, roll=self.roll + part * math.remainder(other.roll - self.roll, 360.0))
        distance = self.distance * (other.distance / self.distance) ** part
        target = np.asarray(self.target) + part * np.subtract(other.target, self.target)
        return replace(mix, target=_vector(target), eye=_vector(target + distance * mix.axes[2]))

    # --- to and from what renders ----------------------------------------------------------

    def spec(self, *, aspect: float, bounds: Box | None) -> CameraSpec:
        """Return the render camera; its clipping range holds all of `bounds` in front of the eye.

        For an eye within the bounds, the near plane is `NEAREST`; an orthographic camera moves back
        until all of them are in front of it.
        """
        axes, eye = self.axes, np.asarray(self.eye, np.float64)
        depths = None if bounds is None else (eye - corners(bounds)) @ axes[2]
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
        """Return a free camera with the view of a stage's camera in a viewport of `aspect`.

        Its target is the point of its axis at the depth of `target`. Lens and shutter blur are
        lost. The shift of a perspective lens is lost too: the camera points at the centre of the
        shifted picture.
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
        """Return the forward unit vector after rotations about the stage's up axis and upwards."""
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
    """An animated camera move with easing; its clock starts at the first call."""

    def __init__(self, here: FreeCamera, there: FreeCamera, seconds: float) -> None:
        self.here, self.there, self.seconds = here, there, seconds
        self.began: float | None = None

    def at(self, now: float) -> tuple[FreeCamera, bool]:
        """Return the camera at a time, and whether the move has ended."""
        if self.began is None:
            self.began = now
        part = min((now - self.began) / self.seconds, 1.0)
        eased = part * part * (3.0 - 2.0 * part)
        return self.here.towards(self.there, eased), part >= 1.0


def _up(up_axis: str) -> F64:
    return np.array((0.0, 1.0, 0.0) if up_axis == "Y" else (0.0, 0.0, 1.0))


def _level_axes(forward: F64, up_axis: str) -> F64:
    """Return rows right, up, back of a camera without roll; one that looks along up has x right."""
    length = np.linalg.norm(forward)
    up = _up(up_axis)
    back = -forward / length if length > 0 else np.cross(up, (-1.0, 0.0, 0.0))
    right = np.cross(up, back)
    size = np.linalg.norm(right)
    right = right / size if size > 1e-12 else np.array((1.0, 0.0, 0.0))
    return np.stack([right, np.cross(back, right), back])


def _steep(forward: F64, up: F64, up_axis: str) -> tuple[F64, float]:
    """Return direction and roll [degree] of a camera.

    If it looks straight up or down, the roll is 0 and the direction is tilted by `POLE`, which is
    invisible, so that the camera has a heading.
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


def middle_of(subject: Subject | None, spec: CameraSpec) -> Vector:
    """Return the middle of a subject as a camera sees it; the origin without one."""
    if subject is None:
        return 0.0, 0.0, 0.0
    middle, _ = subject.extent(np.reshape(spec.world_to_camera, (4, 4))[:3, :3])
    x, y, z = map(float, middle)
    return x, y, z
