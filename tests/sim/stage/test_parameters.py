"""Tests of reading parameters from prims."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd

from tests.sim.stage.stages import make_stage, simulation_of
from usdsplat.core.errors import StageError
from usdsplat.core.knobs import Knob, knobs
from usdsplat.sim.parameters import GROUPS, INSTANCED, Parameters, camel
from usdsplat.sim.schema_source import usd_type
from usdsplat.sim.stage.parameters import instances, read, read_all, unread

ONE = Usd.TimeCode(1)
EVERY = [(group, item) for group, cls in {**GROUPS, **INSTANCED}.items() for item in knobs(cls)]


def other(item: Knob) -> Any:
    """A legal value that is not the default."""
    if item.choices is not None:
        return next(each for each in item.choices if each != item.default)
    if item.type is bool:
        return not item.default
    if item.type is str:
        return "other"
    if item.usd_type == "token[]":
        return ("a", "b/c")
    if item.usd_type in ("point3f[]", "color3f[]"):
        return ((0.1, 0.2, 0.3), (1.0, 2.0, 3.0))
    if isinstance(item.default, tuple):
        return tuple(part + 1 for part in item.default)
    low, high = item.range or (-np.inf, np.inf)
    ends = [end for end in (high, low) if np.isfinite(end) and end != item.default]
    return item.type(ends[0]) if ends else 7.25


@pytest.mark.parametrize(
    ("group", "item"), EVERY, ids=[f"{group}:{item.name}" for group, item in EVERY]
)
def test_what_is_authored_is_read_whether_usd_knows_the_type_or_not(group: str, item: Knob):
    """Oracle: the value that was written, at the top of its range where that has one."""
    stage = Usd.Stage.CreateInMemory()
    prim = stage.DefinePrim("/Prim", "NobodyKnowsThis")
    expected = other(item)
    name = f"splatSim:{group}:{camel(item.name)}"
    attribute = prim.CreateAttribute(name, Sdf.ValueTypeNames.Find(usd_type(item)))
    written: Any = expected
    if item.usd_type == "int3":
        written = Gf.Vec3i(*expected)
    elif isinstance(item.default, tuple) and not item.default:
        written = list(expected)
    elif item.usd_type == "asset":
        written = Sdf.AssetPath(expected)
    attribute.Set(written)
    cls = {**GROUPS, **INSTANCED}[group]
    found = read(prim, cls, f"splatSim:{group}", ONE)
    assert getattr(found, item.name) == expected
    assert found == cls(**{item.name: expected})


def test_what_nobody_says_is_the_default():
    """Oracle: the dataclasses' own defaults."""
    stage = make_stage()
    assert read_all(simulation_of(stage), ONE) == Parameters()


def test_samples_are_interpolated_and_uniform_ones_are_not():
    """Oracle: the line between two samples, and the default value."""
    stage = make_stage()
    prim = simulation_of(stage)
    for name in ("splatSim:rd:feed", "splatSim:sim:seed"):
        attribute = prim.GetAttribute(name) or prim.CreateAttribute(name, Sdf.ValueTypeNames.Float)
        attribute.Set(4 if name.endswith("seed") else 0.02, 1)
        attribute.Set(9 if name.endswith("seed") else 0.04, 11)
    prim.GetAttribute("splatSim:sim:seed").Set(5)
    found = read_all(prim, Usd.TimeCode(3.5))
    assert found.rd.feed == pytest.approx(0.025, abs=1e-8)
    assert found.sim.seed == 5
    (said,) = (each.message for each in unread(prim, tuple(GROUPS)))
    assert said.startswith("/World/Sim.splatSim:sim:seed: found samples over time")


@pytest.mark.parametrize(
    ("name", "kind", "wrong", "words"),
    [
        ("splatSim:rd:feed", "float", 0.2, "found 0.2, expected 0 to 0.1"),
        ("splatSim:rd:feed", "string", "x", "found 'x', expected 0 to 0.1"),
        ("splatSim:rd:preset", "token", "stripes", "found 'stripes', expected one of custom"),
        ("splatSim:sim:substeps", "int", 0, "found 0, expected 1 to 64"),
        ("splatSim:sim:substeps", "float", 2.5, "found 2.5, expected 1 to 64"),
        ("splatSim:particles:gravity", "float", 1.0, "expected"),
    ],
)
def test_a_wrong_value_is_one_sentence_with_the_attribute(name, kind, wrong, words):
    """Oracle: the sentence."""
    stage = Usd.Stage.CreateInMemory()
    prim = stage.DefinePrim("/Sim", "Plain")
    prim.CreateAttribute(name, Sdf.ValueTypeNames.Find(kind)).Set(wrong)
    with pytest.raises(StageError) as caught:
        read_all(prim, ONE)
    assert str(caught.value).startswith(f"/Sim.{name}: found ") and words in str(caught.value)


def test_what_nobody_reads_is_said_with_the_nearest_name():
    """Oracle: the sentences; what is read is not among them."""
    stage = make_stage()
    prim = simulation_of(stage)
    for name in (
        "splatSim:rd:fed",
        "splatSim:deform:a:anlge",
        "splatSim:deform:a:angle",
        "splatSim:driver:glow:amount",
        "splatSim:settle:omega",
        "splatSim:affector:friction",
        "somebody:else",
    ):
        prim.CreateAttribute(name, Sdf.ValueTypeNames.Float).Set(1.0)
    prim.CreateRelationship("splatSim:conform:target")
    prim.CreateRelationship("splatSim:deform:a:frame")
    said = [each.message for each in unread(prim, (*GROUPS, "deform", "driver"))]
    assert len(said) == 3
    assert any("splatSim:rd:fed" in each and "splatSim:rd:feed" in each for each in said)
    assert any("anlge: found" in each and "splatSim:deform:a:angle" in each for each in said)
    assert any(each.startswith("/World/Sim.splatSim:affector:friction") for each in said)


def test_instances_are_those_applied_and_those_with_attributes():
    """Oracle: by hand; a colon is part of a name."""
    stage = make_stage()
    prim = simulation_of(stage)
    prim.ApplyAPI("SplatDeformerAPI", "wave")
    prim.CreateAttribute("splatSim:deform:arm:left:angle", Sdf.ValueTypeNames.Float).Set(3.0)
    prim.CreateAttribute("splatSim:driver:glow:amount", Sdf.ValueTypeNames.Float).Set(1.0)
    assert instances(prim, "deform") == ["arm:left", "wave"]
    assert instances(prim, "driver") == ["glow"]
