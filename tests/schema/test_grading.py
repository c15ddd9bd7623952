"""Tests of reading and writing SplatGradeAPI."""

from __future__ import annotations

from typing import Any

import pytest
from pxr import Gf, Sdf, Usd

from tests.schema.clouds import cloud
from usdsplat import schema
from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.grade import Grade
from usdsplat.schema import tokens

VALUES: dict[str, Any] = {
    "exposure": 0.5,
    "temperature": 4500.0,
    "tint": 0.0078125,
    "gain": (1.5, 1.0, 0.75),
    "saturation": 1.25,
    "matrix": (1.0, 0.5, 0.25, 0.0, 1.0, 0.125, 0.0, 0.0, 0.75),
}


def declared() -> Any:
    """USD's definition of the API schema."""
    return Usd.SchemaRegistry().FindAppliedAPIPrimDefinition(tokens.GRADE_API)


def test_the_schema_declares_what_is_read() -> None:
    """Oracle: USD's own registry."""
    assert set(declared().GetPropertyNames()) == schema.GRADE_ATTRIBUTES


def test_the_schema_s_fallbacks_are_the_neutral_grade(stage: Usd.Stage) -> None:
    """Oracle: the defaults of `Grade`; nothing is authored."""
    prim = schema.author(stage, "/Splats", cloud())
    prim.AddAppliedSchema(tokens.GRADE_API)
    for name, value in (
        (tokens.GRADE_EXPOSURE, 0.0),
        (tokens.GRADE_TEMPERATURE, 6504.0),
        (tokens.GRADE_TINT, 0.0),
        (tokens.GRADE_GAIN, Gf.Vec3f(1)),
        (tokens.GRADE_SATURATION, 1.0),
        (tokens.GRADE_MATRIX, Gf.Matrix3d(1)),
    ):
        assert prim.GetAttribute(name).Get() == value
    assert schema.grade(prim) == Grade()


@pytest.mark.parametrize("form", ["float", "packed"])
def test_what_is_written_is_read(stage: Usd.Stage, form: Any) -> None:
    """Oracle: the values themselves, exact in float32."""
    prim = schema.author(stage, "/Splats", cloud(), form=form)
    schema.author_grade(prim, **VALUES)
    assert prim.HasAPI(tokens.GRADE_API)
    assert not any(prim.GetAttribute(name).IsCustom() for name in schema.GRADE_ATTRIBUTES)
    assert schema.grade(prim) == Grade(**VALUES)


def test_the_matrix_is_for_row_vectors_on_the_stage(stage: Usd.Stage) -> None:
    """Oracle: Gf's own product of a row vector and a matrix."""
    prim = schema.author(stage, "/Splats", cloud())
    schema.author_grade(prim, matrix=VALUES["matrix"])
    stored = prim.GetAttribute(tokens.GRADE_MATRIX).Get()
    assert Gf.Vec3d(0, 1, 0) * stored == Gf.Vec3d(0.5, 1.0, 0.0)


def test_only_what_is_given_is_written(stage: Usd.Stage) -> None:
    """Oracle: the authored properties."""
    prim = schema.author(stage, "/Splats", cloud())
    schema.author_grade(prim, exposure=1.0)
    authored = [name for name in schema.GRADE_ATTRIBUTES if prim.GetAttribute(name).IsAuthored()]
    assert authored == [tokens.GRADE_EXPOSURE]


def test_a_grade_may_be_animated(stage: Usd.Stage) -> None:
    """Oracle: USD's linear interpolation; without a time the first sample."""
    prim = schema.author(stage, "/Splats", cloud())
    assert not schema.is_grade_varying(prim)
    schema.author_grade(prim, time=1.0, exposure=0.0)
    schema.author_grade(prim, time=3.0, exposure=2.0)
    assert schema.is_grade_varying(prim)
    assert not schema.is_time_varying(prim)
    assert schema.grade(prim, 2.0).exposure == 1.0
    assert schema.grade(prim).exposure == 0.0
    schema.author_grade(prim, exposure=0.5)
    assert schema.grade(prim, 3.0).exposure == 0.5


def test_values_out_of_range_are_refused_in_both_directions(stage: Usd.Stage) -> None:
    """Oracle: the documented range."""
    prim = schema.author(stage, "/Splats", cloud())
    with pytest.raises(UsageError, match="/Splats splat:grade:temperature: found 10"):
        schema.author_grade(prim, temperature=10.0)
    assert not prim.HasAPI(tokens.GRADE_API)
    schema.author_grade(prim, temperature=5000.0)
    prim.GetAttribute(tokens.GRADE_TEMPERATURE).Set(10.0)
    with pytest.raises(StageError, match="/Splats splat:grade:temperature: found 10"):
        schema.grade(prim)


@pytest.mark.parametrize("name", [tokens.GRADE_EXPOSURE, tokens.GRADE_GAIN, tokens.GRADE_MATRIX])
def test_a_value_of_another_type_is_refused(stage: Usd.Stage, name: str) -> None:
    """Oracle: the type in the schema."""
    prim = schema.author(stage, "/Splats", cloud())
    prim.CreateAttribute(name, Sdf.ValueTypeNames.String).Set("warmer")
    with pytest.raises(StageError, match="found a value of type string"):
        schema.grade(prim)


@pytest.mark.parametrize(
    ("kind", "allowed"), [("ParticleField", True), ("Xform", True), ("Mesh", False)]
)
def test_it_applies_to_fields_and_models(stage: Usd.Stage, kind: str, allowed: bool) -> None:
    """Oracle: USD's CanApplyAPI."""
    prim = stage.DefinePrim("/Prim", kind)
    assert bool(prim.CanApplyAPI(tokens.GRADE_API)) == allowed


def test_a_wrong_inherited_value_is_reported_at_the_prim_that_has_it(stage: Usd.Stage) -> None:
    """Oracle: the paths of the prims with the values; the field's own value is legal."""
    prim = schema.author(stage, "/World/Splats", cloud())
    schema.author_grade(prim, exposure=1.0)
    above = stage.GetPrimAtPath("/World")
    above.CreateAttribute(tokens.GRADE_SATURATION, Sdf.ValueTypeNames.Float).Set(-1.0)
    with pytest.raises(StageError, match=r"^/World splat:grade:saturation: found -1"):
        schema.grade(prim)
    above.GetAttribute(tokens.GRADE_SATURATION).Set(1.0)
    prim.GetAttribute(tokens.GRADE_EXPOSURE).Set(100.0)
    with pytest.raises(StageError, match=r"^/World/Splats splat:grade:exposure: found 100"):
        schema.grade(prim)


def test_validate_reports_a_wrong_inherited_value_once(stage: Usd.Stage) -> None:
    """Oracle: one finding at the prim that has the value, for two fields below it."""
    for name in ("A", "B"):
        schema.author(stage, f"/World/{name}", cloud())
    above = stage.GetPrimAtPath("/World")
    above.CreateAttribute(tokens.GRADE_SATURATION, Sdf.ValueTypeNames.Float).Set(-1.0)
    wrong = [each for each in schema.validate(stage) if each.code == "illegal-grade"]
    assert [(each.path, each.attribute) for each in wrong] == [("/World", "splat:grade:saturation")]
