"""The preset conform: splats move onto a mesh, by default a ring around them that turns."""

from __future__ import annotations

import os

import numpy as np
from pxr import Gf, Usd, UsdGeom

from usdsplat.core.errors import StageError
from usdsplat.core.readable import check_referable
from usdsplat.schema.stage_values import world_bound
from usdsplat.sim.stage.authoring import author, relate
from usdsplat.sim.stage.presets.preset import Preset, PresetOption
from usdsplat.sim.stage.presets.scene import FIRST, Scene, as_guide
from usdsplat.sim.stage.torus import author_torus


def _author(scene: Scene, sim: Usd.Prim, target: str | None) -> None:
    mesh = _ring(scene) if target is None else _fitted(scene, target)
    author(
        sim,
        {
            "conform:weight": 1.0,
            "conform:start": 0.5,
            "conform:duration": 2.0,
            "conform:stagger": 1.0,
            "conform:order": "distance",
            "conform:mode": "closest",
            "conform:orient": 1.0,
            "conform:scaleMode": "preserve",
            "conform:keepThickness": 0.0,
            "settle:omega": 12.0,
        },
    )
    relate(sim, "conform:target", mesh)


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


def _fitted(scene: Scene, file: str) -> Usd.Prim:
    """Refer to the stage in a file, as large as the capture and at its place; return its mesh.

    Raises:
        StageError: If it has no default prim, or not exactly one mesh.
    """
    check_referable(file)
    path = os.path.realpath(file)
    stage = Usd.Stage.Open(path)
    if not stage.GetDefaultPrim():
        raise StageError(file, "a stage without a default prim", "one with a default prim")
    box = world_bound(
        stage.GetPseudoRoot(),
        UsdGeom.BBoxCache(Usd.TimeCode(FIRST), [UsdGeom.Tokens.default_, UsdGeom.Tokens.render]),
    ).ComputeAlignedRange()
    if box.IsEmpty():
        raise StageError(file, "a stage without bounds", "a mesh")
    larger = scene.size / max(*box.GetSize(), 1e-30)
    root = UsdGeom.Xform.Define(scene.stage, scene.parent.AppendChild("Target"))
    as_guide(root.GetPrim())
    middle = Gf.Vec3d(*scene.center.tolist()) - larger * box.GetMidpoint()
    root.AddTranslateOp().Set(middle)
    root.AddScaleOp().Set(Gf.Vec3f(larger))
    inner = scene.stage.DefinePrim(root.GetPath().AppendChild("Stage"))
    inner.GetReferences().AddReference(path)
    meshes = [prim for prim in Usd.PrimRange(inner) if prim.IsA(UsdGeom.Mesh)]
    if len(meshes) != 1:
        raise StageError(file, f"{len(meshes)} meshes", "one to conform to")
    return meshes[0]


CONFORM = Preset(
    name="conform",
    text="splats move onto a mesh, by default a ring around them",
    author=_author,
    option=PresetOption(name="target", text="stage with the mesh that splats move onto"),
)
