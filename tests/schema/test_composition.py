"""Tests of findings about composition: missing layers and prims, units and axes."""

from __future__ import annotations

import pytest
from pxr import Gf, Usd, UsdGeom

from usdsplat.schema.composition import composition_findings


def found_in(stage):
    """Code and path of each finding."""
    return [(each.code, each.path) for each in composition_findings(stage)]


def test_each_arc_that_leads_nowhere_is_found_with_its_prim(tmp_path):
    """Oracle: the arcs authored here, one of each kind, and one inside an asset."""
    (tmp_path / "bad.usda").write_text("no layer")
    asset = Usd.Stage.CreateNew(str(tmp_path / "asset.usda"))
    asset.DefinePrim("/Asset/Part").GetReferences().AddReference("./gone.usda")
    asset.SetDefaultPrim(asset.GetPrimAtPath("/Asset"))
    asset.Save()
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    stage.DefinePrim("/Reference").GetReferences().AddReference("./none.usda")
    stage.DefinePrim("/Payload").GetPayloads().AddPayload("./none.usda")
    stage.DefinePrim("/Broken").GetReferences().AddReference("./bad.usda")
    stage.DefinePrim("/Inner").GetReferences().AddInternalReference("/Nowhere")
    stage.DefinePrim("/Path").GetReferences().AddReference("./asset.usda", "/Nowhere")
    stage.DefinePrim("/Cycle").GetReferences().AddInternalReference("/Cycle")
    stage.DefinePrim("/Good").GetReferences().AddReference("./asset.usda")
    stage.GetRootLayer().subLayerPaths.append("./none.usda")
    assert found_in(stage) == [
        ("missing-asset", "/"),
        ("missing-asset", "/Broken"),
        ("composition", "/Cycle"),
        ("missing-asset", "/Good/Part"),
        ("missing-prim", "/Inner"),
        ("missing-prim", "/Path"),
        ("missing-asset", "/Payload"),
        ("missing-asset", "/Reference"),
    ]
    assert not any("anon:" in each.message for each in composition_findings(stage))


@pytest.mark.parametrize(
    ("name", "command"),
    [("scan.ply", "usdsplat convert"), ("a.SOG", "usdsplat convert"), ("lod-meta.json", "lod")],
)
def test_a_reference_to_a_capture_says_what_makes_a_layer_of_it(tmp_path, name, command):
    """Oracle: the sentence, with the file and without it, as a reference and as a sublayer."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    stage.DefinePrim("/A").GetReferences().AddReference(f"./{name}")
    stage.GetRootLayer().subLayerPaths.append(f"./{name}")
    stage.Save()
    for _ in range(2):
        found = composition_findings(Usd.Stage.Open(str(tmp_path / "shot.usda")))
        assert [each.code for each in found] == ["missing-asset"] * 2
        assert all(f"{command} makes of it" in each.message for each in found), found
        (tmp_path / name).write_text("{}")


@pytest.fixture
def shot(tmp_path):
    """A shot in centimetres with Z up that refers to an asset in metres with Y up."""
    asset = Usd.Stage.CreateNew(str(tmp_path / "asset.usda"))
    UsdGeom.SetStageUpAxis(asset, "Y")
    UsdGeom.SetStageMetersPerUnit(asset, 1.0)
    UsdGeom.Sphere.Define(asset, "/Asset/Ball")
    asset.Save()
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    prim = UsdGeom.Xform.Define(stage, "/Set/Asset").GetPrim()
    prim.GetReferences().AddReference("./asset.usda", "/Asset")
    return stage


BOTH = [("axes-mismatch", "/Set/Asset"), ("units-mismatch", "/Set/Asset")]


def test_an_asset_of_another_unit_and_axis_is_found(shot):
    """Oracle: the metadata authored here; an asset without any is not judged."""
    assert sorted(found_in(shot)) == BOTH
    assert "a scale of 100" in composition_findings(shot)[0].expected
    other = Usd.Stage.CreateInMemory()
    UsdGeom.Sphere.Define(other, "/A")
    shot.DefinePrim("/Other").GetReferences().AddReference(other.GetRootLayer().identifier, "/A")
    assert sorted(found_in(shot)) == BOTH


@pytest.mark.parametrize("path", ["/Set/Asset", "/Set"])
def test_a_transform_that_corrects_it_is_recognised(shot, path):
    """Oracle: a scale by 100 and a quarter turn about X, on the prim or above it."""
    UsdGeom.Xform.Define(shot, "/Set")
    place = UsdGeom.Xformable(shot.GetPrimAtPath(path))
    turn = place.AddRotateXOp()
    turn.Set(90.0)
    assert found_in(shot) == BOTH[1:]
    place.AddScaleOp().Set(Gf.Vec3f(100))
    assert found_in(shot) == []
    turn.Set(-90.0)
    assert found_in(shot) == BOTH[:1]


def test_the_ops_of_metrics_assemblers_are_recognised(shot):
    """Oracle: the names that they have."""
    place = UsdGeom.Xformable(shot.GetPrimAtPath("/Set/Asset"))
    place.AddScaleOp(opSuffix="unitsResolve").Set(Gf.Vec3f(1))
    place.AddRotateXOp(opSuffix="unitsResolve").Set(0.0)
    assert found_in(shot) == []


def test_an_asset_in_an_instance_is_judged_too(shot):
    """Oracle: the metadata authored here; the asset is below a prim in a prototype."""
    for name in ("X", "Y"):
        prim = shot.DefinePrim(f"/{name}", "Xform")
        prim.GetReferences().AddInternalReference("/Set")
        prim.SetInstanceable(True)
    assert ("units-mismatch", "/X/Asset") in found_in(shot)


def test_opinions_below_an_instance_are_a_finding():
    """Oracle: USD's rule: only opinions on the instance itself apply."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.Sphere.Define(stage, "/Source/Ball")
    prim = stage.DefinePrim("/A", "Xform")
    prim.GetReferences().AddInternalReference("/Source")
    stage.OverridePrim("/A/Ball").GetAttribute("radius").Set(3.0)
    assert found_in(stage) == []
    prim.SetInstanceable(True)
    assert stage.GetPrimAtPath("/A/Ball").GetAttribute("radius").Get() == 1.0
    (found,) = composition_findings(stage)
    assert (found.code, found.path) == ("ignored-opinion", "/A")
    assert "Ball" in found.found
