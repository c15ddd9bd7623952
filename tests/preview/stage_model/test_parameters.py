"""Tests of the parameters of simulations and affectors in a panel."""

from __future__ import annotations

import json
import math
from dataclasses import asdict

import pytest
from pxr import Sdf, Usd

from tests.preview.stage_model.stages import rich
from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.knobs import knobs
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.stage_model.main_parameters import MAIN
from usdsplat.preview.stage_model.parameters import edit_parameter, editors, set_parameter
from usdsplat.sim.parameters import GROUPS, INSTANCED
from usdsplat.sim.stage.authoring import author
from usdsplat.sim.stage.parameters import read_all

SIM, BALL = "/World/Sim", "/World/Ball"


def editor(stage, path, name, **options):
    (prim,) = [each for each in editors(stage, **options) if each.path == path]
    return {each.name: each for each in prim.editors}[name]


def groups(stage, path=SIM):
    (prim,) = [each for each in editors(stage) if each.path == path]
    return list(dict.fromkeys(each.group for each in prim.editors))


def test_simulations_and_affectors_are_listed_with_what_is_applied():
    """Oracle: the stage as it was made: a reaction, one deformer, one affector."""
    stage = rich()
    found = editors(stage)
    kinds = [(each.path, each.type_name, each.is_simulation) for each in found]
    assert kinds == [(BALL, "Sphere", False), (SIM, "SplatSim", True)]
    assert groups(stage) == [
        "Simulation",
        "Neighbours",
        "Carriers",
        "Reaction",
        "Even spacing",
        "Growth",
        "New matter",
        "Deformer bend",
    ]
    assert groups(stage, BALL) == ["Affector"]
    author(stage.GetPrimAtPath(SIM), {"driver:glow:amount": 2.0, "settle:omega": 4.0})
    assert groups(stage)[7:] == ["Settling", "Deformer bend", "Driver glow"]
    for each in found:
        for item in each.editors:
            json.dumps(asdict(item), allow_nan=False)


def test_values_are_those_of_the_stage():
    """Oracle: what was authored, and the knobs' defaults elsewhere."""
    stage = rich()
    friction = editor(stage, BALL, "affector:friction")
    assert (friction.value, friction.default, friction.is_authored) == (0.5, 0.2, True)
    assert (friction.minimum, friction.maximum, friction.group) == (0.0, 1.0, "Affector")
    feed = editor(stage, SIM, "rd:feed")
    assert feed.value == 0.037 and not feed.is_authored and not feed.is_animated
    assert editor(stage, SIM, "deform:bend:angle").value == 90.0
    assert editor(stage, SIM, "growth:life").value is None
    assert editor(stage, SIM, "rd:preset").choices[0] == "custom"


def test_an_edit_keeps_the_other_samples_and_is_for_all_times_without_samples():
    """Oracle: the samples on the stage; a name that is none is an error as without a time."""
    stage = rich()
    edits = Edits(stage)
    for time, value in ((1, 0.04), (11, 0.06)):
        author(stage.GetPrimAtPath(SIM), {"rd:feed": value}, time=time)
    edit_parameter(edits, SIM, "rd:feed", 0.1, now=6.0)
    edit_parameter(edits, SIM, "rd:kill", 0.05, now=6.0)
    values = [editor(stage, SIM, "rd:feed", time=time).value for time in (1.0, 6.0, 11.0)]
    assert values == pytest.approx([0.04, 0.1, 0.06])
    kill = editor(stage, SIM, "rd:kill", time=1.0)
    assert kill.value == pytest.approx(0.05) and not kill.is_animated
    edits.close()
    for path, name in (("/None", "rd:feed"), ("", "rd:feed"), (SIM, "rd:none")):
        with pytest.raises((StageError, UsageError)):
            edit_parameter(edits, path, name, 0.1, now=6.0)


def test_animated_parameters_show_the_value_of_the_time():
    """Oracle: linear interpolation between two samples."""
    stage = rich()
    for time, value in ((1, 0.0), (11, 0.1)):
        author(stage.GetPrimAtPath(SIM), {"rd:feed": value}, time=time)
    found = editor(stage, SIM, "rd:feed", time=6.0)
    assert found.is_animated and found.value == pytest.approx(0.05)


def test_a_value_that_none_can_have_is_told_and_hides_no_other():
    """Oracle: values out of range, of another type and of another choice, as others may author."""
    stage = rich()
    prim = stage.GetPrimAtPath(SIM)
    prim.CreateAttribute("splatSim:rd:feed", Sdf.ValueTypeNames.Float).Set(99.0)
    spec = stage.GetRootLayer().GetPrimAtPath(SIM)
    Sdf.AttributeSpec(spec, "splatSim:rd:kill", Sdf.ValueTypeNames.String).default = "often"
    prim.CreateAttribute("splatSim:rd:preset", Sdf.ValueTypeNames.Token).Set("wild")
    prim.CreateAttribute("splatSim:rd:dTau", Sdf.ValueTypeNames.Float).Set(math.nan)
    for name in ("rd:feed", "rd:kill", "rd:preset", "rd:dTau"):
        found = editor(stage, SIM, name)
        assert found.value == found.default and "expected" in found.problem
        json.dumps(asdict(found), allow_nan=False)
    assert editor(stage, SIM, "rd:enabled").value is True


def test_what_is_set_is_what_the_simulation_reads_and_can_be_undone():
    """Oracle: the simulation's own reading of the prim; the layer's text after undo."""
    stage = rich()
    edits = Edits(stage)
    before = stage.GetSessionLayer().ExportToString()
    for name, value in (
        ("rd:feed", 0.05),
        ("rd:preset", "coral"),
        ("growth:life", 3.0),
        ("growth:starve", None),
        ("settle:omega", 12.0),
        ("rd:direction", [1, 0, 0]),
        ("sim:endTime", 50),
        ("deform:bend:divisions", [3, 4, 5]),
    ):
        set_parameter(edits, SIM, name, value)
    read = read_all(stage.GetPrimAtPath(SIM), Usd.TimeCode.Default())
    assert (read.rd.feed, read.rd.preset, read.growth.life) == (0.05, "coral", 3.0)
    assert (read.growth.starve, read.settle.omega) == (math.inf, 12.0)
    assert (read.rd.direction, read.sim.end_time) == ((1.0, 0.0, 0.0), 50.0)
    assert "SplatSimSettleAPI" in stage.GetPrimAtPath(SIM).GetAppliedSchemas()
    assert editor(stage, SIM, "deform:bend:divisions").value == (3, 4, 5)
    for _ in range(8):
        assert edits.undo()
    assert stage.GetSessionLayer().ExportToString() == before


def test_a_slider_is_one_step():
    """Oracle: one undo brings the first value back."""
    stage = rich()
    edits = Edits(stage)
    for number in range(9):
        set_parameter(edits, BALL, "affector:friction", number / 10, merge="friction")
    assert edits.undo() == "Set affector:friction"
    assert editor(stage, BALL, "affector:friction").value == 0.5 and edits.undo() is None


def test_a_key_joins_the_samples_and_a_value_for_all_times_ends_them():
    """Oracle: the samples of the stage, counted."""
    stage = rich()
    edits = Edits(stage)
    for time, value in ((1, 0.0), (11, 0.1)):
        author(stage.GetPrimAtPath(SIM), {"rd:feed": value}, time=time)
    set_parameter(edits, SIM, "rd:feed", 0.1, time=6.0)
    assert stage.GetAttributeAtPath(f"{SIM}.splatSim:rd:feed").GetTimeSamples() == [1, 6, 11]
    set_parameter(edits, SIM, "rd:feed", 0.02)
    found = editor(stage, SIM, "rd:feed", time=6.0)
    assert found.value == 0.02 and not found.is_animated


@pytest.mark.parametrize(
    ("path", "name", "value", "time", "error"),
    [
        (SIM, "rd:feed", 7.0, None, UsageError),
        (SIM, "rd:feed", "much", None, UsageError),
        (SIM, "rd:feed", None, None, UsageError),
        (SIM, "rd:feed", math.nan, None, UsageError),
        (SIM, "rd:preset", "wild", None, UsageError),
        (SIM, "rd:none", 1, None, UsageError),
        (SIM, "", 1, None, UsageError),
        (SIM, "growth:rate", math.inf, None, UsageError),
        (SIM, "sim:seed", 3, 1.0, UsageError),
        (SIM, "deform:twist:angle", 3.0, None, StageError),
        (SIM, "affector:friction", 0.1, None, StageError),
        (BALL, "rd:feed", 0.05, None, StageError),
        ("/World/Cloud", "rd:feed", 0.05, None, StageError),
        ("/None", "rd:feed", 0.05, None, StageError),
        ("", "rd:feed", 0.05, None, StageError),
        ("\0", "rd:feed", 0.05, None, StageError),
    ],
)
def test_what_cannot_be_set_is_a_sentence_and_authors_nothing(path, name, value, time, error):
    """Oracle: the session layer's text before."""
    stage = rich()
    edits = Edits(stage)
    before = stage.GetSessionLayer().ExportToString()
    with pytest.raises(error, match=r"found .+, expected .+"):
        set_parameter(edits, path, name, value, time=time)
    assert stage.GetSessionLayer().ExportToString() == before and edits.undoable is None


def test_affectors_in_instances_are_read_only():
    """Oracle: the prim of the class, seen through the instance, which cannot be edited."""
    stage = rich()
    author(stage.GetPrimAtPath("/_class/Cube"), {"affector:role": "wind"})
    found = editor(stage, "/World/Instance/Cube", "affector:role")
    assert found.value == "wind" and found.is_read_only
    with pytest.raises(StageError):
        set_parameter(Edits(stage), "/World/Instance/Cube", "affector:role", "seed")


def test_known_prims_can_be_asked_for_alone():
    """Oracle: the whole list; one that is gone and one that is none are left out."""
    stage = rich()
    whole = editors(stage, time=2.0)
    assert editors(stage, time=2.0, paths=(BALL, "/None", "/World/Cloud", SIM)) == whole


def test_a_stage_without_simulations_has_no_parameters():
    """Oracle: an empty stage."""
    assert editors(Usd.Stage.CreateInMemory()) == ()


def test_main_parameters_exist_and_what_is_authored_is_main():
    """Oracle: the knobs of each group; what a person has set must not hide."""
    groups = {**GROUPS, **INSTANCED}
    assert MAIN.keys() == groups.keys()
    for group, names in MAIN.items():
        assert set(names) <= {item.name for item in knobs(groups[group])}, group
    stage = rich()
    assert editor(stage, SIM, "rd:feed").is_main
    assert not editor(stage, SIM, "rd:diffusionU").is_main
    author(stage.GetPrimAtPath(SIM), {"rd:diffusionU": 0.2})
    assert editor(stage, SIM, "rd:diffusionU").is_main
