"""The preset grow: new matter grows over the capture from some seeds."""

from __future__ import annotations

import math

from pxr import Usd

from usdsplat.kernels.devices import open_device
from usdsplat.sim.carriers import expected_spacing
from usdsplat.sim.stage.authoring import author
from usdsplat.sim.stage.presets.preset import Choice, Preset, PresetOption
from usdsplat.sim.stage.presets.scene import RATE, Scene
from usdsplat.sim.styles import STYLES

_CARRIERS = 150
"""Most carriers along a capture: branches have about 10. The number of carriers, and the time of a
frame, grow with its square."""
_FEW, _PER_SPLAT = 20_000, 5
"""A capture of fewer splats has so many carriers for each, up to about this number: new matter is
finer than the splats that it grows on. Others have about as many carriers as splats at most."""
_REACTION_STEPS = 16_000
"""Reaction steps in all on the most carriers, so that the pattern forms while its front spreads; a
frame has 256 at most. A pattern spreads a number of carriers in a step, so fewer need fewer."""
_SPREADING = 0.6
"""Part of the time in which the front would spread along the whole capture from one end."""

_SEEDS, _FEWEST_SEEDS = 12, 3
"""Seeds on so many carriers, and fewest on fewer: a seed takes the same number of carriers."""


def _author(scene: Scene, sim: Usd.Prim, choice: Choice) -> None:
    spacing = expected_spacing(open_device("cpu"), scene.cloud, most=scene.count)
    most = max(scene.count, min(_FEW, _PER_SPLAT * scene.count))
    spacing *= math.sqrt(scene.count / most)
    unit = max(scene.size / _CARRIERS, spacing * scene.field_unit)
    along = scene.size / unit
    seconds = scene.last / RATE
    assert choice.name is not None  # the option has a default
    needs_pattern = STYLES[choice.name].knobs.get("motif", "pattern") == "pattern"
    steps = _REACTION_STEPS * along / _CARRIERS if needs_pattern else 0
    author(
        sim,
        {
            "carriers:spacing": scene.local(unit),
            "rd:enabled": True,
            "rd:substeps": min(round(steps / scene.last), 256) or 1,
            "rd:frontSpeed": along / (_SPREADING * seconds),
            "rd:seeds": max(round(_SEEDS * (along / _CARRIERS) ** 2), _FEWEST_SEEDS),
            "accretion:enabled": True,
            "accretion:style": choice.name,
        },
    )


GROW = Preset(
    name="grow",
    text="new matter grows over the capture",
    author=_author,
    option=PresetOption(
        name="style", text="look of the new matter", choices=tuple(STYLES), default="coral"
    ),
)
