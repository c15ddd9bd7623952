"""Tests of findings on values of fields that are drawn, and only of those."""

from __future__ import annotations

import pytest
from pxr import UsdGeom

from tests.delegate.scene_delegate.test_crops import crop
from tests.delegate.stages import two_fields
from usdsplat import schema
from usdsplat.delegate.engine import Engine


def found_in(stage):
    """Code and path of each finding of an engine."""
    with Engine(stage) as engine:
        return [(each.code, each.path) for each in engine.findings]


@pytest.mark.parametrize(
    ("name", "value", "code"),
    [
        ("opacities", [1.5] * 12, "opacity-range"),
        ("opacities", [0.5] * 3, "too-short"),
        ("sortingModeHint", "nearest", "unknown-mode"),
        ("splat:sampling:footprint", -1.0, "unknown-mode"),
        ("splat:sampling:footprint", float("inf"), "unknown-mode"),
        ("radiance:sphericalHarmonicsDegree", 3, "coefficient-count"),
    ],
)
def test_what_drawing_hides_is_a_finding_as_in_validate(name, value, code) -> None:
    """Oracle: `schema.validate` on the same stage, word by word."""
    stage = two_fields()
    stage.GetPrimAtPath("/World/A").GetAttribute(name).Set(value)
    expected = [each for each in schema.validate(stage) if each.code == code]
    assert len(expected) == 1
    with Engine(stage) as engine:
        assert [each for each in engine.findings if each.code == code] == expected


def test_an_op_without_an_attribute_is_left_out_and_said_as_in_validate() -> None:
    """Oracle: `schema.validate`, word by word, and UsdGeom's rule: the other ops place the prim."""
    stage = two_fields()
    prim = stage.GetPrimAtPath("/World/A")
    UsdGeom.Xformable(prim).AddTranslateOp().Set((5, 0, 0))
    order = prim.GetAttribute("xformOpOrder")
    order.Set([*order.Get(), "xformOp:rotateXYZ"])
    expected = [each for each in schema.validate(stage) if each.code == "missing-op"]
    assert [(each.path, each.found) for each in expected] == [("/World/A", "'xformOp:rotateXYZ'")]
    with Engine(stage) as engine:
        assert [each for each in engine.findings if each.code == "missing-op"] == expected
        (instance,) = (each for path, _, each in engine.render_scene.drawn() if path == "/World/A")
    assert instance.transform[3] == 5


def test_what_is_hidden_or_a_guide_is_not_judged() -> None:
    """Oracle: each of three mistakes is found, and is not once the field is not drawn."""
    stage = two_fields()
    prim = stage.GetPrimAtPath("/World/A")
    prim.GetAttribute("opacities").Set([-1.0] * 12)
    UsdGeom.Xformable(prim).AddTranslateOp().Set((float("nan"), 0, 0))
    stage.DefinePrim("/Mattes/None", "Mesh")
    crop(stage, "/World/A", "/Mattes/None")
    assert {path for _, path in found_in(stage)} == {"/World/A"}
    assert {"bad-transform", "crop-member"} <= {code for code, _ in found_in(stage)}
    UsdGeom.Imageable(prim).GetPurposeAttr().Set("guide")
    assert found_in(stage) == []
    UsdGeom.Imageable(prim).GetPurposeAttr().Set("default")
    UsdGeom.Imageable(prim).MakeInvisible()
    assert found_in(stage) == []
