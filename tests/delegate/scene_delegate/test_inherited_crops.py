"""Tests of garbage mattes that fields inherit from prims above them."""

from __future__ import annotations

import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.delegate.scene_delegate.test_crops import crop, crops
from tests.delegate.stages import contents, two_fields
from usdsplat.delegate.engine import Engine


@pytest.fixture
def stage() -> Usd.Stage:
    """Two fields below a prim, and three volumes."""
    stage = two_fields()
    for name in ("One", "Two", "Three"):
        UsdGeom.Sphere.Define(stage, f"/Mattes/{name}")
    return stage


def kept(engine: Engine, path: str) -> list[bool]:
    """Whether each volume of a field includes."""
    return [each.keeps for each in crops(engine, path)]


def test_a_crop_of_a_model_crops_all_fields_below_it(stage) -> None:
    """Oracle: the same volumes on the field itself; edits are drawn as by a fresh engine."""
    with Engine(stage) as engine:
        assert crops(engine) == ()
        crop(stage, "/World", "/Mattes/One", name="cropExclude")
        engine.sync()
        model = crops(engine), crops(engine, "/World/B")
        assert model[0] == model[1]
        UsdGeom.Sphere(stage.GetPrimAtPath("/Mattes/One")).GetRadiusAttr().Set(2.0)
        with Engine(stage) as fresh:
            assert contents(engine) == contents(fresh)
    other = two_fields()
    UsdGeom.Sphere.Define(other, "/Mattes/One")
    crop(other, "/World/A", "/Mattes/One", name="cropExclude")
    with Engine(other) as engine:
        assert crops(engine) == model[0]


def test_the_nearest_include_counts_and_every_exclude(stage) -> None:
    """Oracle: the rule in the schema's documentation."""
    crop(stage, "/World", "/Mattes/One")
    crop(stage, "/World", "/Mattes/Two", name="cropExclude")
    crop(stage, "/World/A", "/Mattes/Three", name="cropExclude")
    with Engine(stage) as engine:
        assert sorted(kept(engine, "/World/A")) == [False, False, True]
        assert sorted(kept(engine, "/World/B")) == [False, True]
        crop(stage, "/World/A", "/Mattes/Two", "/Mattes/Three")
        engine.sync()
        assert sorted(kept(engine, "/World/A")) == [False, False, True, True]
        assert sorted(kept(engine, "/World/B")) == [False, True]


def test_instances_have_the_crops_of_their_own_models(stage) -> None:
    """Oracle: the collections authored above each instance."""
    stage.OverridePrim("/World").SetSpecifier(Sdf.SpecifierClass)
    for name in ("X", "Y"):
        prim = stage.DefinePrim(f"/{name}", "Xform")
        prim.GetReferences().AddInternalReference("/World")
        prim.SetInstanceable(True)
    crop(stage, "/X", "/Mattes/One", name="cropExclude")
    with Engine(stage) as engine:
        engine.sync()
        assert kept(engine, "/X/A") == [False]
        assert kept(engine, "/Y/A") == []


def test_a_crop_without_a_field_below_is_a_finding(stage) -> None:
    """Oracle: the code and the collection."""
    stage.DefinePrim("/Empty", "Xform")
    crop(stage, "/Empty", "/Mattes/One")
    with Engine(stage) as engine:
        (found,) = engine.findings
    assert (found.code, found.path, found.attribute) == (
        "unused",
        "/Empty",
        "collection:cropInclude",
    )


def test_a_misspelt_crop_of_a_model_is_a_finding(stage) -> None:
    """Oracle: the code, and the name that the sentence suggests."""
    prim = stage.GetPrimAtPath("/World")
    prim.CreateRelationship("collection:cropExlude:includes").SetTargets(["/Mattes/One"])
    with Engine(stage) as engine:
        (found,) = engine.findings
    assert (found.code, found.path) == ("unknown-name", "/World")
    assert "cropExclude" in found.expected


@pytest.mark.parametrize(("where", "count"), [("/World/A", 1), ("/World", 1), ("/Above", 0)])
def test_a_crop_in_a_prototype_of_a_point_instancer_is_a_finding(stage, where, count) -> None:
    """Oracle: volumes do not move with the instances if the crop is part of the prototype, at its
    root or below; one above the prototype is meant for the world."""
    forest = UsdGeom.PointInstancer.Define(stage, "/Forest")
    if where == "/Above":
        stage.DefinePrim("/Above", "Xform")
        Sdf.CopySpec(stage.GetRootLayer(), "/World", stage.GetRootLayer(), "/Above/World")
        stage.RemovePrim("/World")
    forest.GetPrototypesRel().AddTarget("/Above/World" if where == "/Above" else "/World")
    forest.GetProtoIndicesAttr().Set([0])
    forest.GetPositionsAttr().Set([(0, 0, 0)])
    crop(stage, where, "/Mattes/One", name="cropExclude")
    with Engine(stage) as engine:
        found = [each for each in engine.findings if each.path.endswith("A")]
    assert [each.code for each in found] == ["crop-member"] * count
