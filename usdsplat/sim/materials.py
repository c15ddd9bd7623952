"""Materials: the knobs of matter by name."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

from usdsplat.sim.parameters import MatterParameters

KEPT = ("enabled", "material", "roots", "ground")
"""Knobs that a material leaves as they are."""
MATERIALS: dict[str, dict[str, Any]] = {
    # bends out of the way as whole leaves and stems, and stands up again
    "foliage": {"stiffness": 24.0, "back": 5.0, "stretch": 1.25, "press": 0.75, "iterations": 10},
    # does not stretch, folds freely, hangs
    "cloth": {
        "stiffness": 4.0, "back": 0.0, "damping": 1.5, "stretch": 1.04, "press": 0.3,
        "gravity": 1.0, "hang": True, "iterations": 10,
    },
    # hard to bend, jumps back
    "rubber": {
        "stiffness": 90.0, "back": 9.0, "damping": 0.6, "stretch": 1.5, "press": 0.6,
        "iterations": 5,
    },
    # soft, wobbles for a while
    "jelly": {"stiffness": 45.0, "back": 1.5, "damping": 0.5, "stretch": 1.6, "press": 0.5},
    # stays as it is pushed
    "clay": {
        "stiffness": 60.0, "back": 0.0, "damping": 12.0, "stretch": 1.6, "press": 0.4,
        "plasticity": 0.98, "yielding": 0.02, "iterations": 4,
    },
    # falls apart into grains
    "sand": {
        "stiffness": 0.0, "back": 0.0, "damping": 0.2, "stretch": 10.0, "press": 0.0,
        "tear": 1.01, "gravity": 1.0, "grain": 1.0,
    },
    # breaks into rigid pieces
    "stone": {
        "stiffness": 1000.0, "back": 0.0, "damping": 0.05, "stretch": 1.02, "press": 0.98,
        "tear": 1.05, "gravity": 1.0, "grain": 8.0, "iterations": 4,
    },
}  # fmt: skip
"""Material -> knobs that differ from the defaults."""


def breaks(knobs: MatterParameters) -> bool:
    """Return whether matter with these resolved knobs breaks into pieces larger than grains."""
    return knobs.enabled and knobs.grain > 1


def resolved(parameters: MatterParameters) -> MatterParameters:
    """Return the knobs of the material; the parameters themselves if it is custom."""
    if parameters.material == "custom":
        return parameters
    own = {f.name: getattr(parameters, f.name) for f in fields(parameters) if f.name in KEPT}
    return replace(MatterParameters(), **own, **MATERIALS[parameters.material])
