"""Tests of UsdSkel: skinned points compared with published bakes, and their dependencies."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel

from tests.delegate.surface_stages import add_mesh, add_skinned, mesh_at, surfaces, world_points
from usdsplat.delegate.engine import Engine


def world_normals(engine, path):
    """Unit normals in the world."""
    for _, mesh, instance in engine.render_scene.drawn_meshes():
        if instance.path == path and mesh.spec.normals is not None:
            linear = np.array(instance.transform).reshape(4, 4)[:3, :3]
            turned = mesh.spec.normals @ np.linalg.inv(linear)
            return turned / np.linalg.norm(turned, axis=-1, keepdims=True)
    return None


@pytest.mark.parametrize("name", ["lbs", "dqs", "blendshapes", "blendshapesWithNormals"])
def test_skinned_points_and_normals_are_those_of_the_bake(name, data):
    """Oracle: OpenUSD's own baked files, frame by frame: linear and dual quaternion skinning,
    rigid shapes, joint subsets, blend shapes with in-betweens."""
    folder = data / "usd/openusd/skelBake"
    skinned = Usd.Stage.Open(str(folder / f"{name}.usda"))
    baked = Usd.Stage.Open(str(folder / f"{name}.baked.usda"))
    with Engine(skinned, refinement=0) as engine, Engine(baked, refinement=0) as oracle:
        assert engine.meshes() == oracle.meshes()
        assert {each.code for each in engine.findings} <= {"unsupported-prim"}  # bones as curves
        for time in (1, 5, 10, 20, 30):
            engine.set_time(time)
            oracle.set_time(time)
            for path in engine.meshes():
                found, expected = world_points(engine, path), world_points(oracle, path)
                assert np.abs(found - expected).max() <= 1e-5
                turned = world_normals(engine, path)
                if turned is not None:
                    assert np.abs(turned - world_normals(oracle, path)).max() <= 1e-5


def test_joints_carry_points_and_the_meshs_own_transform_does_not_count():
    """Oracle: the joint's translation and the skeleton's place, by hand."""
    stage = Usd.Stage.CreateInMemory()
    mesh = add_skinned(stage, "/Rig")
    UsdGeom.Xformable(mesh).AddTranslateOp().Set(Gf.Vec3d(100, 0, 0))
    UsdGeom.Xformable(stage.GetPrimAtPath("/Rig/Skeleton")).AddTranslateOp().Set(Gf.Vec3d(0, 7, 0))
    with Engine(stage, time=2) as engine:
        expected = [[0, 7, 0], [0, 8, 0], [1, 7, 0.5], [1, 8, 0.5]]
        assert np.allclose(world_points(engine, "/Rig/Mesh"), expected, atol=1e-6)
        engine.set_time(3)
        assert world_points(engine, "/Rig/Mesh")[2:, 2].tolist() == [1.0, 1.0]


def test_what_moves_the_skeleton_over_time_moves_the_mesh():
    """Oracle: the samples; only transforms are read again."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.Xform.Define(stage, "/Elsewhere")
    add_skinned(stage, "/Elsewhere/Rig")
    stage.GetAttributeAtPath("/Elsewhere/Rig/Animation.translations").Set([Gf.Vec3f(0)] * 2, 3)
    op = UsdGeom.Xformable(stage.GetPrimAtPath("/Elsewhere/Rig/Skeleton")).AddTranslateOp()
    op.Set(Gf.Vec3d(0), 1)
    op.Set(Gf.Vec3d(0, 0, 4), 3)
    with Engine(stage, time=1) as engine:
        engine.sync()
        before = Counter(engine.pulls)
        engine.set_time(2)
        assert np.allclose(world_points(engine, "/Elsewhere/Rig/Mesh")[:, 2], 2)
        assert (Counter(engine.pulls) - before)["transforms"] == 1


def test_a_skeleton_that_is_bound_elsewhere_or_later_is_noticed():
    """Oracle: a fresh engine after each edit."""
    stage = Usd.Stage.CreateInMemory()
    mesh = add_skinned(stage, "/Rig")
    binding = UsdSkel.BindingAPI(mesh)
    skeleton = stage.GetPrimAtPath("/Rig/Skeleton")
    edits = [
        lambda: binding.GetSkeletonRel().SetTargets(["/Rig/Other"]),
        lambda: UsdSkel.Skeleton.Define(stage, "/Rig/Other").CreateJointsAttr(["a", "b"]),
        lambda: [
            UsdSkel.Skeleton.Get(stage, "/Rig/Other").CreateBindTransformsAttr(
                [Gf.Matrix4d(1)] * 2
            ),
            UsdSkel.Skeleton.Get(stage, "/Rig/Other").CreateRestTransformsAttr(
                [Gf.Matrix4d(1)] * 2
            ),
        ],
        lambda: (
            UsdGeom.Xformable(stage.GetPrimAtPath("/Rig/Other"))
            .AddTranslateOp()
            .Set(Gf.Vec3d(0, 0, 3))
        ),
        lambda: (
            UsdSkel.BindingAPI.Apply(stage.GetPrimAtPath("/Rig"))
            .CreateAnimationSourceRel()
            .SetTargets(["/Rig/Animation"])
        ),
        lambda: stage.RemovePrim("/Rig/Animation"),
        lambda: stage.GetPrimAtPath("/Rig").SetTypeName("Xform"),
        lambda: stage.GetPrimAtPath("/Rig").SetTypeName("SkelRoot"),
    ]
    with Engine(stage, time=3) as engine:
        for edit in edits:
            engine.sync()
            edit()
            with Engine(stage, time=3) as fresh:
                assert surfaces(engine) == surfaces(fresh) and engine.warnings == fresh.warnings
    assert skeleton


def test_instances_of_a_rig_are_moved_where_their_own_skeletons_are():
    """Oracle: by hand; the rig is read once."""
    stage = Usd.Stage.CreateInMemory()
    add_skinned(stage, "/Asset/Rig")
    stage.GetPrimAtPath("/Asset").SetSpecifier(Sdf.SpecifierClass)
    for x in (0, 10):
        prim = UsdGeom.Xform.Define(stage, f"/World/At{x}")
        prim.AddTranslateOp().Set(Gf.Vec3d(x, 0, 0))
        prim.GetPrim().GetReferences().AddInternalReference("/Asset")
        prim.GetPrim().SetInstanceable(True)
    with Engine(stage, time=3) as engine:
        assert world_points(engine, "/World/At10/Rig/Mesh")[2].tolist() == [11, 0, 1]
        assert world_points(engine, "/World/At0/Rig/Mesh")[2].tolist() == [1, 0, 1]
        assert engine.pulls["points"] == 1
        animation = stage.GetAttributeAtPath("/Asset/Rig/Animation.translations")
        animation.Set([Gf.Vec3f(0), Gf.Vec3f(0, 0, 5)], 3)
        assert world_points(engine, "/World/At10/Rig/Mesh")[2].tolist() == [11, 0, 5]


def test_influences_that_do_not_fit_are_one_sentence(capfd):
    """Oracle: the sentence, and the mesh beside it."""
    stage = Usd.Stage.CreateInMemory()
    mesh = add_skinned(stage, "/Rig")
    add_mesh(stage, "/Other")
    UsdSkel.BindingAPI(mesh).GetJointIndicesAttr().Set([0, 0, 9, 9])
    with Engine(stage, time=2) as engine:
        (warning,) = engine.warnings
        assert warning.startswith("/Rig/Mesh: found ") and warning.endswith("it is not drawn")
        assert mesh_at(engine, "/Other").points.shape == (6, 3)
        UsdSkel.BindingAPI(mesh).GetJointIndicesAttr().Set([0, 0, 1, 1])
        assert engine.warnings == () and len(surfaces(engine)) == 2
    capfd.readouterr()  # USD says it too
