"""Tests of findings on grades and crops that captures do not have."""

from __future__ import annotations

import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.schema.clouds import cloud
from usdsplat import schema
from usdsplat.interchange import export_capture, export_each
from usdsplat.interchange.unapplied import unapplied


@pytest.fixture
def stage() -> Usd.Stage:
    """Two fields below a prim, and a sphere."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, "Y")
    for name in ("A", "B"):
        schema.author(stage, f"/World/{name}", cloud(n=3))
    UsdGeom.Sphere.Define(stage, "/Matte")
    return stage


def crop(stage: Usd.Stage, path: str, *members: str) -> None:
    """Author a crop with these members."""
    crops = Usd.CollectionAPI.Apply(stage.GetPrimAtPath(path), "cropExclude")
    crops.CreateIncludesRel().SetTargets(list(members))


def found(stage: Usd.Stage) -> list[tuple[str, str]]:
    """Path and what was found of each finding on the fields."""
    fields = [prim for prim in stage.Traverse() if schema.is_splat_field(prim)]
    return [(each.path, each.found) for each in unapplied(fields, None)]


def test_only_what_acts_is_a_finding(stage) -> None:
    """Oracle: a neutral grade and a crop without members change nothing."""
    schema.author_grade(stage.GetPrimAtPath("/World/A"), exposure=0.0)
    crop(stage, "/World", "/Missing")
    assert found(stage) == []
    schema.author_grade(stage.GetPrimAtPath("/World/A"), exposure=1.0)
    assert found(stage) == [("/World/A", "a grade")]
    crop(stage, "/World", "/Matte")
    assert found(stage) == [("/World/A", "a grade and a crop"), ("/World/B", "a crop")]


def test_an_inherited_grade_and_an_illegal_one_are_found(stage) -> None:
    """Oracle: each field below the graded prim."""
    schema.author_grade(stage.GetPrimAtPath("/World"), gain=(2.0, 1.0, 1.0))
    expected = [("/World/A", "a grade"), ("/World/B", "a grade")]
    assert found(stage) == expected
    stage.GetPrimAtPath("/World").GetAttribute("splat:grade:gain").Set((float("nan"), 1, 1))
    assert found(stage) == expected


def test_light_of_a_field_is_found(stage) -> None:
    """Oracle: SplatLightingAPI of each field; captured light is that of a capture."""
    for name, mode in (("A", "relit"), ("B", "captured")):
        prim = stage.GetPrimAtPath(f"/World/{name}")
        prim.CreateAttribute("splat:lighting", Sdf.ValueTypeNames.Token).Set(mode)
    assert found(stage) == [("/World/A", "another light")]
    stage.GetPrimAtPath("/World/B").GetAttribute("splat:lighting").Set("shadowed")
    schema.author_grade(stage.GetPrimAtPath("/World/B"), exposure=1.0)
    assert found(stage)[1] == ("/World/B", "a grade and shadows of lights")
    fields = [stage.GetPrimAtPath(f"/World/{name}") for name in "AB"]
    alone, graded = (each.cure for each in unapplied(fields, None))
    assert alone.startswith("relight") and "--crop-box" in graded


@pytest.mark.parametrize("export", [export_capture, export_each])
def test_each_export_reports_them(stage, tmp_path, export) -> None:
    """Oracle: the exported field alone, with the code; the other field is not exported."""
    schema.author_grade(stage.GetPrimAtPath("/World"), exposure=1.0)
    report = export(stage, tmp_path / "out.ply", prim_path="/World/B")
    assert [(each.code, each.path) for each in report.findings] == [("not-applied", "/World/B")]
