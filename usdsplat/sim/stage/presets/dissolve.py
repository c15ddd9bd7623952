"""The preset dissolve: patches detach and are blown away."""

from __future__ import annotations

from pxr import Usd

from usdsplat.sim.stage.authoring import author
from usdsplat.sim.stage.presets.preset import Choice, Preset
from usdsplat.sim.stage.presets.scene import Scene


def _author(scene: Scene, sim: Usd.Prim, choice: Choice) -> None:
    author(
        sim,
        {
            "dissolve:enabled": True,
            "dissolve:by": "noise",
            "dissolve:size": scene.local(0.15 * scene.size),
            "dissolve:start": 0.25,
            "dissolve:duration": 2.5,
            "dissolve:speed": scene.local(0.15 * scene.size),
            "dissolve:spread": 40.0,
            "dissolve:fade": 1.0,
            "dissolve:shrink": 0.8,
            "particles:wind": scene.world(0.6 * scene.size, 0.15 * scene.size, 0.0),
            "particles:turbulence": scene.local(0.3 * scene.size),
            "particles:turbulenceScale": scene.local(0.3 * scene.size),
            "particles:turbulenceSpeed": 0.5,
            "particles:drag": 1.5,
        },
    )


DISSOLVE = Preset(name="dissolve", text="splats are blown away", author=_author)
