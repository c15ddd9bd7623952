"""The parameters of each group that most people turn; panels show the others on demand.

They say what happens, where and how much of it. The others are accuracy, limits, randomness and
corrections.
"""

from __future__ import annotations

from collections.abc import Mapping

MAIN: Mapping[str, tuple[str, ...]] = {
    "sim": ("enabled", "substeps", "start_time", "end_time", "max_count"),
    "neighbors": (),
    "refine": ("enabled", "max_size", "budget"),
    "carriers": ("spacing", "count"),
    "rd": (
        "enabled",
        "preset",
        "feed",
        "kill",
        "pattern_scale",
        "seed_mode",
        "seeds",
    ),
    "relax": ("iterations", "strength"),
    "growth": ("rate", "birth_rate", "life"),
    "accretion": ("enabled", "style", "motif", "relief", "size", "layers", "opacity", "ramp"),
    "settle": ("omega", "delay"),
    "matter": (
        "enabled",
        "stiffness",
        "damping",
        "plasticity",
        "tear",
        "gravity",
        "ground",
    ),
    "conform": ("weight", "start", "duration", "mode", "path", "arc"),
    "skin": ("weight", "method"),
    "particles": ("enabled", "gravity", "wind", "turbulence", "drag"),
    "dissolve": ("enabled", "mode", "by", "start", "duration", "speed", "size"),
    "appearance": ("covariance", "max_stretch"),
    "bake": ("mode", "velocities"),
    "affector": ("enabled", "role", "amount", "falloff", "friction", "clearance"),
    "deform": ("type", "weight", "axis", "angle", "amount", "size", "speed", "translate", "rotate"),
    "driver": ("source", "in_min", "in_max", "output", "amount", "color"),
    "mask": ("source", "primvar", "axis", "file", "size", "radius", "in_min", "in_max", "invert"),
}
"""Parameter group -> names of its knobs."""
