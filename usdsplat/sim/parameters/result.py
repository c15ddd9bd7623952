"""What is drawn of a simulation, and what is written."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from usdsplat.core.knobs import knob

INF = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class AppearanceParameters:
    """How shapes and colours follow."""

    covariance: Literal["full", "rigid", "volume"] = knob(
        "full",
        "what splats do where space is deformed: take all of it, only turn, or keep their volume",
    )
    max_stretch: float = knob(
        3.0, "largest factor by which a deformation may stretch a splat", range=(1.0, 100.0)
    )
    keep_opacity: bool = knob(
        False, "whether splats become thinner where a surface is stretched, so that it stays as "
        "opaque"
    )  # fmt: skip
    sh_min_angle: float = knob(
        1.0, "smallest turn of a splat that turns its harmonics too", unit="deg",
        range=(0.0, 180.0),
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class DriverParameters:
    """One driver, SplatDriverAPI:<name>: what the simulation knows drives what one sees."""

    source: Literal["u", "v", "vMinusU", "crowding", "age", "speed", "distance"] = knob(
        "v",
        "what drives: the pattern, neighbours over their target, age [s], speed [unit/s], or "
        "distance from where the splat was captured [unit]",
        uniform=True,
    )
    in_min: float = knob(0.0, "value of the source where it begins", range=(-INF, INF))
    in_max: float = knob(1.0, "value of the source where it is complete", range=(-INF, INF))
    ease: Literal["linear", "smooth", "smoother"] = knob(
        "smooth", "shape of the ramp in between", uniform=True
    )
    output: Literal["scale", "thickness", "opacity", "color", "displacement"] = knob(
        "scale",
        "what is driven: size, size along the normal, opacity, colour, or place along the normal",
        uniform=True,
    )
    amount: float = knob(
        1.0,
        "where it is complete: a factor of scale, thickness and opacity, the mixture with color, "
        "or the displacement [unit]",
        range=(-INF, INF),
    )
    color: tuple[float, float, float] = knob(
        (1.0, 1.0, 1.0),
        "of output color: what is mixed in, in the field's colour space",
        usd_type="color3f",
    )
    sh_fade: float = knob(
        1.0, "of output color: how much of the view-dependent colour goes", range=(0.0, 1.0)
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class BakeParameters:
    """The layer of results."""

    mode: Literal["dense", "clips", "edit", "packed"] = knob(
        "dense",
        "dense has all splats at each frame, clips the same in a file for every clip_frames "
        "frames, edit only those that moved (USD 26 and later), packed our compact type",
        uniform=True,
    )
    clip_frames: int = knob(
        24, "frames of a clip; counts change only between them", range=(1, 10000), uniform=True
    )
    checkpoint_every: int = knob(
        24,
        "frames between the checkpoints that a bake can be resumed from",
        range=(1, 10000),
        uniform=True,
    )
    velocities: bool = knob(True, "whether velocities are written", uniform=True)
    pattern: bool = knob(False, "whether u and v are written as primvars", uniform=True)
    rate_sh: int = knob(
        -1, "frames between samples of the harmonics; negative is one for each turn by 5 degrees",
        unit="frame", range=(-1, 10000), uniform=True,
    )  # fmt: skip
    position_epsilon: float = knob(
        1e-4, "of edit: motion that is written, in mean spacings", range=(0.0, INF), uniform=True
    )
    rotation_epsilon: float = knob(
        0.2, "of edit: turn that is written", unit="deg", range=(0.0, 180.0), uniform=True
    )
    scale_epsilon: float = knob(
        0.002, "of edit: relative change of a size that is written", range=(0.0, INF), uniform=True
    )
    opacity_epsilon: float = knob(
        1 / 512, "of edit: change of opacity that is written", range=(0.0, 1.0), uniform=True
    )
