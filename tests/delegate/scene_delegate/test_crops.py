"""Tests of garbage mattes on the stage."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom

from tests.delegate.scene_delegate.test_changes import pulled
from tests.delegate.stages import contents, random_cloud, two_fields
from tests.delegate.surface_stages import surfaces
from usdsplat import schema
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.scene_delegate.population import populate
from usdsplat.render.cropping import inside


def crop(stage, path, *targets, name="cropInclude"):
    """Crop a field by what is at `targets`."""
    prim = stage.GetPrimAtPath(path)
    prim.ApplyAPI("SplatCropAPI")
    prim.GetRelationship(f"collection:{name}:includes").SetTargets(targets)
    return Usd.CollectionAPI(prim, name)


def crops(engine, path="/World/A"):
    """The volumes in the render scene, by the field's path."""
    return {name: field.crops for name, field, _ in engine.render_scene.drawn()}[path]


@pytest.fixture
def stage():
    stage = two_fields()
    UsdGeom.Xform.Define(stage, "/Mattes").AddTranslateOp().Set((1, 2, 3))
    sphere = UsdGeom.Sphere.Define(stage, "/Mattes/Sphere")
    sphere.CreateRadiusAttr(2.0)
    crop(stage, "/World/A", "/Mattes/Sphere")
    return stage


def test_a_sphere_is_where_and_as_large_as_usd_says(stage):
    """Oracle: the closed form; only the field that names it is cropped."""
    with Engine(stage) as engine:
        (spec,) = crops(engine)
        assert crops(engine, "/World/B") == ()
    assert (spec.shape, spec.keeps, spec.length) == ("sphere", True, 0.0)
    expected = [[0.5, 0, 0, -0.5], [0, 0.5, 0, -1], [0, 0, 0.5, -1.5], [0, 0, 0, 1]]
    np.testing.assert_allclose(np.reshape(spec.world_to_shape, (4, 4)), expected)


def within(kind, points, axis):
    """Which local points a gprim of radius 0.8, height 1.4 and size 1.2 holds."""
    along = "XYZ".index(axis)
    h = points[:, along]
    r = np.linalg.norm(np.delete(points, along, axis=1), axis=1)
    return {
        "Sphere": np.linalg.norm(points, axis=1) <= 0.8,
        "Cube": (np.abs(points) <= 0.6).all(axis=1),
        "Cylinder": (r <= 0.8) & (np.abs(h) <= 0.7),
        "Cone": (r <= 0.8 * (0.7 - h) / 1.4) & (np.abs(h) <= 0.7),
        "Capsule": np.hypot(r, np.clip(np.abs(h) - 0.7, 0, None)) <= 0.8,
        "Plane": h <= 0,
    }[kind]


@pytest.mark.parametrize("axis", "XYZ")
@pytest.mark.parametrize("kind", ["Sphere", "Cube", "Cylinder", "Cone", "Capsule", "Plane"])
def test_a_volume_holds_what_the_gprim_holds(stage, kind, axis):
    """Oracle: UsdGeom's description of the gprim in its own space; Gf takes points to the world
    through a sheared and mirrored transform."""
    prim = stage.DefinePrim("/Mattes/Volume", kind)
    for name, value in (("radius", 0.8), ("height", 1.4), ("size", 1.2), ("axis", axis)):
        if prim.HasAttribute(name):
            prim.GetAttribute(name).Set(value)
    rng = np.random.default_rng(3)
    matrix = np.eye(4)
    matrix[:3, :3] = rng.normal(size=(3, 3))
    matrix[0, :3] *= -np.sign(np.linalg.det(matrix))
    UsdGeom.Xformable(prim).MakeMatrixXform().Set(Gf.Matrix4d(matrix))
    crop(stage, "/World/A", "/Mattes/Volume", name="cropExclude")
    crop(stage, "/World/A")
    local = rng.uniform(-1.8, 1.8, size=(4000, 3))
    world = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(Usd.TimeCode.Default())
    points = np.array([world.Transform(Gf.Vec3d(*map(float, point))) for point in local])
    with Engine(stage) as engine:
        expected = ~within(kind, local, axis)
        assert 200 < expected.sum() < 3950
        np.testing.assert_array_equal(inside(crops(engine), points), expected)


def add_nested(stage):
    """Crop by the collection of another prim."""
    UsdGeom.Cube.Define(stage, "/Mattes/Cube")
    nested = Usd.CollectionAPI.Apply(stage.GetPrimAtPath("/Mattes"), "all")
    nested.CreateIncludesRel().SetTargets(["/Mattes"])
    crop(stage, "/World/A", "/Mattes.collection:all")


EDITS = {
    "the radius": lambda s: s.GetAttributeAtPath("/Mattes/Sphere.radius").Set(3.0),
    "a move above": lambda s: s.GetAttributeAtPath("/Mattes.xformOp:translate").Set((4, 5, 6)),
    "a new op": lambda s: UsdGeom.Xformable(s.GetPrimAtPath("/Mattes")).AddScaleOp().Set((2, 2, 2)),
    "another type": lambda s: s.GetPrimAtPath("/Mattes/Sphere").SetTypeName("Cube"),
    "deactivation": lambda s: s.GetPrimAtPath("/Mattes/Sphere").SetActive(False),
    "removal": lambda s: s.RemovePrim("/Mattes"),
    "the collection": lambda s: crop(s, "/World/A"),
    "the other collection": lambda s: crop(s, "/World/A", "/Mattes", name="cropExclude"),
    "a nested collection": add_nested,
    "no collection": lambda s: s.GetPrimAtPath("/World/A").RemoveProperty(
        "collection:cropInclude:includes"
    ),
}


RELEASING = ("the collection", "no collection")
"""Edits by which a volume becomes a sphere to look at."""

DRAWN = Counter(
    dict.fromkeys(
        ("mesh", "points", "primvars", "material", "placements", "transforms", "visible"), 1
    )
)
"""What is read of one shape that is drawn from now on."""


@pytest.mark.parametrize("name", EDITS)
def test_edits_of_volumes_and_collections_are_noticed_and_pull_nothing_else(stage, name):
    """Oracle: a fresh engine; the splats, and the other field, are not read again, and of shapes
    only one that is no volume any more."""
    with Engine(stage) as engine:
        before = crops(engine)
        change = pulled(engine, lambda: EDITS[name](stage))
        if name in RELEASING:
            assert change >= DRAWN
            change -= DRAWN
        assert set(change) <= {"crops"} and change["crops"] <= 1
        assert crops(engine) != before
        with Engine(stage) as fresh:
            assert contents(engine) == contents(fresh)
            assert surfaces(engine) == surfaces(fresh)


def test_members_of_a_group_come_and_go(stage):
    """Oracle: the number of volumes; a collection of the group holds what is beneath it."""
    crop(stage, "/World/A", "/Mattes")
    with Engine(stage) as engine:
        assert len(crops(engine)) == 1
        UsdGeom.Cube.Define(stage, "/Mattes/Inner/Cube")
        assert [spec.shape for spec in crops(engine)] == ["cube", "sphere"]
        stage.GetPrimAtPath("/Mattes/Inner").SetActive(False)
        assert len(crops(engine)) == 1
        collection = Usd.CollectionAPI(stage.GetPrimAtPath("/World/A"), "cropInclude")
        collection.CreateExcludesRel().SetTargets(["/Mattes/Sphere"])
        assert crops(engine) == ()


def test_nested_collections_are_followed(stage):
    """Oracle: the number of volumes; the edit is of a collection of another prim."""
    add_nested(stage)
    with Engine(stage) as engine:
        assert len(crops(engine)) == 2
        nested = Usd.CollectionAPI(stage.GetPrimAtPath("/Mattes"), "all")
        change = pulled(engine, lambda: nested.CreateExcludesRel().SetTargets(["/Mattes/Cube"]))
        assert change == Counter(crops=1) + DRAWN
        assert [spec.shape for spec in crops(engine)] == ["sphere"]


@pytest.mark.parametrize("hide", ["visibility", "purpose"])
def test_a_hidden_matte_crops_all_the_same(stage, hide):
    """Oracle: the volumes before; nothing is read again."""
    imageable = UsdGeom.Imageable(stage.GetPrimAtPath("/Mattes"))
    with Engine(stage) as engine:
        before = crops(engine)

        def edit():
            if hide == "visibility":
                imageable.MakeInvisible()
            else:
                imageable.CreatePurposeAttr("guide")

        assert pulled(engine, edit) == Counter()
        assert crops(engine) == before != ()


@pytest.mark.parametrize("what", ["Sphere.radius", "Sphere.xformOp:translate"])
def test_volumes_may_be_animated(stage, what):
    """Oracle: an engine that is at the time from the start; the other field is left alone."""
    UsdGeom.Xformable(stage.GetPrimAtPath("/Mattes/Sphere")).AddTranslateOp()
    for time, value in ((1, 1.0), (3, 2.0)):
        value = value if "radius" in what else Gf.Vec3d(value)
        stage.GetAttributeAtPath(f"/Mattes/{what}").Set(value, time)
    with Engine(stage, time=1) as engine, Engine(stage, time=2) as there:
        before = crops(engine)
        assert pulled(engine, lambda: engine.set_time(2)) == Counter(crops=1)
        assert before != crops(engine) == crops(there)


def test_what_is_no_volume_is_said_and_crops_nothing(stage):
    """Oracle: the sentence, and the volume that is left."""
    UsdGeom.Mesh.Define(stage, "/Mattes/Mesh")
    crop(stage, "/World/A", "/Mattes")
    with Engine(stage) as engine:
        assert [spec.shape for spec in crops(engine)] == ["sphere"]
        (sentence,) = engine.warnings
        assert sentence == (
            "/World/A.collection:cropInclude: found Mesh /Mattes/Mesh, which cannot crop, "
            "expected one of Sphere, Cube, Cylinder, Cone, Capsule, Plane; it does not crop"
        )
        stage.RemovePrim("/Mattes/Mesh")
        assert engine.warnings == ()


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_a_volume_without_an_inside_holds_nothing_and_is_said(stage, value):
    """Oracle: nothing is inside a ball of no size, so nothing is kept."""
    attribute = stage.GetAttributeAtPath("/Mattes/Sphere.radius")
    with Engine(stage) as engine:
        attribute.Set(value)
        (spec,) = crops(engine)
        assert not inside([spec], np.zeros((1, 3))).any()
        (sentence,) = engine.warnings
        assert sentence.startswith("/Mattes/Sphere: found an empty crop volume")
        attribute.Set(Sdf.ValueBlock())
        assert engine.warnings == () and inside(crops(engine), np.array([[1, 2, 3.9]])).all()


def test_a_flat_volume_has_no_inside(stage):
    """Oracle: a matrix without an inverse."""
    UsdGeom.Xformable(stage.GetPrimAtPath("/Mattes")).AddScaleOp().Set((1, 0, 1))
    with Engine(stage) as engine:
        assert not inside(crops(engine), np.array([[1, 0, 3]])).any()
        assert len(engine.warnings) == 1


def test_instances_are_cropped_each_by_its_own_volume():
    """Oracle: the closed form, at each instance's place."""
    stage = Usd.Stage.CreateInMemory()
    schema.author(stage, "/Source/Splats", random_cloud(1))
    UsdGeom.Sphere.Define(stage, "/Source/Matte")
    crop(stage, "/Source/Splats", "/Source/Matte")
    stage.GetPrimAtPath("/Source").SetSpecifier(Sdf.SpecifierClass)
    for name, x in (("One", 10.0), ("Two", 20.0)):
        prim = UsdGeom.Xform.Define(stage, f"/{name}")
        prim.AddTranslateOp().Set((x, 0, 0))
        prim.GetPrim().GetReferences().AddInternalReference("/Source")
        prim.GetPrim().SetInstanceable(True)
    with Engine(stage) as engine:
        for name, x in (("One", 10.0), ("Two", 20.0)):
            (spec,) = crops(engine, f"/{name}/Splats")
            assert spec.world_to_shape[3] == -x
        stage.GetAttributeAtPath("/Two.xformOp:translate").Set((30, 0, 0))
        assert crops(engine, "/Two/Splats")[0].world_to_shape[3] == -30
        stage.GetAttributeAtPath("/Source/Matte.radius").Set(2.0)
        assert crops(engine, "/One/Splats")[0].world_to_shape[3] == -5
    assert populate(stage).crop_volumes == {"/One/Matte", "/Two/Matte"}


def test_a_point_instancer_leaves_volumes_where_they_are_and_says_so(stage):
    """Oracle: the sentence."""
    scattered = UsdGeom.PointInstancer.Define(stage, "/Scatter")
    scattered.CreatePrototypesRel().SetTargets(["/World/A"])
    scattered.CreateProtoIndicesAttr([0])
    scattered.CreatePositionsAttr([Gf.Vec3f(50)])
    with Engine(stage) as engine:
        assert crops(engine)[0].world_to_shape[3] == -0.5
        (sentence,) = engine.warnings
    assert "found crop volumes of a field that is instanced by a point instancer" in sentence


def test_volumes_are_not_drawn(stage):
    """Oracle: the collections authored here."""
    UsdGeom.Cube.Define(stage, "/Mattes/Cube")
    UsdGeom.Cube.Define(stage, "/Set/Cube")
    crop(stage, "/World/B", "/Mattes", name="cropExclude")
    found = populate(stage)
    assert found.crop_volumes == {"/Mattes/Sphere", "/Mattes/Cube"}
    assert list(found.meshes) == ["/Set/Cube"]


def test_a_shape_may_crop_in_one_instance_and_be_drawn_in_another():
    """Oracle: the collection, which names the shape in one instance only."""
    stage = Usd.Stage.CreateInMemory()
    schema.author(stage, "/Source/Splats", random_cloud(1))
    UsdGeom.Sphere.Define(stage, "/Source/Matte")
    stage.GetPrimAtPath("/Source").SetSpecifier(Sdf.SpecifierClass)
    for name in ("One", "Two"):
        prim = UsdGeom.Xform.Define(stage, f"/{name}").GetPrim()
        prim.GetReferences().AddInternalReference("/Source")
        prim.SetInstanceable(True)
    schema.author(stage, "/Field", random_cloud(2))
    crop(stage, "/Field", "/Two/Matte")
    with Engine(stage) as engine:
        assert [spec.shape for spec in crops(engine, "/Field")] == ["sphere"]
        assert list(populate(stage).meshes) == ["/One/Matte"]
        assert [each[1].path for each in surfaces(engine)] == ["/One/Matte"]
        crop(stage, "/Field", "/One/Matte")
        assert [each[1].path for each in surfaces(engine)] == ["/Two/Matte"]
        crop(stage, "/Field")
        assert [each[1].path for each in surfaces(engine)] == ["/One/Matte", "/Two/Matte"]


def test_the_schema_is_for_fields_and_brings_its_collections(stage):
    """Oracle: USD's CanApplyAPI and the schemas that it says are applied."""
    assert not stage.GetPrimAtPath("/Mattes/Sphere").CanApplyAPI("SplatCropAPI")
    packed = schema.author(stage, "/Packed", random_cloud(), form="packed")
    assert packed.CanApplyAPI("SplatCropAPI")
    found = stage.GetPrimAtPath("/World/A").GetAppliedSchemas()
    assert {"CollectionAPI:cropInclude", "CollectionAPI:cropExclude"} <= set(found)


def test_collections_count_where_the_schema_is_not_applied(stage):
    """Oracle: the volume; a host that loaded USD before us does not know the schema."""
    stage.GetPrimAtPath("/World/A").RemoveAppliedSchema("SplatCropAPI")
    with Engine(stage) as engine:
        assert len(crops(engine)) == 1
