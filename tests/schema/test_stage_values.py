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
    may_move,
    metadata_problems,
    missing_ops,
    op_names,
    ordered_ops,
    parent_to_world,
    stage_unit,
    unknown_ops,
    up_axis,
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


def test_ops_without_a_meaning_or_an_attribute_are_found() -> None:
    """Oracle: written out by hand; USD leaves out an op without an attribute without an error."""
    stage = Usd.Stage.CreateInMemory()
    prim = UsdGeom.Xform.Define(stage, "/A")
    prim.AddTranslateOp()
    order = ["!resetXformStack!", "xformOp:translate", "!invert!xformOp:translate"]
    prim.GetXformOpOrderAttr().Set([*order, "xformOp:scale", "xformOp:bogus", "rubbish"])
    assert list(unknown_ops(prim.GetPrim())) == ["xformOp:bogus", "rubbish"]
    assert list(missing_ops(prim.GetPrim())) == ["xformOp:scale"]


@pytest.mark.parametrize(("authored", "axis"), [("Y", "Y"), ("Z", "Z"), ("X", "Y"), ("", "Y")])
def test_an_up_axis_that_usd_does_not_allow_counts_as_y(authored: str, axis: str) -> None:
    """Oracle: UsdGeom allows Y and Z, and its fallback is Y."""
    stage = Usd.Stage.CreateInMemory()
    stage.SetMetadata("upAxis", authored)
    assert up_axis(stage) == axis
    problems = dict(metadata_problems(stage))
    assert list(problems) == ([] if authored in ("Y", "Z") else ["bad-up-axis"])
    for problem in problems.values():
        assert str(problem).startswith(f"stage upAxis: found {authored!r}, expected Y")


@pytest.mark.parametrize(
    ("authored", "unit"),
    [(1.0, 1.0), (1e-9, 1e-9), (0.0, 0.01), (-1.0, 0.01), (math.inf, 0.01), (math.nan, 0.01)],
)
def test_a_unit_that_is_no_length_counts_as_a_centimetre(authored: float, unit: float) -> None:
    """Oracle: the fallback of metersPerUnit in USD."""
    stage = Usd.Stage.CreateInMemory()
    assert UsdGeom.GetStageMetersPerUnit(stage) == 0.01
    assert list(metadata_problems(stage)) == []
    stage.SetMetadata("metersPerUnit", authored)
    assert stage_unit(stage) == unit
    problems = dict(metadata_problems(stage))
    assert list(problems) == ([] if authored == unit else ["bad-meters-per-unit"])
    for problem in problems.values():
        expected = f"stage metersPerUnit: found {authored:g}, expected a positive number"
        assert str(problem).startswith(expected)


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


@pytest.mark.parametrize("which", ["local", "ops", "extents"])
def test_ops_that_usd_does_not_know_are_errors_of_ours(which) -> None:
    """Oracle: the error class, the prim and the op, for each function that evaluates ops."""
    stage = Usd.Stage.CreateInMemory()
    prim = UsdGeom.Xform.Define(stage, "/A/B").GetPrim()
    UsdGeom.Cube.Define(stage, "/A/B/Box").CreateExtentAttr([(-1, -1, -1), (1, 1, 1)])
    model = UsdGeom.ModelAPI.Apply(stage.GetPrimAtPath("/A"))
    prim.CreateAttribute("xformOp:wrong", Sdf.ValueTypeNames.Double3).Set((1, 2, 3))
    UsdGeom.Xformable(prim).GetXformOpOrderAttr().Set(["xformOp:wrong"])
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"])
    ask = {
        "local": lambda: local_transform(prim, Usd.TimeCode.Default()),
        "ops": lambda: ordered_ops(prim),
        "extents": lambda: extents_hint(model, cache),
    }[which]
    with pytest.raises(StageError, match=r"^/A/B.xformOpOrder: found 'xformOp:wrong'"):
        ask()


def test_an_order_of_another_type_has_no_ops() -> None:
    """Oracle: USD reads the order as an array of tokens only."""
    stage = Usd.Stage.CreateInMemory()
    prim = stage.DefinePrim("/A", "Xform")
    spec = stage.GetRootLayer().GetPrimAtPath("/A")
    Sdf.AttributeSpec(spec, "xformOpOrder", Sdf.ValueTypeNames.Int).default = 3
    assert op_names(prim) == []
    assert list(unknown_ops(prim)) == []
    assert not may_move(prim)


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
