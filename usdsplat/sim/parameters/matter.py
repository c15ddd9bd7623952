"""Parameters of carriers, and of the matter that they are."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from usdsplat.core.knobs import knob

INF = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class CarriersParameters:
    """Carriers: an even set of points on a field, on which patterns, matter and transport run."""

    spacing: float = knob(
        -1.0,
        "distance of neighbouring carriers; negative follows from rd:patternScale, or from count",
        unit="unit",
        range=(-1.0, INF),
        uniform=True,
    )
    count: int = knob(
        8000,
        "largest number of carriers if nothing gives their distance",
        range=(16, 250_000),
        uniform=True,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class MatterParameters:
    """Cohesion: splats move as matter with their carriers, instead of each on its own."""

    enabled: bool = knob(
        False, "whether splats hold together; settle:* then has no effect", uniform=True
    )
    material: Literal["custom", "foliage", "cloth", "rubber", "jelly", "clay", "sand", "stone"] = (
        knob(
            "custom",
            "a material by name, which replaces the knobs of this group except roots and ground",
            uniform=True,
        )
    )
    stiffness: float = knob(
        30.0, "how fast a neighbourhood takes on its shape; 0 keeps no shape", unit="1/s",
        range=(0.0, 1e4),
    )  # fmt: skip
    back: float = knob(
        6.0,
        "how fast matter returns to where it was captured, critically damped; 0 does not return",
        unit="1/s",
        range=(0.0, 100.0),
    )
    damping: float = knob(
        1.0, "rate at which motion relative to the pose dies", unit="1/s", range=(0.0, 100.0)
    )
    stretch: float = knob(1.2, "largest stretch of an edge between carriers", range=(1.0, 10.0))
    press: float = knob(0.7, "least length of such an edge, relative to rest", range=(0.0, 1.0))
    plasticity: float = knob(
        0.0,
        "part of a deformation beyond yield that stays after a second, 0 elastic, 1 nearly all",
        range=(0.0, 1.0),
    )
    yielding: float = knob(
        0.1, "deformation from which plastic matter flows, relative to lengths", range=(0.0, 1.0)
    )
    tear: float = knob(
        INF,
        "stretch at which an edge tears; below stretch, edges tear before they are held",
        range=(1.0, INF),
    )
    gravity: float = knob(0.0, "part of particles:gravity that acts on matter", range=(0.0, 10.0))
    roots: float = knob(
        0.04,
        "part of the height, from below, that stays on its pose; negative: nothing is held",
        range=(-1.0, 1.0),
        uniform=True,
    )
    hang: bool = knob(
        False, "whether roots are at the upper end, so that matter hangs", uniform=True
    )
    ground: bool = knob(False, "whether matter stays above the lowest captured point", uniform=True)
    friction: float = knob(0.5, "friction of the ground: 0 slides, 1 sticks", range=(0.0, 1.0))
    grain: float = knob(
        0.0,
        "size of pieces that stay rigid, in distances of carriers; 0: matter does not break up",
        range=(0.0, 1e4),
        uniform=True,
    )
    fill: bool = knob(
        True, "whether pieces that break off get a back and broken faces: new splats", uniform=True
    )
    iterations: int = knob(
        3, "passes over all constraints in a substep: more hold more exactly", range=(1, 64)
    )
