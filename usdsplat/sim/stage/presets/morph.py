"""The preset morph: splats become another capture."""

from __future__ import annotations

from pxr import Usd

from usdsplat.core.errors import StageError
from usdsplat.sim.stage.authoring import author, relate
from usdsplat.sim.stage.presets.conform import TRANSPORT
from usdsplat.sim.stage.presets.preset import Choice, Preset, PresetOption
from usdsplat.sim.stage.presets.scene import Scene, author_goal
from usdsplat.sim.stage.trees import is_simulated


def _author(scene: Scene, sim: Usd.Prim, choice: Choice) -> None:
    assert choice.goal is not None  # the option is required
    target = author_goal(scene, choice.goal)
    if not is_simulated(target):
        found = choice.goal.GetRootLayer().identifier
        raise StageError(found, "meshes", "a capture; preset conform takes meshes")
    author(sim, TRANSPORT)
    relate(sim, "conform:target", target)


MORPH = Preset(
    name="morph",
    text="splats become another capture",
    author=_author,
    option=PresetOption(name="target", text="a capture to become", is_required=True),
)
