"""Tests of findings on attributes with another type than the schema's."""

from __future__ import annotations

import pytest
from pxr import Gf, Sdf, Usd, Vt

from tests.schema.clouds import cloud
from usdsplat import schema
from usdsplat.schema import tokens, validate

SH = tokens.SH_COEFFICIENTS

WRONG_VALUES = {
    "string": "x",
    "float": 1.5,
    "string[]": Vt.StringArray(["x", "y"]),
    "float[]": Vt.FloatArray([1, 2, 3]),
    "int[]": Vt.IntArray([1, 2, 3]),
    "double3[]": Vt.Vec3dArray([(1, 2, 3)] * 20),
    "quatf[]": Vt.QuatfArray([Gf.Quatf(1, 0, 0, 0)] * 20),
    "matrix4d[]": Vt.Matrix4dArray(2),
}
TYPES = {
    "float": {
        "positions": "point3f[]",
        "orientations": "quatf[]",
        "scales": "float3[]",
        "opacities": "float[]",
        SH: "float3[]",
        tokens.SH_DEGREE: "int",
        "ids": "int64[]",
        "velocities": "vector3f[]",
        "extent": "float3[]",
    },
    "half": {
        "orientationsh": "quath[]",
        "scalesh": "half3[]",
        "opacitiesh": "half[]",
        SH + "h": "half3[]",
    },
    "packed": {
        "positions": "point3f[]",
        tokens.PACKED: "int4[]",
        tokens.COLOR_RANGE: "float3[]",
        tokens.PACKED_HARMONICS: "int4[]",
        tokens.HARMONICS_RANGE: "float[]",
        tokens.SH_DEGREE: "int",
        "ids": "int64[]",
        "velocities": "vector3f[]",
        "extent": "float3[]",
    },
}
MISTYPED = [
    (form, attribute, expected, wrong)
    for form, types in TYPES.items()
    for attribute, expected in types.items()
    for wrong in WRONG_VALUES
    if wrong != expected
]


def mistype(prim: Usd.Prim, attribute: str, kind: str) -> None:
    """Say in the layer that an attribute has another type, with a value of that type."""
    prim.RemoveProperty(attribute)
    spec = prim.GetPrimStack()[0]
    wrong = Sdf.AttributeSpec(spec, attribute, Sdf.GetValueTypeNameForValue(WRONG_VALUES[kind]))
    wrong.default = WRONG_VALUES[kind]


@pytest.mark.parametrize(("form", "attribute", "expected", "wrong"), MISTYPED)
def test_a_wrong_type_is_all_that_is_said_of_an_attribute(
    stage: Usd.Stage, form: str, attribute: str, expected: str, wrong: str
) -> None:
    """Oracle: the types in usdVol's schema, and in ours."""
    prim = schema.author(stage, "/Splats", cloud(n=20, moving=True), form=form)
    mistype(prim, attribute, wrong)
    (finding,) = (f for f in validate(stage) if f.attribute == attribute)
    assert (finding.severity, finding.code) == ("error", "wrong-type")
    assert finding.found == ("double" if wrong == "float" else wrong)
    assert finding.expected == expected
    names = {f.code for f in validate(stage) if f.path == "/Splats"}
    assert names <= {"wrong-type", "half-only"}


@pytest.mark.parametrize("kind", WRONG_VALUES)
@pytest.mark.parametrize(
    "attribute", ["colorSpace:name", tokens.PACKING, tokens.RASTERIZE_MODE, "sortingModeHint"]
)
def test_a_token_of_a_wrong_type_ends_in_findings(
    stage: Usd.Stage, attribute: str, kind: str
) -> None:
    """Oracle: the finding about a token that nobody knows; nothing is raised."""
    prim = schema.author(stage, "/Splats", cloud(n=5), form="packed")
    mistype(prim, attribute, kind)
    known = {"colorSpace:name": "unknown-color-space", tokens.PACKING: "unknown-packing"}
    names = [f.code for f in validate(stage) if f.path == "/Splats"]
    assert names == [known.get(attribute, "unknown-mode")]


def test_roles_of_vectors_may_differ(stage: Usd.Stage) -> None:
    """Oracle: point3f and float3 are the same numbers in memory."""
    prim = schema.author(stage, "/Splats", cloud(n=5))
    value = prim.GetAttribute("positions").Get()
    prim.RemoveProperty("positions")
    spec = Sdf.AttributeSpec(prim.GetPrimStack()[0], "positions", Sdf.ValueTypeNames.Float3Array)
    spec.default = value
    assert [f for f in validate(stage) if f.path == "/Splats"] == []
