"""Tests of native instances and point instancers, compared with USD's own computations."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from tests.delegate.stages import contents, random_cloud
from usdsplat import schema
from usdsplat.delegate.engine import Engine


def matrices(engine):
    """(path, index) -> world matrix of everything that is drawn."""
    return {
        (seen.path, seen.index): np.reshape(seen.transform, (4, 4))
        for _, _, seen in engine.render_scene.drawn()
    }


def asset_stage():
    """An asset of a field under a moved Xform, and nothing else."""
    stage = Usd.Stage.CreateInMemory()
    root = UsdGeom.Xform.Define(stage, "/Asset")
    root.AddTransformOp().Set(Gf.Matrix4d(np.diag([1.0, 2, -3, 1])))
    schema.author(stage, "/Asset/Splats", random_cloud())
    UsdGeom.Xformable(stage.GetPrimAtPath("/Asset/Splats")).AddTranslateOp().Set((1, 2, 3))
    return stage


def instancer(stage, path, targets, indices, positions, **arrays):
    scattered = UsdGeom.PointInstancer.Define(stage, path)
    scattered.CreatePrototypesRel().SetTargets(targets)
    scattered.CreateProtoIndicesAttr(indices)
    scattered.CreatePositionsAttr([Gf.Vec3f(*position) for position in positions])
    for name, value in arrays.items():
        scattered.GetPrim().GetAttribute(name).Set(value)
    return scattered


def test_native_instances_share_one_range_of_splats_and_stand_where_usd_says():
    """Oracle: UsdGeom.XformCache on the instance proxies; and the number of splats held."""
    stage = asset_stage()
    for number, name in enumerate(("One", "Two", "Three")):
        prim = UsdGeom.Xform.Define(stage, f"/World/{name}")
        prim.AddRotateXYZOp().Set(Gf.Vec3f(10 * number, 20, 30))
        prim.GetPrim().GetReferences().AddInternalReference("/Asset")
        prim.GetPrim().SetInstanceable(True)
    with Engine(stage) as engine:
        assert engine.render_scene.splat_count == 24  # /Asset itself and the prototype
        found = matrices(engine)
        assert set(found) == {
            ("/Asset/Splats", 0),
            *((f"/World/{name}/Splats", 0) for name in ("One", "Two", "Three")),
        }
        cache = UsdGeom.XformCache()
        for (path, _), matrix in found.items():
            world = cache.GetLocalToWorldTransform(stage.GetPrimAtPath(path))
            np.testing.assert_array_equal(matrix, np.array(world).T)


def test_point_instances_stand_where_usd_computes_them():
    """Oracle: UsdGeom.PointInstancer.ComputeInstanceTransformsAtTime with prototype transforms."""
    stage = asset_stage()
    UsdGeom.Xform.Define(stage, "/World").AddRotateZOp().Set(40.0)
    scattered = instancer(
        stage, "/World/Scatter", ["/Asset", "/Asset/Splats"], [0, 1, 0],
        [(1, 0, 0), (0, 2, 0), (0, 0, 3)],
        orientations=Vt.QuathArray([Gf.Quath(0.5, 0.5, 0.5, 0.5)] * 3),
        scales=[Gf.Vec3f(1, 2, 3)] * 3,
    )  # fmt: skip
    with Engine(stage) as engine:
        found = matrices(engine)
    assert set(found) == {("/Asset/Splats", index) for index in range(7)} - {
        # three of each prototype would be six; the asset draws itself as well, first
        ("/Asset/Splats", 2), ("/Asset/Splats", 4), ("/Asset/Splats", 6),
    }  # fmt: skip
    time = Usd.TimeCode.Default()
    computed = np.array(scattered.ComputeInstanceTransformsAtTime(time, time))
    to_world = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(scattered.GetPrim()))
    inside = np.array(
        UsdGeom.Xformable(stage.GetPrimAtPath("/Asset/Splats")).GetLocalTransformation()
    )
    expected = {1: inside @ computed[0], 3: inside @ computed[2], 5: computed[1]}
    for index, matrix in expected.items():
        # USD counts the prototype root's own transform, which for its second is the field's
        np.testing.assert_allclose(
            found["/Asset/Splats", index], (matrix @ to_world).T, rtol=1e-6, atol=1e-6
        )


def test_masks_hide_instances_and_leave_the_others_their_numbers():
    """Oracle: USD's meaning of invisibleIds, inactiveIds and ids."""
    stage = asset_stage()
    scattered = instancer(stage, "/S", ["/Asset"], [0, 0, 0], [(1, 0, 0)] * 3, ids=[7, 8, 9])
    with Engine(stage) as engine:
        scattered.InvisId(8, Usd.TimeCode.Default())
        assert set(matrices(engine)) == {("/Asset/Splats", number) for number in (0, 1, 3)}
        scattered.DeactivateId(7)
        assert set(matrices(engine)) == {("/Asset/Splats", number) for number in (0, 3)}
        scattered.VisAllIds(Usd.TimeCode.Default())
        scattered.ActivateAllIds()
        assert len(matrices(engine)) == 4


def test_prototypes_may_hide_in_overs_classes_and_beneath_their_instancer():
    """Oracle: UsdGeom.PointInstancer's documentation on keeping prototypes from being drawn."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.PointInstancer.Define(stage, "/S")
    for path in ("/Overs/A", "/Classes/A", "/S/Prototypes/A"):
        schema.author(stage, path, random_cloud())
    stage.GetPrimAtPath("/Overs").SetSpecifier(Sdf.SpecifierOver)
    stage.GetPrimAtPath("/Classes").SetSpecifier(Sdf.SpecifierClass)
    with Engine(stage) as engine:
        assert matrices(engine) == {}
        instancer(
            stage, "/S", ["/Overs/A", "/Classes/A", "/S/Prototypes/A"], [0, 1, 2], [(0, 0, 0)] * 3
        )
        paths = {path for path, _ in matrices(engine)}
        assert paths == {"/Overs/A", "/Classes/A", "/S/Prototypes/A"}


def test_instancers_nest_in_prototypes_and_in_native_instances():
    """Oracle: counting: 2 outer x 3 inner in each of 2 native instances, at the sums of offsets."""
    stage = Usd.Stage.CreateInMemory()
    schema.author(stage, "/Asset/Outer/P/Inner/Q/Leaf", random_cloud())
    instancer(stage, "/Asset/Outer", ["/Asset/Outer/P"], [0, 0], [(0, 0, 0), (10, 0, 0)])
    instancer(
        stage, "/Asset/Outer/P/Inner", ["/Asset/Outer/P/Inner/Q"], [0] * 3,
        [(0, 0, 0), (0, 1, 0), (0, 2, 0)],
    )  # fmt: skip
    stage.GetPrimAtPath("/Asset").SetSpecifier(Sdf.SpecifierClass)
    for number, name in enumerate("AB"):
        prim = UsdGeom.Xform.Define(stage, f"/{name}")
        prim.AddTranslateOp().Set((0, 0, 100 * number))
        prim.GetPrim().GetReferences().AddInternalReference("/Asset")
        prim.GetPrim().SetInstanceable(True)
    with Engine(stage) as engine:
        found = {key: tuple(matrix[:3, 3]) for key, matrix in matrices(engine).items()}
        assert engine.render_scene.splat_count == 12
    expected = {
        (f"/{name}/Outer/P/Inner/Q/Leaf", 3 * i + j): (10.0 * i, 1.0 * j, 100.0 * number)
        for number, name in enumerate("AB")
        for i in range(2)
        for j in range(3)
    }
    assert found == expected


def test_an_instancer_that_holds_itself_is_a_warning():
    """Oracle: the walk ends, and the sentence names the prim."""
    stage = Usd.Stage.CreateInMemory()
    schema.author(stage, "/Group/Leaf", random_cloud())
    instancer(stage, "/Group/S", ["/Group"], [0], [(5, 0, 0)])
    with Engine(stage) as engine:
        assert set(matrices(engine)) == {("/Group/Leaf", 0), ("/Group/Leaf", 1)}
        assert ["/Group/S: found an instancer" in each for each in engine.warnings] == [True]


def test_prototypes_that_are_not_there_are_a_warning_until_they_are():
    """Oracle: the sentence, and the field once it exists."""
    stage = Usd.Stage.CreateInMemory()
    instancer(stage, "/S", ["/Late"], [0], [(0, 0, 0)])
    with Engine(stage) as engine:
        assert engine.warnings == (
            "/S: found no prim at its prototype /Late, expected an existing one",
        )
        schema.author(stage, "/Late", random_cloud())
        assert len(matrices(engine)) == 2
        assert engine.warnings == ()


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("positions", [Gf.Vec3f(0)] * 2, "found 2 positions, expected 3"),
        ("ids", [1, 2], "found 2 ids, expected 3"),
    ],
)
def test_arrays_that_do_not_fit_are_a_warning_and_leave_the_rest_alone(name, value, words):
    """Oracle: the sentence; the asset itself is still drawn."""
    stage = asset_stage()
    scattered = instancer(stage, "/S", ["/Asset"], [0] * 3, [(1, 0, 0)] * 3)
    scattered.InvisId(1, Usd.TimeCode.Default())
    with Engine(stage) as engine:
        assert len(matrices(engine)) == 3
        scattered.GetPrim().GetAttribute(name).Set(value)
        assert set(matrices(engine)) == {("/Asset/Splats", 0)}
        assert [words in warning for warning in engine.warnings] == [True]


def test_velocities_move_instances_between_and_after_samples():
    """Oracle: UsdGeom.PointInstancer's rule, by hand: position + velocity * seconds."""
    stage = asset_stage()
    stage.SetTimeCodesPerSecond(10)
    scattered = UsdGeom.PointInstancer.Define(stage, "/S")
    scattered.CreatePrototypesRel().SetTargets(["/Asset"])
    scattered.CreateProtoIndicesAttr([0])
    scattered.CreatePositionsAttr().Set([Gf.Vec3f(0)], 1)
    scattered.CreateVelocitiesAttr().Set([Gf.Vec3f(20, 0, 0)], 1)
    with Engine(stage, time=1) as engine:
        before = matrices(engine)["/Asset/Splats", 1]
        engine.set_time(4)
        after = matrices(engine)["/Asset/Splats", 1]
    np.testing.assert_allclose((after - before)[:, 3], [6, 0, 0, 0], atol=1e-5)


def test_an_edit_of_the_source_reaches_every_instance():
    """Oracle: an engine that never saw the stage before the edit."""
    stage = asset_stage()
    for name in "AB":
        prim = UsdGeom.Xform.Define(stage, f"/{name}").GetPrim()
        prim.GetReferences().AddInternalReference("/Asset")
        prim.SetInstanceable(True)
    edits = [
        lambda: schema.author(stage, "/Asset/Splats", random_cloud(9)),
        lambda: (
            stage.GetPrimAtPath("/Asset/Splats").GetAttribute("xformOp:translate").Set((9, 9, 9))
        ),
        lambda: UsdGeom.Imageable(stage.GetPrimAtPath("/Asset/Splats")).MakeInvisible(),
        lambda: UsdGeom.Imageable(stage.GetPrimAtPath("/Asset/Splats")).MakeVisible(),
        lambda: schema.author(stage, "/Asset/Second", random_cloud(10)),
        lambda: stage.GetPrimAtPath("/A").SetInstanceable(False),
        lambda: stage.RemovePrim("/Asset/Splats"),
    ]
    with Engine(stage) as engine:
        for edit in edits:
            before = contents(engine)
            edit()
            with Engine(stage) as fresh:
                assert contents(engine) == contents(fresh)
            assert contents(engine) != before


def test_a_colour_space_named_above_an_instance_is_its_own():
    """Oracle: USD's inheritance: what is said above one instance does not reach another, and what
    the attribute itself says holds for both; and an engine that never saw the edits."""
    stage = Usd.Stage.CreateInMemory()
    prim = schema.author(stage, "/Asset/Splats", random_cloud())
    prim.RemoveProperty("colorSpace:name")
    for name in "AB":
        child = UsdGeom.Xform.Define(stage, f"/{name}/I").GetPrim()
        child.GetReferences().AddInternalReference("/Asset")
        child.SetInstanceable(True)
    above = Usd.ColorSpaceAPI.Apply(stage.GetPrimAtPath("/B")).CreateColorSpaceNameAttr()
    harmonics = prim.GetAttribute("radiance:sphericalHarmonicsCoefficients")
    trained, linear, wide = "srgb_rec709_scene", "lin_rec709_scene", "lin_ap1_scene"
    edits = [
        (lambda: None, (trained, trained)),
        (lambda: above.Set(linear), (trained, linear)),
        (lambda: above.Set(wide), (trained, wide)),
        (lambda: harmonics.SetColorSpace(linear), (linear, linear)),
        (lambda: harmonics.ClearColorSpace(), (trained, wide)),
        (lambda: above.Clear(), (trained, trained)),
    ]
    with Engine(stage) as engine:
        for edit, expected in edits:
            edit()
            spaces = {seen[5].path: seen[1] for seen in contents(engine)}
            assert (spaces["/A/I/Splats"], spaces["/B/I/Splats"]) == expected
            with Engine(stage) as fresh:
                assert contents(engine) == contents(fresh)


def test_masks_may_be_animated():
    """Oracle: the samples, which USD holds."""
    stage = asset_stage()
    scattered = instancer(stage, "/S", ["/Asset"], [0, 0], [(1, 0, 0)] * 2)
    scattered.InvisId(0, 1)
    scattered.InvisId(1, 2)
    with Engine(stage, time=1) as engine:
        assert set(matrices(engine)) == {("/Asset/Splats", number) for number in (0, 2)}
        engine.set_time(2)
        assert set(matrices(engine)) == {("/Asset/Splats", 0)}


@pytest.mark.parametrize("name", ["protoIndices", "positions"])
def test_arrays_of_another_type_are_a_finding(name):
    """Oracle: the type authored here, over that of the schema."""
    stage = Usd.Stage.CreateInMemory()
    text = f'#usda 1.0\ndef PointInstancer "Scatter"\n{{\n    float {name} = 2\n}}\n'
    stage.GetRootLayer().ImportFromString(text)
    with Engine(stage) as engine:
        engine.sync()
        (found,) = engine.findings
    assert (found.code, found.path) == ("bad-instancer", "/Scatter")
    assert "a value of type float" in found.found
