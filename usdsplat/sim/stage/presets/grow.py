"""The preset grow: new matter grows over the capture from some seeds, and a ball passes slowly."""

from __future__ import annotations

import numpy as np
from pxr import Usd

from usdsplat.sim.stage.authoring import author
from usdsplat.sim.stage.presets.preset import Choice, Preset, PresetOption
from usdsplat.sim.stage.presets.scene import FIRST, RATE, Scene, author_ball
from usdsplat.sim.styles import STYLES

_CARRIERS = 150
"""Carriers along a capture: branches have about 10. The number of carriers, and the time of a
frame, grow with its square."""
_REACTION_STEPS = 16_000
"""Reaction steps in all, so that the pattern forms while its front spreads; a frame has 256 at
most."""
_SPREADING = 0.6
"""Part of the time in which the front would spread along the whole capture from one end."""

_SEEDS, _FEWEST_SEEDS = 12, 3
"""Seeds on so many carriers, and fewest on fewer: a seed takes the same number of carriers."""


def _author(scene: Scene, sim: Usd.Prim, choice: Choice) -> None:
    # distance of splats that are spread evenly over a surface of about three times size^2
    spacing = scene.size * np.sqrt(3 / scene.count)
    unit = max(scene.size / _CARRIERS, spacing)
    seconds = scene.last / RATE
    author(
        sim,
        {
            "carriers:spacing": scene.local(unit),
            "rd:enabled": True,
            "rd:substeps": min(round(_REACTION_STEPS / scene.last), 256),
            "rd:frontSpeed": scene.size / unit / (_SPREADING * seconds),
            "rd:seeds": max(round(_SEEDS * (scene.size / unit / _CARRIERS) ** 2), _FEWEST_SEEDS),
            "accretion:enabled": True,
            "accretion:style": choice.name,
            "settle:omega": 6.0,
        },
    )
    author_ball(scene, radius=0.12 * scene.size, frames=(FIRST, scene.last), friction=0.1)


GROW = Preset(
    name="grow",
    text="new matter grows over the capture, and a ball passes slowly",
    author=_author,
    option=PresetOption(
        name="style", text="look of the new matter", choices=tuple(STYLES), default="coral"
    ),
)
