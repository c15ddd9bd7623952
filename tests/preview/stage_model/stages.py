"""Small stages to inspect and to edit."""

from __future__ import annotations

import math

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

from tests.delegate.stages import add_camera, random_cloud
from usdsplat import schema
from usdsplat.sim.stage.authoring import author


def rich() -> Usd.Stage:
    """Splats, a camera, a class, an over, an instance, variants, a simulation and an affector."""
    stage = Usd.Stage.CreateInMemory()
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    Usd.ModelAPI(world.GetPrim()).SetKind("assembly")
    schema.author(stage, "/World/Cloud", random_cloud(1, n=20, degree=2))
    ball = UsdGeom.Sphere.Define(stage, "/World/Ball")
    ball.AddTranslateOp().Set(Gf.Vec3d(1, 2, 3))
    author(ball.GetPrim(), {"affector:friction": 0.5})
    simulation = stage.DefinePrim("/World/Sim", "SplatSim")
    author(simulation, {"rd:enabled": True, "deform:bend:angle": 90.0})
    add_camera(stage, "/World/Camera")
    part = UsdGeom.Xform.Define(stage, "/World/Part")
    sets = part.GetPrim().GetVariantSets().AddVariantSet("season")
    for name in ("summer", "autumn"):
        sets.AddVariant(name)
    sets.SetVariantSelection("summer")
    stage.CreateClassPrim("/_class")
    UsdGeom.Cube.Define(stage, "/_class/Cube")
    instance = stage.DefinePrim("/World/Instance", "Xform")
    instance.GetReferences().AddInternalReference("/_class")
    instance.SetInstanceable(True)
    stage.OverridePrim("/World/Over")
    guide = UsdGeom.Scope.Define(stage, "/World/Guides")
    guide.CreatePurposeAttr("guide")
    UsdGeom.Cube.Define(stage, "/World/Guides/Cube")
    return stage


def spinning() -> Usd.Stage:
    """A ball that moves and turns over ten frames, below a scaled and moving group."""
    stage = Usd.Stage.CreateInMemory()
    group = UsdGeom.Xform.Define(stage, "/Group")
    group.AddScaleOp().Set(Gf.Vec3f(2.0))
    move = group.AddTranslateOp(opSuffix="move")
    ball = UsdGeom.Sphere.Define(stage, "/Group/Ball")
    place, turn = ball.AddTranslateOp(), ball.AddRotateXYZOp()
    for time in (1, 10):
        move.Set(Gf.Vec3d(0.1 * time, 0, 0), time)
        place.Set(Gf.Vec3d(0, time, 0), time)
        turn.Set(Gf.Vec3f(0, 0, 9 * time), time)
    return stage


def world(stage: Usd.Stage, path: str, time: float | None = None) -> np.ndarray:
    """Local to world by USD itself, for column vectors."""
    code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
    prim = UsdGeom.Imageable(stage.GetPrimAtPath(path))
    return np.array(prim.ComputeLocalToWorldTransform(code)).T


def add_attributes(stage: Usd.Stage) -> None:
    """One of every type of value that there is, on /World/All."""
    prim = stage.DefinePrim("/World/All")
    for name in value_types():
        prim.CreateAttribute(f"of:{name.replace('[]', 's')}", Sdf.ValueTypeNames.Find(name))


def value_types() -> list[str]:
    """Names of value types, arrays among them."""
    plain = "bool uchar int uint int64 uint64 half float double timecode string token asset"
    vectors = "point3h point3f point3d vector3f normal3f color3h color3f color3d color4f texCoord2f"
    others = "quatf matrix2d matrix4d frame4d pathExpression opaque group"
    sized = [f"{name}{size}" for name in ("int", "half", "float", "double") for size in (2, 3, 4)]
    scalars = [*plain.split(" "), *sized, *vectors.split(" "), *others.split(" ")]
    arrays = [f"{name}[]" for name in scalars if name not in ("opaque", "group")]
    return [*scalars, *arrays]


def said(stage: Usd.Stage) -> str:
    """The session layer as text."""
    return stage.GetSessionLayer().ExportToString()


def placed(*, move=(0.0, 0.0, 0.0), turn=0.0, size=1.0):
    """A matrix for column vectors: size, a turn about z, and a move."""
    cos, sin = math.cos(turn), math.sin(turn)
    matrix = np.eye(4)
    matrix[:3, :3] = size * np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    matrix[:3, 3] = move
    return matrix
