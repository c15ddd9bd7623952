"""Tests of mapping findings to published rules."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from tests.schema.clouds import cloud
from tests.schema.validation.test_validation import STOCK_FAULTS
from usdsplat import schema
from usdsplat.schema import tokens, validate

KEPT = {
    ("too-short", "ids"),
    ("too-short", "velocities"),
    ("not-finite", "positions"),
    ("not-finite", tokens.SH_COEFFICIENTS),
    ("not-finite", "velocities"),
    ("repeated-ids", "ids"),
    ("extent-size", "extent"),
    ("extent-too-small", "extent"),
    ("no-color-space", "colorSpace:name"),
    ("unknown-color-space", "colorSpace:name"),
}
"""Faults that VG.035 passes."""


def vg035(prim: Usd.Prim) -> bool:
    """Whether the prim keeps the rule, as its text has it and nothing of ours."""
    value = {
        name: prim.GetAttribute(name).Get() if prim.GetAttribute(name) else None
        for name in (*tokens.HALF_OF, tokens.SH_DEGREE, "extent")
    }
    if any(each is None for each in value.values()):
        return False
    count = len(value["positions"])
    if not count or {len(value[n]) for n in ("scales", "orientations", "opacities")} != {count}:
        return False
    harmonics = UsdGeom.Primvar(prim.GetAttribute(tokens.SH_COEFFICIENTS))
    degree, size = value[tokens.SH_DEGREE], harmonics.GetElementSize()
    lengths = np.array([q.GetLength() for q in value["orientations"]])
    opacities = np.array(value["opacities"])
    return bool(
        degree in (0, 1, 2, 3)
        and size == (degree + 1) ** 2
        and harmonics.GetInterpolation() == "vertex"
        and len(value[tokens.SH_COEFFICIENTS]) == count * size
        and (np.array(value["scales"]) > 0).all()
        and ((opacities >= 0) & (opacities <= 1)).all()
        and not (np.abs(lengths - 1) > 1e-3).any()
    )


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_stock_float_fields_keep_the_rule(stage: Usd.Stage, degree: int) -> None:
    """Oracle: the rule's text, written down again in this file."""
    prim = schema.author(stage, "/Splats", cloud(n=20, degree=degree))
    assert vg035(prim)
    assert schema.broken_rules(prim) == []


@pytest.mark.parametrize(("name", "severity", "attribute", "spoil"), STOCK_FAULTS)
def test_a_fault_names_the_rule_that_it_breaks(stage, name, severity, attribute, spoil) -> None:
    """Oracle: the rule's text, written down again in this file, and what that leaves alone."""
    prim = schema.author(stage, "/Splats", cloud(n=20, moving=True))
    spoil(prim)
    rules = {f.code: f.rule for f in validate(stage)}
    assert rules[name] == ("" if (name, attribute) in KEPT else "VG.035")
    assert vg035(prim) == ((name, attribute) in KEPT)


def test_half_and_degree_four_are_said_to_break_the_rule(stage: Usd.Stage) -> None:
    """Oracle: the rule's text, written down again in this file; what is packed it does not ask."""
    half = schema.author(stage, "/Half", cloud(n=20), form="half")
    (said,) = schema.broken_rules(half)
    assert said.startswith("NVIDIA's rule VG.035") and "scalesh" in said and not vg035(half)
    deep = schema.author(stage, "/Deep", cloud(n=20, degree=4))
    (said,) = schema.broken_rules(deep)
    assert "found 4, expected at most 3" in said and not vg035(deep)
    moving = schema.author(stage, "/Moving", cloud(n=20, degree=4), time=7.0)
    assert len(schema.broken_rules(moving)) == len(schema.broken_rules(moving, 7.0)) == 1
    packed = schema.author(stage, "/Packed", cloud(n=20, degree=4), form="packed")
    assert schema.broken_rules(packed) == []
