"""Tests of values of a stage that may be anything."""

from __future__ import annotations

import math

import pytest
from pxr import Gf, Sdf, Usd, UsdGeom

from usdsplat.core.errors import StageError
from usdsplat.schema.stage_values import (
    are_finite,
    extents_hint,
    in_world,
    local_to_ancestor,
    local_to_world,
    local_transform,
    ops_of,
    parent_to_world,
    unknown_ops,
    up_axis,
    up_axis_problem,
    world_bound,
)

STAGE = """#usda 1.0
def Xform "Good"
{
    double3 xformOp:translate = (1, 2, 3)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Xform "Bad"
    {
        uniform token[] xformOpOrder = ["!resetXformStack!", "xformOp:wobble:x"]
        def Sphere "Ball"
        {
        }
    }
    def Sphere "Ball"
    {
    }
}
"""


@pytest.fixture
def stage() -> Usd.Stage:
    """A prim with an op that USD does not know, below one with a known op."""
    made = Usd.Stage.CreateInMemory()
    made.GetRootLayer().ImportFromString(STAGE)
    return made


def test_a_known_op_gives_usds_own_transform(stage: Usd.Stage) -> None:
    """Oracle: the translation that is authored."""
    ball, cache = stage.GetPrimAtPath("/Good/Ball"), UsdGeom.XformCache()
    for matrix in (
        local_to_world(ball, cache),
        parent_to_world(ball, cache),
        local_to_ancestor(ball, stage.GetPseudoRoot(), cache),
    ):
        assert matrix.ExtractTranslation() == Gf.Vec3d(1, 2, 3)


def test_an_unknown_op_is_an_error_that_names_the_prim_with_the_op(stage: Usd.Stage) -> None:
    """Oracle: the path and the word that are authored, wherever USD meets them."""
    ball, cache = stage.GetPrimAtPath("/Good/Bad/Ball"), UsdGeom.XformCache()
    sentence = r"/Good/Bad\.xformOpOrder: found 'xformOp:wobble:x', expected transform ops"
    for asked in (
        lambda: local_to_world(ball, cache),
        lambda: parent_to_world(ball, cache),
        lambda: local_to_ancestor(ball, stage.GetPseudoRoot(), cache),
        lambda: world_bound(stage.GetPrimAtPath("/Good"), UsdGeom.BBoxCache(0, ["default"])),
    ):
        with pytest.raises(StageError, match=sentence):
            asked()


def test_the_ops_of_a_prim_are_usds_or_an_error(stage: Usd.Stage) -> None:
    """Oracle: the ops that are authored; a sphere without ops and a scope have none."""
    assert [op.GetOpName() for op in ops_of(stage.GetPrimAtPath("/Good"))] == ["xformOp:translate"]
    assert ops_of(stage.GetPrimAtPath("/Good/Ball")) == []
    assert ops_of(stage.DefinePrim("/Scope", "Scope")) == []
    bad = stage.GetPrimAtPath("/Good/Bad")
    bad.CreateAttribute("xformOp:wobble:x", Sdf.ValueTypeNames.Double).Set(1.0)
    model, cache = UsdGeom.ModelAPI(stage.GetPrimAtPath("/Good")), UsdGeom.BBoxCache(0, ["default"])
    for asked in (
        lambda: ops_of(bad),
        lambda: local_transform(bad, Usd.TimeCode.Default()),
        lambda: extents_hint(model, cache),
    ):
        with pytest.raises(StageError, match=r"/Good/Bad\.xformOpOrder: found 'xformOp:wobble:x'"):
            asked()


def test_ops_without_a_meaning_or_an_attribute_are_found() -> None:
    """Oracle: written out by hand; USD leaves out an op without an attribute without an error."""
    stage = Usd.Stage.CreateInMemory()
    prim = UsdGeom.Xform.Define(stage, "/A")
    prim.AddTranslateOp()
    order = ["!resetXformStack!", "xformOp:translate", "!invert!xformOp:translate"]
    prim.GetXformOpOrderAttr().Set([*order, "xformOp:scale", "xformOp:bogus", "rubbish"])
    assert list(unknown_ops(prim.GetPrim())) == ["xformOp:scale", "xformOp:bogus", "rubbish"]


@pytest.mark.parametrize(("authored", "axis"), [("Y", "Y"), ("Z", "Z"), ("X", "Y"), ("", "Y")])
def test_an_up_axis_that_usd_does_not_allow_counts_as_y(authored: str, axis: str) -> None:
    """Oracle: UsdGeom allows Y and Z, and its fallback is Y."""
    stage = Usd.Stage.CreateInMemory()
    stage.SetMetadata("upAxis", authored)
    assert up_axis(stage) == axis
    problem = up_axis_problem(stage)
    assert (problem is None) == (authored in ("Y", "Z"))
    assert problem is None or str(problem).startswith(
        f"stage upAxis: found {authored!r}, expected Y"
    )


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (1, True),
        (math.nan, False),
        (Gf.Vec4f(0, 0, 1, math.inf), False),
        (Gf.Matrix4d(1), True),
        (Gf.Matrix4d(math.nan), False),
    ],
)
def test_numbers_that_are_not_finite_are_found_in_any_value(value: object, expected: bool) -> None:
    """Oracle: written out by hand."""
    assert are_finite(value) == expected


def test_equal_instances_are_seen_once() -> None:
    """Oracle: written out by hand; what is below the first of two instances, also of nested ones,
    and each prim that is an instance."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.Sphere.Define(stage, "/Ball/Sphere")
    stage.DefinePrim("/Pair")
    for name in ("Left", "Right"):
        ball = stage.DefinePrim(f"/Pair/{name}")
        ball.GetReferences().AddInternalReference("/Ball")
        ball.SetInstanceable(True)
        pair = stage.DefinePrim(f"/{name}")
        pair.GetReferences().AddInternalReference("/Pair")
        pair.SetInstanceable(True)
    stage.OverridePrim("/Ball").SetActive(True)
    found = [str(prim.GetPath()) for prim in in_world(stage)]
    below = [path for path in found if path.endswith("Sphere")]
    assert below == ["/Ball/Sphere", "/Pair/Left/Sphere"]
    assert {"/Pair/Right", "/Left", "/Right", "/Left/Right"} <= set(found)
