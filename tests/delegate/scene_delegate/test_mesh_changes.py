"""Tests of which edits make the delegate read data of meshes again."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from tests.delegate.surface_stages import (
    add_material,
    add_mesh,
    add_skinned,
    add_subset,
    bind,
    colors,
    mesh_at,
    pulled,
    surfaces,
)
from usdsplat.delegate.engine import Engine


def edited_stage():
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.Xform.Define(stage, "/World")
    mesh = add_mesh(stage, "/World/M", faces=2)
    mesh.CreateDisplayColorAttr(colors((1, 0, 0)))
    add_subset(mesh, "Half", [0])
    bind(stage.GetPrimAtPath("/World/M/Half"), add_material(stage, "/Looks/Red"))
    add_material(stage, "/Looks/Unused")
    add_skinned(stage, "/Rig")
    UsdGeom.Sphere.Define(stage, "/World/Ball")
    return stage


def set_(path, value):
    return lambda stage: stage.GetAttributeAtPath(path).Set(value)


EDITS = {
    "points": (set_("/World/M.points", [Gf.Vec3f(i, i % 2, 0) for i in range(6)]), {"points": 1}),
    "topology": (
        set_("/World/M.faceVertexIndices", [0, 1, 2, 3, 2, 3, 4, 5]),
        {"topology": 1, "points": 1, "normals": 1, "material": 1, "primvars": 1},
    ),
    "colours": (set_("/World/M.primvars:displayColor", colors((0, 1, 0))), {"primvars": 1}),
    "a colour nobody asks for": (
        lambda stage: UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/Ball")).CreatePrimvar(
            "width", Sdf.ValueTypeNames.Float
        ),
        {"primvars": 1},
    ),
    "normals": (
        lambda stage: UsdGeom.Mesh.Get(stage, "/World/M").CreateNormalsAttr([Gf.Vec3f(1)] * 6),
        {"normals": 1},
    ),
    "sides": (set_("/World/M.doubleSided", True), {}),
    "a shader": (set_("/Looks/Red/Surface.inputs:diffuseColor", Gf.Vec3f(1)), {"material": 1}),
    "a shader of no interest": (
        set_("/Looks/Unused/Surface.inputs:diffuseColor", Gf.Vec3f(1)),
        None,
    ),
    "a material that goes": (lambda stage: stage.RemovePrim("/Looks/Red"), {"material": 1}),
    "a subset": (set_("/World/M/Half.indices", [1]), {"material": 1}),
    "a new subset": (
        lambda stage: add_subset(UsdGeom.Mesh.Get(stage, "/World/M"), "Rest", [1]),
        {"material": 1},
    ),
    "an animation": (
        set_("/Rig/Animation.translations", [Gf.Vec3f(0)] * 2),
        {"points": 1, "normals": 1},
    ),
    "a skeleton that moves": (
        lambda stage: (
            UsdGeom.Xformable(stage.GetPrimAtPath("/Rig/Skeleton"))
            .AddTranslateOp()
            .Set(Gf.Vec3d(1))
        ),
        {"transforms": 1},
    ),
    "a size": (set_("/World/Ball.radius", 3.0), {"points": 1, "material": 1, "primvars": 1}),
    "a transform above": (
        lambda stage: UsdGeom.Xformable(stage.GetPrimAtPath("/World")).AddRotateXOp().Set(10.0),
        {"transforms": 2},
    ),
    "visibility": (
        lambda stage: UsdGeom.Imageable(stage.GetPrimAtPath("/World/M")).MakeInvisible(),
        {"visible": 1},
    ),
}


@pytest.mark.parametrize("name", EDITS)
def test_an_edit_pulls_what_it_changed_and_no_more(name):
    """Oracle: the list above, written from the meaning of each edit; and a fresh engine's scene."""
    stage = edited_stage()
    edit, expected = EDITS[name]
    with Engine(stage, time=1) as engine:
        change = pulled(engine, lambda: edit(stage))
        change.pop("mesh", None)
        assert change == Counter(expected or {})
        with Engine(stage, time=1) as fresh:
            assert surfaces(engine) == surfaces(fresh)


def test_time_pulls_points_of_what_moves_and_leaves_its_topology():
    """Oracle: the samples authored here."""
    stage = Usd.Stage.CreateInMemory()
    mesh = add_mesh(stage, "/M", scheme="catmullClark")
    add_mesh(stage, "/Still")
    points = np.array(mesh.GetPointsAttr().Get())
    for time in (1, 3):
        mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points * np.float32(time)), time)
    with Engine(stage, time=1) as engine:
        first = mesh_at(engine, "/M")
        change = pulled(engine, lambda: engine.set_time(2))
        assert change == Counter(mesh=1, points=1)
        second = mesh_at(engine, "/M")
        assert second.triangles is first.triangles and second.faces is first.faces
        assert np.allclose(second.points, 2 * first.points, atol=1e-6)


def test_polygons_whose_points_are_all_animated_are_cut_by_the_first_sample():
    """Oracle: the triangles of the same polygon at rest; as it is at time 2 it is cut otherwise."""
    dart = [Gf.Vec3f(*xy, 0) for xy in ((0, 0), (2, -1), (0.5, 0), (2, 1))]
    turned = [dart[3], *dart[:3]]
    triangles = {}
    for name, samples in (("rest", [dart]), ("both", [dart, turned]), ("turned", [turned])):
        stage = Usd.Stage.CreateInMemory()
        mesh = add_mesh(stage, "/M", faces=1)
        mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
        mesh.GetPointsAttr().Clear()
        for time, points in enumerate(samples, start=1):
            mesh.GetPointsAttr().Set(points, time)
        with Engine(stage, time=2) as engine:
            triangles[name] = mesh_at(engine, "/M").triangles.tolist()
    assert triangles["both"] == triangles["rest"] != triangles["turned"]
