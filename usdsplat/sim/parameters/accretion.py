"""Parameters of accretion: new matter on a field, where the pattern is high."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from usdsplat.core.knobs import knob

INF = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class AccretionParameters:
    """New matter: discs in layers over the carriers, raised by the pattern."""

    enabled: bool = knob(False, "whether new matter grows where the pattern is high", uniform=True)
    style: Literal["custom", "cells", "coral", "veins", "moss", "crystals", "lichen"] = knob(
        "custom",
        "a look by name, which replaces rd:preset and the knobs of this group except enabled, "
        "light and maxLayers",
        uniform=True,
    )
    motif: Literal["pattern", "cells", "veins", "plates", "needles", "corals"] = knob(
        "pattern",
        "what shapes new matter behind the front: the pattern itself, packed cells, branching "
        "tubes, lobed plates, groups of needles, or colonies of branching fingers on a crust; all "
        "but the first ignore low, high and profile where a front spreads",
        uniform=True,
    )
    motif_size: float = knob(
        10.0,
        "distance of cells, ends of veins, plates, needles or fingers, in distances of carriers",
        range=(2.0, 1000.0), uniform=True,
    )  # fmt: skip
    low: float = knob(0.08, "v at which matter begins to rise", range=(0.0, 1.0))
    high: float = knob(0.28, "v at which it is raised fully", range=(0.0, 1.0))
    relief: float = knob(
        3.5,
        "height of fully raised matter, or length of the longest needle or finger, in "
        "distances of carriers",
        range=(0.0, 100.0),
    )
    profile: Literal["dome", "ridge", "plate", "thorn"] = knob(
        "dome", "shape of a rise: round, sharp, flat on top, or a point"
    )
    layers: int = knob(
        4, "discs over each carrier, from the top downwards", range=(1, 16), uniform=True
    )
    size: float = knob(
        0.62, "standard deviation of a disc along the surface, in distances of carriers",
        range=(0.01, 10.0),
    )  # fmt: skip
    thickness: float = knob(
        0.22, "standard deviation along the normal, in distances of carriers", range=(0.01, 50.0)
    )
    opacity: float = knob(0.93, "opacity of a disc", range=(0.0, 0.999))
    jitter: float = knob(
        0.35, "random shift of discs along the surface, in distances of carriers",
        range=(0.0, 10.0),
    )  # fmt: skip
    tilt: float = knob(10.0, "random angle of discs to the surface", unit="deg", range=(0.0, 90.0))
    variation: float = knob(
        0.25, "random differences of size and brightness between discs", range=(0.0, 1.0)
    )
    upward: float = knob(
        0.0, "how far matter avoids surfaces that face down: 0 grows everywhere, 1 on top only",
        range=(0.0, 1.0), uniform=True,
    )  # fmt: skip
    ramp_by: Literal["v", "height", "age", "curvature"] = knob(
        "v",
        "what the colour follows: the pattern or the motif, the height, the time since birth over "
        "rampTime, or how far a disc stands out from its surroundings",
    )
    ramp_time: float = knob(3.0, "age at the end of the ramp", unit="s", range=(1e-6, INF))
    ramp: tuple[tuple[float, float, float], ...] = knob(
        ((0.16, 0.02, 0.03), (0.55, 0.08, 0.07), (0.95, 0.45, 0.33)),
        "colours of the ramp, evenly spaced, in the field's colour space",
        usd_type="color3f[]",
    )
    tints: tuple[tuple[float, float, float], ...] = knob(
        (),
        "colours of which one is drawn for each cell, plate, needle or colony, and multiplies the "
        "ramp's; without any, all have the ramp's",
        usd_type="color3f[]",
    )
    shade: float = knob(
        0.75, "part of the brightness that depends on the direction to light", range=(0.0, 1.0)
    )
    gloss: float = knob(
        0.0, "strength of highlights where new matter faces the light", range=(0.0, 4.0)
    )
    light: tuple[float, float, float] = knob(
        (0.35, 0.8, 0.5),
        "direction to the light that shades new matter: right, up and front of the field as it "
        "stands on the stage",
        usd_type="vector3f",
        uniform=True,
    )
    occlusion: float = knob(0.8, "how dark new matter is in its valleys", range=(0.0, 1.0))
    rise: float = knob(
        0.6, "time in which new matter appears and takes its height", unit="s", range=(0.0, INF)
    )
