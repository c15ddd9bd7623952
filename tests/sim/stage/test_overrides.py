"""Tests of parameter values from a command line."""

from __future__ import annotations

from typing import Any, Literal, get_args, get_origin

import pytest
from pxr import Usd, UsdGeom

from tests.sim.stage.stages import make_stage, simulation_of
from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.knobs import Knob, knobs
from usdsplat.sim.parameters import (
    GROUPS,
    INSTANCED,
    AffectorParameters,
    DeformParameters,
    DriverParameters,
    MaskParameters,
    camel,
)
from usdsplat.sim.stage.authoring import author
from usdsplat.sim.stage.overrides import override
from usdsplat.sim.stage.parameters import read, read_all

BALL = "/World/Ball"


def stage_with_all() -> Usd.Stage:
    """A simulation with a deformer and a driver, and an affector."""
    stage = make_stage()
    author(
        simulation_of(stage),
        {"deform:bow:angle": 10.0, "driver:glow:amount": 0.5, "mask:edge:size": 2.0},
    )
    author(UsdGeom.Sphere.Define(stage, BALL).GetPrim(), {"affector:friction": 0.1})
    return stage


def another(item: Knob) -> tuple[str, Any]:
    """A value that is not the default, as typed and as it is meant."""
    kind, default = item.type, item.default
    if get_origin(kind) is Literal:
        value = next(each for each in get_args(kind) if each != default)
        return value, value
    if get_origin(kind) is tuple:
        if get_args(kind)[0] is str:
            return "a,b", ("a", "b")
        if get_origin(get_args(kind)[0]) is tuple:
            return "1,2,3,4,5,6", ((1, 2, 3), (4, 5, 6))
        size = len(get_args(kind))
        return ",".join("3" for _ in range(size)), (3,) * size
    if kind is bool:
        return ("off", False) if default else ("on", True)
    if kind is str:
        return "weights", "weights"
    low, high = item.range or (0, 10)
    near = [low + 1, low + 0.25 * (high - low), high - 1, 2.0, 0.5, (low + high) / 2]
    fits = (each for each in near if low <= each <= high and abs(each) < 1e9)
    value = next(kind(round(each, 4)) for each in fits if kind(round(each, 4)) != default)
    return repr(value), value


SINGLE = [(group, item) for group, cls in GROUPS.items() for item in knobs(cls)]


@pytest.mark.parametrize(("group", "item"), SINGLE, ids=lambda each: getattr(each, "name", each))
def test_every_parameter_of_a_simulation_can_be_set(group: str, item: Knob) -> None:
    """Oracle: the value that was typed; the stage's files stay as they are."""
    stage = stage_with_all()
    before = stage.GetRootLayer().ExportToString()
    text, value = another(item)
    override(stage, f"{group}:{camel(item.name)}={text}")
    found = getattr(read_all(simulation_of(stage), Usd.TimeCode(7.0)), group)
    assert getattr(found, item.name) == value
    assert stage.GetRootLayer().ExportToString() == before


INSTANCES = {"affector": "", "deform": "bow:", "driver": "glow:", "mask": "edge:"}
NAMED = [
    (group, item)
    for group, cls in INSTANCED.items()
    for item in knobs(cls)
    if item.name != "points"
]
CLASSES = {
    "affector": AffectorParameters, "deform": DeformParameters, "driver": DriverParameters,
    "mask": MaskParameters,
}  # fmt: skip


@pytest.mark.parametrize(("group", "item"), NAMED, ids=lambda each: getattr(each, "name", each))
def test_every_parameter_of_a_part_can_be_set(group: str, item: Knob) -> None:
    """Oracle: the value that was typed."""
    stage = stage_with_all()
    text, value = another(item)
    override(stage, f"{group}:{INSTANCES[group]}{camel(item.name)}={text}")
    prim = stage.GetPrimAtPath(BALL) if group == "affector" else simulation_of(stage)
    lead = f"splatSim:{group}:{INSTANCES[group]}".rstrip(":")
    found = read(prim, CLASSES[group], lead, Usd.TimeCode(2.0))
    assert getattr(found, item.name) == value


def test_a_set_value_comes_before_samples() -> None:
    """Oracle: the value at every time, where the stage has others over time."""
    stage = stage_with_all()
    author(simulation_of(stage), {"rd:feed": 0.01}, time=1)
    author(simulation_of(stage), {"rd:feed": 0.05}, time=9)
    override(stage, "rd:feed=0.03")
    for time in (0, 1, 5, 9, 20):
        assert read_all(simulation_of(stage), Usd.TimeCode(time)).rd.feed == pytest.approx(0.03)


def test_one_prim_can_be_meant() -> None:
    """Oracle: the other simulation's and the other affector's own values."""
    stage = stage_with_all()
    stage.DefinePrim("/World/Sim2", "SplatSim")
    author(UsdGeom.Sphere.Define(stage, "/World/Ball2").GetPrim(), {"affector:friction": 0.1})
    override(stage, "/World/Sim2.sim:seed=8")
    override(stage, "/World/Ball2.affector:friction=0.75")
    now = Usd.TimeCode(1.0)
    assert read_all(simulation_of(stage), now).sim.seed == 0
    assert read_all(stage.GetPrimAtPath("/World/Sim2"), now).sim.seed == 8
    for path, value in ((BALL, 0.1), ("/World/Ball2", 0.75)):
        found = read(stage.GetPrimAtPath(path), AffectorParameters, "splatSim:affector", now)
        assert found.friction == pytest.approx(value)


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("", UsageError, "--set: found '', expected [/PRIM.]group:name=value"),
        ("rd:feed", UsageError, "expected [/PRIM.]group:name=value"),
        ("feed=1", UsageError, "expected [/PRIM.]group:name=value"),
        ("rd:fed=0.1", UsageError, "expected such as rd:feed"),
        ("nothing:at:all=1", UsageError, "parameter: found 'nothing:at:all'"),
        ("rd:feed=much", UsageError, "found 'much'"),
        ("rd:feed=0.2", UsageError, "found 0.2"),
        ("rd:feed=nan", UsageError, "found nan"),
        ("rd:feed=", UsageError, "found ''"),
        ("rd:preset=spotty", UsageError, "found 'spotty'"),
        ("sim:enabled=perhaps", UsageError, "found 'perhaps'"),
        ("sim:substeps=2.5", UsageError, "found '2.5'"),
        ("sim:substeps=0", UsageError, "found 0"),
        ("particles:gravity=1,2", UsageError, "particles:gravity"),
        ("particles:gravity=1,2,x", UsageError, "found '1,2,x'"),
        ("deform:angle=3", UsageError, "expected such as deform:"),
        ("deform:bow:points=1,2,3,4", UsageError, "deform:bow:points"),
        ("deform:arrow:angle=3", StageError, "found no deform 'arrow', expected one of bow"),
        ("driver:glow:colour=1,1,1", UsageError, "expected such as driver:glow:color"),
        ("/World/No.rd:feed=0.04", StageError, "found no SplatSim prim /World/No"),
        ("/World/Sim.affector:friction=0.5", StageError, "found no affector /World/Sim"),
    ],
)
def test_what_cannot_be_meant_is_one_sentence(text: str, error: type, words: str) -> None:
    """Oracle: the sentences; nothing is authored."""
    stage = stage_with_all()
    before = stage.GetSessionLayer().ExportToString()
    with pytest.raises(error) as caught:
        override(stage, text)
    said = str(caught.value)
    assert words in said
    assert "\n" not in said
    assert "expected" in said
    assert stage.GetSessionLayer().ExportToString() == before
