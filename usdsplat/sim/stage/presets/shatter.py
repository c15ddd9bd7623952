"""The preset shatter: a ball hits the capture, which breaks and falls."""

from __future__ import annotations

from pxr import Usd

from usdsplat.kernels.devices import open_device
from usdsplat.sim.carriers import expected_spacing
from usdsplat.sim.stage.authoring import author
from usdsplat.sim.stage.presets.matter import material_option, matter
from usdsplat.sim.stage.presets.preset import Choice, Preset
from usdsplat.sim.stage.presets.scene import FIRST, Scene, author_ball

_THROUGH = 0.3
"""Part of the time in which the ball passes."""
_CARRIERS = 72
"""Most carriers along a capture: a piece of stone has 8."""
_FINER = 0.5
"""Least distance of carriers, relative to that of splats: the filling must be no finer."""


def _author(scene: Scene, sim: Usd.Prim, choice: Choice) -> None:
    assert choice.name is not None  # the option has a default
    author(sim, matter(scene, choice.name))
    splats = expected_spacing(open_device("cpu"), scene.cloud, most=scene.count)
    spacing = max(scene.local(scene.size / _CARRIERS), _FINER * splats)
    author(sim, {"carriers:spacing": spacing})
    through = max(round(_THROUGH * scene.last), 2)
    ball = author_ball(scene, radius=0.12 * scene.size, frames=(FIRST, through), friction=0.1)
    # the pieces fall where it has passed
    author(ball, {"affector:enabled": True}, time=FIRST)
    author(ball, {"affector:enabled": False}, time=through + 1)


SHATTER = Preset(
    name="shatter",
    text="a ball hits the capture, which breaks and falls",
    author=_author,
    option=material_option("stone"),
)
