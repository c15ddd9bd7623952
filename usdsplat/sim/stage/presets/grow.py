"""The preset grow: a pattern colours, raises and multiplies splats, and a ball passes slowly."""

from __future__ import annotations

import numpy as np
from pxr import Usd

from usdsplat.sim.stage.authoring import author
from usdsplat.sim.stage.presets.preset import Preset, PresetOption
from usdsplat.sim.stage.presets.scene import FIRST, Scene, author_ball

_PATTERN = 110
"""Lattice units along a capture: about nine stripes. The number of carriers, and the time of a
frame, grow with its square."""
_REACTION_STEPS = 6000
"""Reaction steps until the last frame, when the pattern has formed; a frame has 256 at most."""


def _author(scene: Scene, sim: Usd.Prim, style: str | None) -> None:
    # distance of splats that are spread evenly over a surface of about three times size^2
    spacing = scene.size * np.sqrt(3 / scene.count)
    unit = max(scene.size / _PATTERN, spacing)
    author(
        sim,
        {
            "rd:enabled": True,
            "rd:preset": style,
            "rd:substeps": min(round(_REACTION_STEPS / scene.last), 256),
            "rd:patternScale": scene.local(unit),
            "growth:rate": scene.local(0.002 * scene.size),
            "growth:birthRate": 0.15,
            "settle:omega": 6.0,
            "driver:colour:source": "v",
            "driver:colour:inMin": 0.1,
            "driver:colour:inMax": 0.35,
            "driver:colour:output": "color",
            "driver:colour:amount": 0.85,
            "driver:colour:color": (0.95, 0.35, 0.1),
            "driver:relief:source": "v",
            "driver:relief:inMin": 0.1,
            "driver:relief:inMax": 0.35,
            "driver:relief:output": "displacement",
            "driver:relief:amount": scene.local(0.8 * unit),
            "driver:swell:source": "v",
            "driver:swell:inMin": 0.1,
            "driver:swell:inMax": 0.35,
            "driver:swell:output": "scale",
            "driver:swell:amount": 1.15,
        },
    )
    author_ball(scene, radius=0.12 * scene.size, frames=(FIRST, scene.last), friction=0.1)


GROW = Preset(
    name="grow",
    text="a pattern colours, raises and multiplies splats, and a ball passes slowly",
    author=_author,
    option=PresetOption(
        name="style",
        text="shape of the pattern",
        choices=("labyrinth", "spots", "worms", "coral", "holes"),
        default="labyrinth",
    ),
)
