"""Tests of edits of the session layer: opinions, errors, undo and redo."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.preview.stage_model.stages import (
    add_attributes,
    placed,
    rich,
    said,
    spinning,
    value_types,
    world,
)
from usdsplat.core.errors import StageError, UsageError
from usdsplat.preview.stage_model.edits import Edits

IDENTITY = tuple(np.eye(4).ravel())


EDITS = {
    "value": lambda e: e.set_value("/World/Ball.radius", 3.0),
    "sample": lambda e: e.set_value("/World/Ball.radius", 3.5, time=4.0),
    "colour": lambda e: e.set_value("/World/Cloud.splat:rasterizeMode", "antialiased"),
    "hide": lambda e: e.set_visible("/World/Cloud", False),
    "show": lambda e: e.set_visible("/World/Guides/Cube", True),
    "hide all": lambda e: e.set_visible("/World", False),
    "deactivate": lambda e: e.set_active("/World/Part", False),
    "activate": lambda e: e.set_active("/World/Part", True),
    "purpose": lambda e: e.set_purpose("/World/Ball", "proxy"),
    "variant": lambda e: e.set_variant("/World/Part", "season", "autumn"),
    "as before": lambda e: e.set_variant("/World/Part", "season", ""),
    "move": lambda e: e.set_transform("/World/Ball", tuple(placed(move=(5, 0, 0)).ravel())),
    "key": lambda e: e.set_transform(
        "/World/Ball", tuple(placed(turn=0.5).ravel()), time=3.0, is_keyed=True
    ),
    "instance": lambda e: e.set_visible("/World/Instance", False),
}


@pytest.mark.parametrize("rate", [24.0, 25.0, 48.0, 60.0])
def test_a_key_is_at_the_time_that_was_asked_for_whatever_the_rate(rate):
    """Oracle: the times themselves, before and after the stage gets another rate on disk."""
    stage = rich()
    stage.SetTimeCodesPerSecond(rate)
    edits = Edits(stage)
    edits.set_value("/World/Ball.radius", 3.5, time=7.0)
    for _ in range(2):
        assert stage.GetAttributeAtPath("/World/Ball.radius").GetTimeSamples() == [7.0]
        assert stage.GetTimeCodesPerSecond() == stage.GetRootLayer().timeCodesPerSecond
        stage.GetRootLayer().timeCodesPerSecond = 30.0
        edits.follow_rate()


def test_keys_that_were_there_keep_their_time_when_the_layer_gets_its_rate():
    """Oracle: the times that USD gives before, when it takes the layer for one of 24."""
    stage = rich()
    stage.SetTimeCodesPerSecond(48.0)
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        stage.GetAttributeAtPath("/World/Ball.radius").Set(3.5, 10.0)
    before = stage.GetAttributeAtPath("/World/Ball.radius").GetTimeSamples()
    assert not Edits(stage).has_unsaved
    assert stage.GetSessionLayer().timeCodesPerSecond == 48.0
    assert stage.GetAttributeAtPath("/World/Ball.radius").GetTimeSamples() == before


def test_a_reload_at_another_rate_leaves_nothing_to_be_saved():
    """Oracle: the window's question; nobody has edited anything."""
    stage = rich()
    edits = Edits(stage)
    stage.GetRootLayer().timeCodesPerSecond = 30.0
    edits.follow_rate()
    edits.set_visible("/World/Ball", False)
    assert edits.has_unsaved
    assert edits.undo()
    assert not edits.has_unsaved


@pytest.mark.parametrize("seed", range(6))
def test_undo_and_redo_restore_the_layer_to_the_letter(seed):
    """Oracle: the session layer's own text after each of many edits in a random order."""
    stage = rich()
    root = stage.GetRootLayer().ExportToString()
    edits = Edits(stage)
    chance = random.Random(seed)
    texts = [said(stage)]
    for name in chance.choices(list(EDITS), k=20):
        EDITS[name](edits)
        texts.append(said(stage))
    for _ in range(3):
        for text in texts[-2::-1]:
            assert edits.undo()
            assert said(stage) == text
        assert edits.undo() is None and edits.undoable is None
        for text in texts[1:]:
            assert edits.redo()
            assert said(stage) == text
        assert edits.redo() is None and edits.redoable is None
    assert stage.GetRootLayer().ExportToString() == root


@pytest.mark.parametrize("name", EDITS)
def test_an_edit_changes_what_the_stage_says(name):
    """Oracle: the stage composed, not the layer."""
    stage = rich()
    edits = Edits(stage)
    if name in ("show", "hide all"):
        UsdGeom.Imageable(stage.GetPrimAtPath("/World/Guides")).MakeInvisible()
    if name == "activate":
        edits.set_active("/World/Part", False)
    if name == "as before":
        edits.set_variant("/World/Part", "season", "autumn")
    EDITS[name](edits)
    ball = stage.GetPrimAtPath("/World/Ball")
    found = {
        "value": lambda: ball.GetAttribute("radius").Get() == 3.0,
        "sample": lambda: ball.GetAttribute("radius").Get(4.0) == 3.5,
        "colour": lambda: (
            stage.GetAttributeAtPath("/World/Cloud.splat:rasterizeMode").Get() == "antialiased"
        ),
        "hide": lambda: visibility(stage, "/World/Cloud") == "invisible",
        "show": lambda: visibility(stage, "/World/Guides/Cube") == "inherited",
        "hide all": lambda: visibility(stage, "/World/Ball") == "invisible",
        "deactivate": lambda: not stage.GetPrimAtPath("/World/Part").IsActive(),
        "activate": lambda: stage.GetPrimAtPath("/World/Part").IsActive(),
        "purpose": lambda: UsdGeom.Imageable(ball).ComputePurpose() == "proxy",
        "variant": lambda: selection(stage) == "autumn",
        "as before": lambda: selection(stage) == "summer",
        "move": lambda: np.allclose(world(stage, "/World/Ball")[:3, 3], (5, 0, 0)),
        "key": lambda: np.allclose(world(stage, "/World/Ball", 3.0), placed(turn=0.5)),
        "instance": lambda: visibility(stage, "/World/Instance") == "invisible",
    }
    assert found[name]()


def visibility(stage, path):
    return UsdGeom.Imageable(stage.GetPrimAtPath(path)).ComputeVisibility()


def selection(stage):
    return stage.GetPrimAtPath("/World/Part").GetVariantSets().GetVariantSelection("season")


def test_a_drag_is_one_step():
    """Oracle: the text before the drag, and a drag of another prim is another step."""
    stage = rich()
    edits = Edits(stage)
    before = said(stage)
    for x in range(10):
        matrix = tuple(placed(move=(x, 0, 0)).ravel())
        edits.set_transform("/World/Ball", matrix, merge="drag 1")
    middle = said(stage)
    for x in range(3):
        edits.set_value("/World/Ball.radius", float(x + 1), merge="slider")
    after = said(stage)
    assert edits.undoable == "Set radius"
    edits.undo()
    assert said(stage) == middle and edits.undoable == "Move Ball"
    edits.redo()
    assert said(stage) == after
    edits.set_value("/World/Ball.radius", 9.0, merge="slider")
    edits.undo()
    assert said(stage) == after, "what follows a redo is a step of its own"
    edits.undo()
    edits.undo()
    assert said(stage) == before


def test_a_new_edit_forgets_what_was_taken_back():
    """Oracle: a person's expectation of every editor."""
    edits = Edits(rich())
    edits.set_value("/World/Ball.radius", 2.0)
    edits.undo()
    assert edits.redoable == "Set radius"
    edits.set_active("/World/Ball", False)
    assert edits.redoable is None and edits.redo() is None


def test_a_step_that_fails_leaves_nothing():
    """Oracle: the text before, for an error of anybody's and one of USD's."""
    stage = rich()
    edits = Edits(stage)
    before = said(stage)
    with pytest.raises(RuntimeError), edits.step("Break", "/World/Ball.radius"):
        stage.GetAttributeAtPath("/World/Ball.radius").Set(7.0)
        raise RuntimeError
    with pytest.raises(StageError), edits.step("Break", "/World/Ball.radius"):
        stage.GetAttributeAtPath("/World/Ball.radius").Set(7.0)
        stage.GetAttributeAtPath("/World/Ball.radius").Set("seven")
    assert said(stage) == before and edits.undoable is None
    assert stage.GetEditTarget().GetLayer() == stage.GetRootLayer()


WRONG = [
    ("/World/Ball.radius", "big"),
    ("/World/Ball.radius", True),
    ("/World/Ball.radius", math.nan),
    ("/World/Ball.radius", math.inf),
    ("/World/Ball.radius", None),
    ("/World/Ball.radius", [1.0]),
    ("/World/Ball.visibility", "sometimes"),
    ("/World/Ball.visibility", 1),
    ("/World/Ball.doubleSided", 1),
    ("/World/Ball.xformOp:translate", (1.0, 2.0)),
    ("/World/Ball.xformOp:translate", (1.0, 2.0, math.nan)),
    ("/World/Ball.xformOp:translate", "1 2 3"),
    ("/World/Ball.extent", [(0, 0, 0), (1, 1, 1)]),
    ("/World/Cloud.radiance:sphericalHarmonicsDegree", 2**40),
    ("/World/Cloud.radiance:sphericalHarmonicsDegree", 1.5),
    ("/World/Camera.focalLength", 1e39),
    ("/World/Sim.splatSim:rd:feed", 7.0),
    ("/World/Sim.splatSim:rd:preset", "wild"),
]


@pytest.mark.parametrize(("path", "value"), WRONG)
def test_a_wrong_value_is_a_sentence_and_authors_nothing(path, value):
    """Oracle: the shape of all our errors, and the text before."""
    stage = rich()
    edits = Edits(stage)
    before = said(stage)
    with pytest.raises(UsageError, match=r"found .+, expected .+"):
        edits.set_value(path, value)
    assert said(stage) == before and edits.undoable is None


@pytest.mark.parametrize(
    "path",
    ["", "radius", "/", "/World/Ball", "/World/None.radius", "/World/Ball.none", "/World/Ball.",
     "//..", "/World/Ball.radius.x", "\0", "/World{season=summer}Ball.radius",
     "/World/Instance/Cube.size"],
)  # fmt: skip
def test_what_cannot_be_edited_is_refused(path):
    """Oracle: the text before."""
    stage = rich()
    edits = Edits(stage)
    before = said(stage)
    with pytest.raises(StageError, match=r"found .+, expected .+"):
        edits.set_value(path, 1.0)
    with pytest.raises(StageError):
        edits.clear(path)
    for refused in (
        lambda: edits.set_visible(path, False),
        lambda: edits.set_active(path, False),
        lambda: edits.set_purpose(path, "guide"),
        lambda: edits.set_variant(path, "a", "b"),
        lambda: edits.set_transform(path, IDENTITY),
    ):
        if path != "/World/Ball":
            with pytest.raises(StageError):
                refused()
    assert said(stage) == before


@pytest.mark.parametrize(
    "refused",
    [
        lambda e: e.set_purpose("/World/Ball", "secret"),
        lambda e: e.set_variant("/World/Part", "season", "winter"),
        lambda e: e.set_variant("/World/Part", "color", "red"),
        lambda e: e.set_visible("/World/Sim", False),
        lambda e: e.set_purpose("/World/Sim", "guide"),
        lambda e: e.set_transform("/World/Sim", IDENTITY),
        lambda e: e.set_transform("/World/Instance/Cube", IDENTITY),
        lambda e: e.set_visible("/World/Instance/Cube", False),
        lambda e: e.set_transform("/World/Ball", (1.0,) * 16),
        lambda e: e.set_transform("/World/Ball", IDENTITY[:12]),
        lambda e: e.set_transform("/World/Ball", (math.nan, *IDENTITY[1:])),
        lambda e: e.set_value("/World/Cloud.splat:rasterizeMode", "classic", time=1.0),
        lambda e: e.clear("/World/Ball.radius"),
    ],
)
def test_what_makes_no_sense_is_refused(refused):
    """Oracle: the text before."""
    stage = rich()
    edits = Edits(stage)
    before = said(stage)
    with pytest.raises((StageError, UsageError)):
        refused(edits)
    assert said(stage) == before and edits.undoable is None


def test_every_simple_type_takes_what_it_holds():
    """Oracle: USD reads back what was set, type by type; arrays and the rest are refused."""
    stage = rich()
    add_attributes(stage)
    edits = Edits(stage)
    simple = {"bool": True, "string": "ä", "token": "b", "asset": "c.png"}
    taken = 0
    for name in value_types():
        path = f"/World/All.of:{name.replace('[]', 's')}"
        attribute = stage.GetAttributeAtPath(path)
        size = attribute.GetTypeName().scalarType.type.typeName[5:6] if "64" not in name else ""
        value = simple.get(name, tuple(range(1, int(size) + 1)) if size.isdigit() else 3)
        is_simple = "[]" not in name and not name.startswith(
            ("quat", "matrix", "frame", "path", "opaque", "group")
        )
        if not is_simple:
            with pytest.raises(UsageError):
                edits.set_value(path, value)
            continue
        edits.set_value(path, value)
        found = attribute.Get()
        taken += 1
        if isinstance(value, tuple):
            assert tuple(found) == value
        else:
            assert getattr(found, "path", found) == value
    assert taken == 13 + 12 + 10


def test_a_key_joins_the_samples_that_there_are():
    """Oracle: the animation at its own samples, which a lone stronger sample would hide."""
    stage = spinning()
    edits = Edits(stage)
    path = "/Group/Ball.xformOp:translate"
    edits.set_value(path, (7.0, 7.0, 7.0), time=5.0)
    attribute = stage.GetAttributeAtPath(path)
    assert attribute.GetTimeSamples() == [1.0, 5.0, 10.0]
    assert [tuple(attribute.Get(time)) for time in (1, 5, 10)] == [(0, 1, 0), (7, 7, 7), (0, 10, 0)]
    edits.set_value(path, (1.0, 1.0, 1.0))
    assert [tuple(attribute.Get(time)) for time in (1, 5, 10)] == [(1, 1, 1)] * 3
    edits.undo()
    edits.undo()
    assert attribute.GetTimeSamples() == [1.0, 10.0]


def test_clearing_an_edit_shows_what_was_below():
    """Oracle: the root layer's own value, and the layer's text after undo."""
    stage = rich()
    edits = Edits(stage)
    edits.set_value("/World/Ball.radius", 4.0)
    before = said(stage)
    edits.clear("/World/Ball.radius")
    assert stage.GetAttributeAtPath("/World/Ball.radius").Get() == 1.0
    edits.undo()
    assert said(stage) == before


def test_showing_what_a_group_hides_leaves_its_siblings_hidden():
    """Oracle: visibility as USD computes it, before and after."""
    stage = rich()
    UsdGeom.Imageable(stage.GetPrimAtPath("/World")).MakeInvisible()
    edits = Edits(stage)
    edits.set_visible("/World/Ball", True)
    seen = {
        str(prim.GetPath())
        for prim in stage.Traverse()
        if prim.IsA(UsdGeom.Imageable)
        and UsdGeom.Imageable(prim).ComputeVisibility() != "invisible"
    }
    assert seen == {"/World", "/World/Ball"}
    edits.undo()
    assert visibility(stage, "/World/Ball") == "invisible"


def test_a_simulation_below_the_session_stays_when_edits_are_taken_back():
    """Oracle: the sublayer's own text, and the order of strength."""
    stage = rich()
    frames = Sdf.Layer.CreateAnonymous("frames.usda")
    stage.GetSessionLayer().subLayerPaths.insert(0, frames.identifier)
    with Usd.EditContext(stage, frames):
        stage.GetAttributeAtPath("/World/Ball.radius").Set(8.0)
    text = frames.ExportToString()
    edits = Edits(stage)
    edits.set_value("/World/Ball.radius", 2.0)
    assert stage.GetAttributeAtPath("/World/Ball.radius").Get() == 2.0
    edits.undo()
    assert stage.GetAttributeAtPath("/World/Ball.radius").Get() == 8.0
    assert frames.ExportToString() == text


def test_undoing_what_a_child_says_leaves_its_parent_as_somebody_else_made_it():
    """Oracle: a person's expectation: a step takes back itself, and nothing of others."""
    stage = rich()
    edits = Edits(stage)
    edits.set_visible("/World", True)  # the session says something of the parent before
    edits.set_value("/World/Ball.radius", 3.0)
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        stage.GetPrimAtPath("/World").SetActive(False)
    edits.undo()
    assert not stage.GetPrimAtPath("/World").IsActive()
    assert stage.GetSessionLayer().GetAttributeAtPath("/World/Ball.radius") is None


def test_edits_since_the_last_save_are_known_also_when_a_drag_goes_on():
    """Oracle: what a save would write, compared by hand."""
    edits = Edits(rich())
    assert not edits.has_unsaved
    edits.set_value("/World/Ball.radius", 2.0, merge="drag")
    assert edits.has_unsaved
    edits.note_saved()
    assert not edits.has_unsaved
    edits.set_value("/World/Ball.radius", 3.0, merge="drag")  # no new step, another value
    assert edits.has_unsaved
    edits.note_saved()
    edits.set_visible("/World/Cloud", False)
    assert edits.has_unsaved
    edits.undo()
    assert not edits.has_unsaved
    edits.undo()
    assert edits.has_unsaved


def test_edits_that_take_back_each_other_leave_nothing_to_save():
    """Oracle: the text of the layer: neither hiding and showing nor two equal values say more."""
    edits = Edits(rich())
    edits.set_visible("/World/Cloud", False)
    assert edits.has_unsaved
    edits.set_visible("/World/Cloud", True)
    assert not edits.has_unsaved
    assert edits.layer.GetAttributeAtPath("/World/Cloud.visibility") is None
    edits.undo()
    assert edits.has_unsaved
    edits.set_value("/World/Ball.radius", 3.0)
    edits.note_saved()
    edits.set_value("/World/Ball.radius", 4.0)
    edits.set_value("/World/Ball.radius", 3.0)
    assert not edits.has_unsaved
