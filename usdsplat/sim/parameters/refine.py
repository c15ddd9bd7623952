"""Parameters of refinement: dividing large splats."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from usdsplat.core.knobs import knob

INF = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class RefineParameters:
    """Splats that are too large for what happens to them are divided into children."""

    enabled: Literal["auto", "on", "off"] = knob(
        "auto",
        "whether large splats are divided before the first frame; auto is on where there is a "
        "pattern, matter, conform or dissolve",
        uniform=True,
    )
    max_size: float = knob(
        -1.0,
        "largest standard deviation of a splat, in spacings; negative is automatic, 2",
        range=(-1.0, INF),
        uniform=True,
    )
    max_anisotropy: float = knob(
        INF,
        "largest ratio of a splat's longest axis to its middle one; splats shorter than a quarter "
        "of max_size may exceed it",
        range=(1.0, INF),
        uniform=True,
    )
    spacing: float = knob(
        -1.0,
        "spacing of what acts on splats; negative is the distance of the carriers, or what it "
        "would be for a pattern",
        unit="unit",
        range=(-1.0, INF),
        uniform=True,
    )
    min_opacity: float = knob(
        0.1,
        "opacity below which splats are not divided: faint ones lose what falls below 1/255",
        range=(1 / 255, 1.0),
        uniform=True,
    )
    budget: int = knob(
        -1,
        "largest number of splats after refinement, the largest are divided first; negative is "
        "four times as many as before, at most sim:max_count",
        range=(-1, 2**31 - 1),
        uniform=True,
    )
    stretch: float = knob(
        INF,
        "size, in multiples of max_size, from which a splat is divided while it moves; infinite "
        "keeps the number of splats",
        range=(1.0, INF),
        uniform=True,
    )
    merge: bool = knob(
        False,
        "whether the children of a splat that was divided while it moved become one again when all "
        "of them are back at rest",
        uniform=True,
    )
