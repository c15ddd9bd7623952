"""The preset conform: splats move onto meshes, by default onto a ring around them that turns."""

from __future__ import annotations

import numpy as np
from pxr import Gf, Usd

from usdsplat.core.errors import StageError
from usdsplat.sim.stage.authoring import author, relate
from usdsplat.sim.stage.presets.preset import Choice, Preset, PresetOption
from usdsplat.sim.stage.presets.scene import FIRST, Scene, as_guide, author_goal
from usdsplat.sim.stage.torus import author_torus
from usdsplat.sim.stage.trees import is_simulated

TRANSPORT = {
    "carriers:count": 14000,
    "conform:weight": 1.0,
    "conform:start": 0.4,
    "conform:duration": 1.8,
    "conform:stagger": 0.6,
    "conform:order": "height",
    "conform:arc": 0.1,
    "settle:omega": 30.0,
}
"""Values of the presets that transport splats, which arrive before the last frame. All are on their
way together for most of the time: one shape becomes another, and little of it is torn."""


def _author(scene: Scene, sim: Usd.Prim, choice: Choice) -> None:
    if choice.goal is None:
        target = _ring(scene)
    else:
        target = author_goal(scene, choice.goal)
        if is_simulated(target):
            found = choice.goal.GetRootLayer().identifier
            raise StageError(found, "a capture", "meshes; preset morph takes a capture")
    author(sim, TRANSPORT)
    relate(sim, "conform:target", target)


def _ring(scene: Scene) -> Usd.Prim:
    """Author a ring around the capture that turns."""
    level = np.delete(scene.extent, scene.up)
    outer = 0.5 * float(np.hypot(*level)) + 0.1 * scene.size
    ring = author_torus(
        scene.stage,
        scene.parent.AppendChild("Ring"),
        radius=outer,
        tube=0.15 * outer,
        axis="XYZ"[scene.up],
    )
    as_guide(ring.GetPrim())
    ring.AddTranslateOp().Set(Gf.Vec3d(*scene.center.tolist()))
    turn = ring.AddRotateYOp() if scene.up == 1 else ring.AddRotateZOp()
    for frame, angle in ((FIRST, 0.0), (scene.last, 60.0)):
        turn.Set(angle, frame)
    return ring.GetPrim()


CONFORM = Preset(
    name="conform",
    text="splats move onto meshes, by default onto a ring around them",
    author=_author,
    option=PresetOption(name="target", text="meshes to move onto"),
)
