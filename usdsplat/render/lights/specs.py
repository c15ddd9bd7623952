"""Frozen values that describe UsdLux lights to the render scene."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Vector = tuple[float, float, float]
Rules = tuple[tuple[str, bool], ...]
"""Pairs (path, is included), see `matte.is_matte`."""
LightKind = Literal["distant", "sphere", "disk", "rect", "cylinder", "dome"]

EVERYTHING: Rules = (("/", True),)


@dataclass(frozen=True, slots=True, kw_only=True)
class Shaping:
    """Directions into which a light radiates, as in UsdLuxShapingAPI."""

    focus: float = 0.0
    tint: Vector = (0.0, 0.0, 0.0)
    """Colour off the axis, where the focus takes light away."""
    angle: float = math.pi
    """Angle of the cone from the axis [rad]; π for no cone."""
    softness: float = 0.0
    """Fraction of the cone over which light falls off to its edge."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shadow:
    """Shadows of a light, as in UsdLuxShadowAPI."""

    enable: bool = True
    color: Vector = (0.0, 0.0, 0.0)
    """Light in the umbra, as a factor."""
    distance: float = -1.0
    """Longest distance of a shadow from its caster [scene unit]; negative for no limit."""
    falloff: float = 0.0
    """Length before `distance` along which shadows fade [scene unit]."""
    gamma: float = 1.0
    """Exponent of this fading."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Peak:
    """Bright spot of a sky, such as the sun."""

    direction: Vector
    """Unit vector to its middle, in the space of the dome."""
    irradiance: Vector
    """As `LightSpec.irradiance`, of a dome with radiance 1."""
    angle: float
    """Angle that it subtends [rad]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DomeSky:
    """Picture of a dome, see `dome.split`."""

    grid: bytes
    """Radiance without the peaks, linear Rec.709, latlong, shape (64, 128, 3) f32. Bytes are
    compared quickly."""
    peaks: tuple[Peak, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class LightSpec:
    """A light at one time."""

    kind: LightKind = "distant"
    direction: Vector = (0.0, 0.0, -1.0)
    """Unit vector in which a distant light travels, in the world."""
    irradiance: Vector = (0.0, 0.0, 0.0)
    """Light of a distant light that a white surface reflects which faces it, linear Rec.709: its
    irradiance divided by π."""
    angle: float = 0.0
    """Angle that a distant light subtends in the sky [rad]."""
    to_world: tuple[float, ...] = ()
    """Local to world, a `specs.Matrix`; of other lights than distant ones."""
    size: tuple[float, float] = (0.0, 0.0)
    """In local space: radius of a sphere or disk; width and height of a rect; radius and length of
    a cylinder, which lies along x. Disks and rects radiate along −z."""
    radiance: Vector = (0.0, 0.0, 0.0)
    """Radiance of such a light or dome, linear Rec.709; of one without an area its intensity times
    4, which is the limit of a normalized small sphere."""
    sky: DomeSky | None = None
    """Picture of a dome, by which its radiance is multiplied; None for other lights."""
    is_point: bool = False
    """Whether the light is taken for a point at its centre."""
    axis: Vector = (0.0, 0.0, -1.0)
    """Unit vector of the shaping, in the world."""
    shaping: Shaping = Shaping()
    shadow: Shadow = Shadow()
    group: str = "light_default"
    """AOV of its light group."""
    is_on: bool = True
    """Whether the light is visible; a hidden one may be that of photographs."""
    linked: Rules = EVERYTHING
    """Prims that the light illuminates."""
    casters: Rules = EVERYTHING
    """Prims that cast its shadows."""

    @property
    def is_plain(self) -> bool:
        """Whether the light is a distant one that illuminates everything: `kernels.shade` knows
        only these."""
        return self.kind == "distant" and self.linked == EVERYTHING and self.shaping == Shaping()
