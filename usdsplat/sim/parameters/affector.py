"""SplatAffectorAPI: how a Sphere, Capsule, Cube, Plane, Mesh or Skeleton acts on splats."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from usdsplat.core.knobs import knob

INF = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class AffectorParameters:
    """One affector."""

    enabled: bool = knob(True, "whether it does anything")
    role: Literal["collide", "seed", "mask", "wind", "feed", "growth", "opacity"] = knob(
        "collide",
        "collide pushes splats out; the others act by amount inside and up to falloff outside: "
        "seed begins the pattern, mask lets only splats that it reaches grow, have children and be "
        "pushed, wind blows splats that fly along its local z axis, feed adds to the reaction's "
        "feed rate, growth and opacity multiply",
        uniform=True,
    )
    amount: float = knob(
        1.0,
        "of a role other than collide: factor of growth and opacity, speed of wind [unit/s], what "
        "is added to the feed rate, strength of seed and mask",
        range=(-INF, INF),
    )
    falloff: float = knob(
        0.0, "distance from the surface at which a role other than collide has faded out",
        unit="unit", range=(0.0, INF),
    )  # fmt: skip
    radius_scale: float = knob(1.0, "by which the shape is larger", range=(1e-6, 1e6))
    clearance: float = knob(
        0.5, "distance that is kept, in standard deviations of the splat at rest along its longest "
        "axis, of which no more than three medians of the field count", unit="sigma",
        range=(0.0, 3.0),
    )  # fmt: skip
    friction: float = knob(0.2, "0 slides, 1 sticks", range=(0.0, 1.0))
    blend: float = knob(
        0.05, "distance over which it flows into the affectors before it, by path; 0 is a seam",
        unit="unit", range=(0.0, INF),
    )  # fmt: skip
    restitution: float = knob(0.0, "how much of the speed splats bounce off with", range=(0.0, 1.0))
    ccd: bool = knob(
        True, "continuous collision: whether it sweeps up splats that it passes between two steps"
    )
    joints: tuple[str, ...] = knob(
        (),
        "of a Skeleton: joints that have a capsule, by name or path; none named is all",
        usd_type="token[]",
        uniform=True,
    )
    joint_radius: float = knob(
        -1.0,
        "of a Skeleton's capsules; negative is the median distance of the skinned points from the "
        "bone",
        unit="unit",
        range=(-1.0, INF),
    )
    voxel_size: float = knob(
        -1.0, "of a Mesh's distance field; negative is a 64th of its size", unit="unit",
        range=(-1.0, INF), uniform=True,
    )  # fmt: skip
