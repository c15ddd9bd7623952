"""A camera that nobody has authored: orbit, pan, dolly, fly, frame. Each move gives a new value.

Directions are the stage's; angles are radians; distances scene units. A drag is measured in parts
of the viewport's height, so that it feels the same in every size.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from usdsplat.delegate.default_camera import Box
from usdsplat.delegate.specs import CameraSpec

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeCamera:
    """Looks from `eye` at `target`."""

    eye: Vector = (0.0, 0.0, 5.0)
    target: Vector = (0.0, 0.0, 0.0)
    """What an orbit turns about and a dolly goes to."""
    up_axis: Literal["Y", "Z"] = "Y"
    field_of_view: float = 45.0
    """Of the shorter side [degree]."""
    is_orthographic: bool = False

    def orbited(self, right: float, down: float) -> FreeCamera:
        """Turn about the target by a drag; never over the top."""
        raise NotImplementedError

    def panned(self, right: float, down: float) -> FreeCamera:
        """Move with a drag, so that what lies at the target stays under the pointer."""
        raise NotImplementedError

    def dollied(self, factor: float) -> FreeCamera:
        """Multiply the distance from the target."""
        raise NotImplementedError

    def looked_around(self, right: float, down: float) -> FreeCamera:
        """Turn about the eye by a drag."""
        raise NotImplementedError

    def flown(self, right: float, up: float, forward: float) -> FreeCamera:
        """Move eye and target alike [scene unit]."""
        raise NotImplementedError

    def framing(self, box: Box, *, aspect: float) -> FreeCamera:
        """Look at all of a box from the same direction."""
        raise NotImplementedError

    def spec(self, *, aspect: float, bounds: Box | None) -> CameraSpec:
        """What renders; clipping holds all of `bounds` that is before the eye."""
        raise NotImplementedError

    @classmethod
    def like(cls, spec: CameraSpec, *, target: Vector, up_axis: Literal["Y", "Z"]) -> FreeCamera:
        """One that sees what a camera of a stage sees, without its roll."""
        raise NotImplementedError
