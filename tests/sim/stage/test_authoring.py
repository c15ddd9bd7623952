"""Tests of authoring parameters on prims."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.sim.stage.stages import make_stage, simulation_of
from usdsplat.core.errors import UsageError
from usdsplat.core.knobs import knobs
from usdsplat.sim.parameters import GROUPS, INSTANCED, NAMED, BakeParameters, camel
from usdsplat.sim.stage.authoring import author, relate
from usdsplat.sim.stage.parameters import read, read_all

ONE = Usd.TimeCode(1)


def test_what_is_read_hangs_on_no_print_options() -> None:
    """Oracle: the value, which six digits do not hold."""
    stage = make_stage(3)  # its prims live as long as it does
    prim = simulation_of(stage)
    author(prim, {"bake:opacityEpsilon": 1 / 512})
    with np.printoptions(legacy="1.13", precision=3):
        found = read(prim, BakeParameters, "splatSim:bake", ONE)
    assert found.opacity_epsilon == 1 / 512


@pytest.mark.parametrize("group", [*GROUPS, *INSTANCED])
def test_what_is_written_is_read(group: str) -> None:
    """Oracle: the defaults, all of them written, with the types that the schema declares."""
    stage = make_stage(3)
    prim = simulation_of(stage)
    if group == "affector":
        prim = UsdGeom.Sphere.Define(stage, "/World/Ball").GetPrim()
    lead = f"{group}:x:" if group in NAMED else f"{group}:"
    cls = {**GROUPS, **INSTANCED}[group]
    author(prim, {f"{lead}{camel(item.name)}": item.default for item in knobs(cls)})
    assert read(prim, cls, f"splatSim:{lead}"[:-1], ONE) == cls()
    for item in knobs(cls):
        attribute = prim.GetAttribute(f"splatSim:{lead}{camel(item.name)}")
        assert attribute.HasAuthoredValue() and attribute.GetPrim().GetPrimDefinition()
        declared = prim.GetPrimDefinition().GetSchemaAttributeSpec(attribute.GetName())
        assert declared and declared.typeName == attribute.GetTypeName()
        assert not attribute.IsCustom()


def test_samples_and_relationships() -> None:
    """Oracle: half-way between two samples; the schema's relationship."""
    stage = make_stage(3)
    sim = simulation_of(stage)
    author(sim, {"settle:omega": 2.0}, time=1)
    author(sim, {"settle:omega": 4.0}, time=3)
    assert read_all(sim, Usd.TimeCode(2)).settle.omega == 3
    relate(sim, "deform:bend:frame", stage.GetPrimAtPath("/World"))
    relate(sim, "conform:target", stage.GetPrimAtPath("/World"))
    assert sim.HasAPI("SplatDeformerAPI", "bend") and sim.HasAPI("SplatSimConformAPI")
    found = sim.GetRelationship("splatSim:deform:bend:frame")
    assert found.GetTargets() == [Sdf.Path("/World")] and not found.IsCustom()


@pytest.mark.parametrize(
    ("name", "value", "time", "words"),
    [
        ("rd:patternscale", 1.0, None, "'rd:patternscale', expected such as rd:patternScale"),
        ("deform:angle", 1.0, None, "'deform:angle', expected such as deform:NAME:angle"),
        ("deform:a:angel", 1.0, None, "'deform:a:angel', expected such as deform:a:angle"),
        ("x", 1.0, None, "'x', expected a name in sim, neighbors"),
        ("rd:feed", 0.2, None, "found 0.2, expected 0 to 0.1"),
        ("sim:seed", 2, 1.0, "sim:seed: found a value at 1, expected one value for all times"),
    ],
)
def test_what_cannot_be_written_is_one_sentence(name, value, time, words) -> None:
    """Oracle: the sentences."""
    stage = make_stage(3)
    with pytest.raises(UsageError) as caught:
        author(simulation_of(stage), {name: value}, time=time)
    assert words in str(caught.value)
