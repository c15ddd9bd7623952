"""The preset push: a ball passes through the capture, which settles behind it."""

from __future__ import annotations

from pxr import Usd

from usdsplat.sim.stage.authoring import author
from usdsplat.sim.stage.presets.matter import material_option, matter
from usdsplat.sim.stage.presets.preset import Choice, Preset
from usdsplat.sim.stage.presets.scene import FIRST, Scene, author_ball


def _author(scene: Scene, sim: Usd.Prim, choice: Choice) -> None:
    if choice.name is None:
        author(sim, {"settle:omega": 5.0, "settle:delay": 0.1, "appearance:covariance": "full"})
    else:
        author(sim, matter(scene, choice.name))
    through = max(round(0.6 * scene.last), 2)
    ball = author_ball(scene, radius=0.18 * scene.size, frames=(FIRST, through), friction=0.1)
    # where it stops it is disabled, so that splats in front of it can return to their places
    author(ball, {"affector:enabled": True}, time=FIRST)
    author(ball, {"affector:enabled": False}, time=through + 1)


PUSH = Preset(
    name="push", text="a ball passes through", author=_author, option=material_option(None)
)
