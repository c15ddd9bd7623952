"""SplatAffectorAPI: the effect of a Sphere, Capsule, Cube, Plane, Mesh or Skeleton on splats."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from usdsplat.core.knobs import knob

INF = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class AffectorParameters:
    """One affector."""

    enabled: bool = knob(True, "whether the affector is active")
    role: Literal["collide", "seed", "mask", "wind", "feed", "growth", "opacity", "region"] = knob(
        "collide",
        "collide pushes splats out; the others act with amount inside and fade over falloff "
        "outside: seed starts the pattern, mask limits growth, births and collisions to the "
        "splats inside, wind moves flying splats along the local z axis, feed adds to the "
        "reaction's feed rate, growth multiplies growth rates, opacity multiplies opacities; "
        "region acts only through the masks that name it",
        uniform=True,
    )
    amount: float = knob(
        1.0,
        "strength of a role other than collide: factor of growth and opacity, speed of wind "
        "[unit/s], offset of the feed rate, strength of seed and mask",
        range=(-INF, INF),
        takes_mask=True,
    )
    falloff: float = knob(
        0.0, "distance from the surface at which a role other than collide ends",
        unit="unit", range=(0.0, INF),
    )  # fmt: skip
    radius_scale: float = knob(1.0, "factor by which the shape is enlarged", range=(1e-6, 1e6))
    clearance: float = knob(
        0.5,
        "distance kept from splats, in standard deviations of the splat at rest along its longest "
        "axis, or in three times their median over the field if this is smaller", unit="sigma",
        range=(0.0, 3.0),
    )  # fmt: skip
    friction: float = knob(0.2, "friction: 0 slides, 1 sticks", range=(0.0, 1.0))
    blend: float = knob(
        0.05,
        "distance over which the shape blends into the affectors before it, by path; 0 leaves a "
        "seam",
        unit="unit", range=(0.0, INF),
    )  # fmt: skip
    restitution: float = knob(
        0.0, "fraction of the speed with which splats bounce off", range=(0.0, 1.0)
    )
    ccd: bool = knob(
        True,
        "continuous collision: whether splats that the shape passes between two steps are pushed "
        "along",
    )
    joints: tuple[str, ...] = knob(
        (),
        "joints of a Skeleton that get a capsule, by name or path; empty is all",
        usd_type="token[]",
        uniform=True,
    )
    joint_radius: float = knob(
        -1.0,
        "radius of a Skeleton's capsules; negative is the median distance of the skinned points "
        "from the bone",
        unit="unit",
        range=(-1.0, INF),
    )
    voxel_size: float = knob(
        -1.0,
        "voxel size of a Mesh's distance field; negative is a 64th of the mesh's size", unit="unit",
        range=(-1.0, INF), uniform=True,
    )  # fmt: skip
