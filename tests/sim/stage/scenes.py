"""Stages in files that use many features at once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from tests.sim.recipes import ball
from tests.sim.stage.stages import FIELD, SIM, place, simulation_of
from usdsplat import schema
from usdsplat.sim.stage.authoring import author

LIVELY = {
    "sim:substeps": 2,
    "rd:enabled": True, "rd:preset": "coral", "rd:seedDensity": 0.05, "rd:substeps": 12,
    "growth:rate": 0.1, "growth:birthRate": 6.0, "growth:vMin": 0.05, "growth:vMax": 0.2,
    "growth:life": 0.3, "growth:deathFade": 0.1, "growth:birthFade": 0.1,
    "growth:crowdMax": 2.0,
    "dissolve:enabled": True, "dissolve:by": "random", "dissolve:start": 0.3,
    "dissolve:duration": 2.0, "dissolve:speed": 0.5,
    "particles:gravity": (0.0, -1.0, 0.0), "particles:turbulence": 0.2,
    "deform:bow:type": "bend", "deform:bow:angle": 30.0, "deform:bow:length": 2.0,
    "deform:whirl:type": "curl", "deform:whirl:amount": 0.05,
    "driver:glow:source": "v", "driver:glow:output": "color", "driver:glow:inMax": 0.3,
    "bake:clipFrames": 5, "bake:checkpointEvery": 3,
}  # fmt: skip


def save_shot(folder: Path, values: dict[str, Any], count: int = 400, rate: float = 24.0) -> Path:
    """A stage with a ball of splats, a simulation, and a capsule that swings through it."""
    folder.mkdir(parents=True, exist_ok=True)
    stage = Usd.Stage.CreateNew(str(folder / "shot.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    stage.SetTimeCodesPerSecond(rate)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    schema.author(stage, FIELD, ball(count))
    stage.DefinePrim(SIM, "SplatSim")
    author(simulation_of(stage), values)
    add_capsule(stage, "/World/Stick")
    stage.Save()
    return folder / "shot.usda"


def add_capsule(stage: Usd.Stage, path: str, **given: Any) -> Usd.Prim:
    """A capsule that collides, with a place for each frame from 1 to 40."""
    capsule = UsdGeom.Capsule.Define(stage, path)
    capsule.CreateRadiusAttr(0.3)
    capsule.CreateHeightAttr(1.0)
    prim = capsule.GetPrim()
    author(prim, {f"affector:{name}": value for name, value in {"friction": 0.5, **given}.items()})
    for time in range(1, 41):
        matrix = np.eye(4)
        matrix[:3, 3] = 1.2 * np.cos(time / 4), 0.3 * np.sin(time / 3), 0.9
        place(prim, matrix, time)
    return prim
