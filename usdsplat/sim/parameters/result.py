"""Parameters of the appearance of a simulation, and of its bake."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from usdsplat.core.knobs import knob

INF = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class AppearanceParameters:
    """How shapes and colours of splats follow a deformation."""

    covariance: Literal["full", "rigid", "volume"] = knob(
        "full",
        "how splats follow a deformation: rotate and stretch (full), only rotate (rigid), or keep "
        "their volume (volume)",
    )
    max_stretch: float = knob(
        3.0,
        "largest factor by which a deformation may stretch a splat",
        range=(1.0, 100.0),
        takes_mask=True,
    )
    keep_opacity: bool = knob(
        False,
        "whether opacity is adapted where a surface is stretched, so that the surface stays "
        "equally opaque"
    )  # fmt: skip
    sh_min_angle: float = knob(
        1.0, "smallest rotation of a splat that rotates its harmonics", unit="deg",
        range=(0.0, 180.0),
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class DriverParameters:
    """One driver, SplatDriverAPI:<name>: controls an output by a value of the simulation."""

    source: Literal["u", "v", "vMinusU", "crowding", "age", "speed", "distance"] = knob(
        "v",
        "input: the pattern, neighbours over their target, age [s], speed [unit/s], or distance "
        "from the captured position [unit]",
        uniform=True,
    )
    in_min: float = knob(0.0, "source value at which the effect starts", range=(-INF, INF))
    in_max: float = knob(1.0, "source value at which the effect is complete", range=(-INF, INF))
    ease: Literal["linear", "smooth", "smoother"] = knob(
        "smooth", "shape of the ramp between in_min and in_max", uniform=True
    )
    output: Literal["scale", "thickness", "opacity", "color", "displacement"] = knob(
        "scale",
        "output: size, size along the normal, opacity, colour, or position along the normal",
        uniform=True,
    )
    amount: float = knob(
        1.0,
        "complete effect: factor of scale, thickness and opacity, mixing weight of color, or "
        "displacement [unit]",
        range=(-INF, INF),
        takes_mask=True,
    )
    color: tuple[float, float, float] = knob(
        (1.0, 1.0, 1.0),
        "colour that output color mixes in, in the field's colour space",
        usd_type="color3f",
    )
    sh_fade: float = knob(
        1.0,
        "fraction of the view-dependent colour that output color removes",
        range=(0.0, 1.0),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class BakeParameters:
    """Contents of the layer of results."""

    mode: Literal["dense", "clips", "edit", "packed"] = knob(
        "dense",
        "dense writes all splats at each frame, clips the same in one file per clip_frames "
        "frames, edit only splats that moved (USD 26 and later), packed the compact type",
        uniform=True,
    )
    clip_frames: int = knob(
        24,
        "frames of a clip; the number of splats changes only between clips",
        range=(1, 10000),
        uniform=True,
    )
    checkpoint_every: int = knob(
        24,
        "frames between checkpoints from which a bake can be resumed",
        range=(1, 10000),
        uniform=True,
    )
    velocities: bool = knob(True, "whether velocities are written", uniform=True)
    pattern: bool = knob(False, "whether u and v are written as primvars", uniform=True)
    rate_sh: int = knob(
        -1, "frames between samples of the harmonics; negative is one per rotation by 5 degrees",
        unit="frame", range=(-1, 10000), uniform=True,
    )  # fmt: skip
    position_epsilon: float = knob(
        1e-4,
        "smallest motion that mode edit writes, in mean spacings",
        range=(0.0, INF),
        uniform=True,
    )
    rotation_epsilon: float = knob(
        0.2, "smallest rotation that mode edit writes", unit="deg", range=(0.0, 180.0), uniform=True
    )
    scale_epsilon: float = knob(
        0.002,
        "smallest relative change of size that mode edit writes",
        range=(0.0, INF),
        uniform=True,
    )
    opacity_epsilon: float = knob(
        1 / 512, "smallest change of opacity that mode edit writes", range=(0.0, 1.0), uniform=True
    )
