"""Tests of the pictures of a document, compared with a separate engine, and of their number."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, UsdGeom

from tests.delegate.scene_delegate.test_lod_items import FAR, NEAR, meshes
from tests.preview.documents import BLACK, STATE, alone, drawn_by
from usdsplat.core.errors import StageError, UsageError
from usdsplat.delegate.engine import Engine
from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.document import Document
from usdsplat.preview.drawing import Drawing
from usdsplat.preview.pacing import Quality
from usdsplat.preview.values import Look, StageChanged
from usdsplat.render.settings import RenderSettings

# --- one picture -----------------------------------------------------------------------


@pytest.mark.parametrize("time", [None, 1.0, 4.0])
def test_a_picture_is_what_an_engine_draws(document, events, stage, time):
    """Oracle: an engine of its own; bit for bit."""
    drawn_by(document, replace(STATE, time=time))
    picture = events.pictures[-1]
    np.testing.assert_array_equal(picture.image, alone(stage, time=time))
    assert (picture.scale, picture.is_final, picture.total) == (1.0, True, 24)
    assert picture.camera.path == "/Camera" and picture.milliseconds["total"] > 0


def test_the_items_of_lod_roots_follow_the_view(events):
    """Oracle: an engine of its own for each camera; the pictures of two items differ."""
    stage = meshes()
    document = Document(stage, publish=events.append)
    for camera in (NEAR, FAR, NEAR):
        drawn_by(document, replace(STATE, camera=camera))
        np.testing.assert_array_equal(events.pictures[-1].image, alone(stage, camera=camera))
    document.close()


def test_nothing_is_drawn_twice(document, events, monkeypatch):
    """Oracle: counted: the same state, also said to move, gives no second picture."""
    drawn_by(document, STATE)
    calls = []
    monkeypatch.setattr(Engine, "picture", lambda *args, **options: calls.append(args))
    assert not document.draw(STATE)
    assert not document.draw(replace(STATE, is_moving=True))
    assert len(events.pictures) == 1 and not calls


def test_display_and_selection_draw_nothing_anew(document, events, monkeypatch):
    """Oracle: counted: a new picture of the same pixels."""
    drawn_by(document, STATE)
    monkeypatch.setattr(Engine, "picture", None)
    drawn_by(document, replace(STATE, display=replace(BLACK, exposure=1.0)))
    drawn_by(document, replace(STATE, selected=("/World/A",)))
    one, two, three = events.pictures
    assert two.image.mean() > one.image.mean()
    np.testing.assert_array_equal(three.image, one.image)
    assert (len(one.boxes), len(three.boxes)) == (0, 1)


def test_what_changes_on_a_stage_is_told_once_before_its_picture(document, events, stage):
    """Oracle: values, then prims, nothing, then the range; many edits are one piece of news."""
    drawn_by(document, STATE)
    events.clear()
    for name in ("A", "B"):
        UsdGeom.Imageable(stage.GetPrimAtPath(f"/World/{name}")).MakeInvisible()
    drawn_by(document, STATE)
    assert isinstance(events[0], StageChanged)
    assert not events[0].structure
    UsdGeom.Xform.Define(stage, "/World/C")
    drawn_by(document, STATE)
    drawn_by(document, STATE)
    stage.SetEndTimeCode(stage.GetEndTimeCode() + 1)
    drawn_by(document, STATE)
    assert [each.structure for each in events if isinstance(each, StageChanged)] == [
        False,
        True,
        True,
    ]
    assert [each.visibility for each in events if isinstance(each, StageChanged)] == [
        True,
        False,
        False,
    ]
    events.clear()
    UsdGeom.Xformable(stage.GetPrimAtPath("/World/A")).AddRotateXOp().Set(5.0)
    drawn_by(document, STATE)
    assert events[0] == StageChanged(structure=False, visibility=False)


def test_an_edit_of_the_stage_is_seen(document, events, stage):
    """Oracle: an engine of its own after the edit."""
    drawn_by(document, STATE)
    UsdGeom.Imageable(stage.GetPrimAtPath("/World/A")).MakeInvisible()
    drawn_by(document, STATE)
    assert len(events.pictures) == 2
    np.testing.assert_array_equal(events.pictures[-1].image, alone(stage))


def test_purposes_are_as_asked_for(document, events, stage):
    """Oracle: the same stage without the prim."""
    UsdGeom.Imageable(stage.GetPrimAtPath("/World/A")).CreatePurposeAttr("guide")
    drawn_by(document, STATE)
    drawn_by(document, replace(STATE, purposes=("default", "render", "guide")))
    assert [picture.total for picture in events.pictures] == [12, 24]


def test_a_free_camera_sees_what_its_spec_says(document, events, stage):
    """Oracle: a camera of the stage with the same lens at the same place."""
    free = FreeCamera(eye=(0, 0, 10), target=(0, 0, 0), field_of_view=53.13010235415598)
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/Camera"))
    camera.GetHorizontalApertureAttr().Set(20.0 * 4 / 3)
    camera.GetVerticalApertureAttr().Set(20.0)
    drawn_by(document, replace(STATE, camera=free))
    drawn_by(document, STATE)
    one, two = (picture.image.astype(int) for picture in events.pictures)
    assert abs(one - two).max() <= 1 and one.max() > 50


def test_a_camera_that_frames_stands_still_while_things_move(document, events, stage):
    """Oracle: the camera of the first picture; F is for the rest."""
    for time in (1.0, 6.0):
        drawn_by(document, replace(STATE, camera=None, time=time))
    one, two = events.pictures
    assert one.camera == two.camera
    assert (one.image != two.image).any()


def test_an_animated_camera_is_followed(document, events, stage):
    """Oracle: an engine of its own at both times."""
    op = UsdGeom.Xformable(stage.GetPrimAtPath("/Camera")).GetOrderedXformOps()[0]
    for time, z in ((1, 10.0), (6, 14.0)):
        op.Set(Gf.Vec3d(0, 0, z), time)
    for time in (1.0, 4.0):
        drawn_by(document, replace(STATE, time=time))
        np.testing.assert_array_equal(events.pictures[-1].image, alone(stage, time=time))


def test_what_cannot_be_drawn_leaves_the_last_picture(document, events):
    """Oracle: the message names what there is, and what was shown stays."""
    drawn_by(document, STATE)
    shown = document.shown
    with pytest.raises(StageError, match="/Camera"):
        document.draw(replace(STATE, camera="/Nobody"))
    with pytest.raises(UsageError, match="'beauty'"):
        document.draw(replace(STATE, look=Look(aov="beauty")))
    assert document.shown is shown and len(events.pictures) == 1
    drawn_by(document, replace(STATE, time=4.0))
    assert len(events.pictures) == 2


# --- coarse and full -------------------------------------------------------------------


@pytest.mark.parametrize("scale", [1.5, 2.0, 3.0])
def test_a_coarse_picture_is_the_full_one_with_larger_pixels(document, events, paced, scale):
    """Oracle: the mean of the full picture's pixels, to within what aliasing does; nothing is
    displaced, and the next one at rest is in full."""
    paced(Quality(scale=scale))
    drawn_by(document, replace(STATE, size=(96, 72), is_moving=True))
    drawn_by(document, replace(STATE, size=(96, 72)))
    coarse, full = events.pictures
    assert (coarse.scale, coarse.is_final, full.scale, full.is_final) == (scale, False, 1.0, True)
    assert coarse.image.shape == (round(72 / scale), round(96 / scale), 3)
    blown = np.kron(coarse.image, np.ones((round(2 * scale),) * 2 + (1,)))
    fine = np.kron(full.image, np.ones((2, 2, 1)))
    error = abs(blown - fine).mean()
    shifted = abs(blown - np.roll(fine, round(2 * scale), axis=1)).mean()
    assert error < 6 and error < 0.7 * shifted


def test_depths_that_were_shown_in_full_while_the_view_moved_are_shown_anew_at_rest(
    document, events, stage, paced
):
    """Oracle: a document that never moved; while it moves nothing is called final."""
    paced(Quality())
    state = replace(STATE, look=Look(aov="Z"))
    drawn_by(document, state)
    UsdGeom.Xformable(stage.GetPrimAtPath("/World/A")).AddTranslateOp(opSuffix="far").Set(
        Gf.Vec3d(0, 0, -0.5)
    )
    drawn_by(document, replace(state, is_moving=True))
    drawn_by(document, state)
    assert [picture.is_final for picture in events.pictures] == [True, False, True]
    fresh = Document(stage, publish=events.append)
    drawn_by(fresh, state)
    fresh.close()
    _, moving, resting, expected = (picture.image for picture in events.pictures)
    assert (moving != expected).any()
    np.testing.assert_array_equal(resting, expected)


def test_a_step_between_comes_before_a_full_picture_that_takes_long(document, events, paced):
    """Oracle: the scales in their order."""
    paced(Quality(scale=4.0), middle=Quality(scale=2.0))
    document.draw(replace(STATE, is_moving=True))
    drawn_by(document, STATE)
    assert [picture.scale for picture in events.pictures] == [4.0, 2.0, 1.0]
    assert [picture.is_final for picture in events.pictures] == [False, False, True]


def test_a_budget_leaves_splats_out_while_the_view_moves(document, events, paced):
    """Oracle: counted."""
    paced(Quality(splats=10))
    drawn_by(document, replace(STATE, is_moving=True))
    drawn_by(document, STATE)
    coarse, full = events.pictures
    assert coarse.splats <= 10 < full.splats
    assert coarse.total == full.total == 24


def test_samples_are_averaged_when_the_view_rests(document, events, stage, paced):
    """Oracle: an engine of its own, with one sample and with all."""
    paced(Quality(averages=False))
    settings = RenderSettings(samples=8, pixel_filter="gaussian")
    state = replace(STATE, look=Look(settings=settings))
    drawn_by(document, replace(state, is_moving=True))
    drawn_by(document, state)
    coarse, full = events.pictures
    np.testing.assert_array_equal(coarse.image, alone(stage))
    np.testing.assert_array_equal(full.image, alone(stage, settings=settings))


# --- the lock and the rest ------------------------------------------------------


def test_the_stage_is_free_while_the_engine_draws(document, monkeypatch):
    """Oracle: another thread takes the lock within a drawing; not within one that shows motion."""
    free = []
    draw = Engine.picture

    def trying(engine, *args, **options):
        def work():
            taken = document.lock.acquire(blocking=False)
            free.append(taken)
            if taken:
                document.lock.release()

        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
        return draw(engine, *args, **options)

    monkeypatch.setattr(Engine, "picture", trying)
    drawn_by(document, replace(STATE, time=2.0))
    drawn_by(document, replace(STATE, time=2.0, look=Look(aov="forward")))
    assert free == [True, False]


def test_an_edit_during_a_drawing_is_in_the_next_picture(document, events, stage, monkeypatch):
    """Oracle: engines of their own before and after."""
    before = alone(stage)
    draw = Engine.picture

    def editing(engine, *args, **options):
        monkeypatch.setattr(Engine, "picture", draw)
        UsdGeom.Imageable(stage.GetPrimAtPath("/World/A")).MakeInvisible()
        return draw(engine, *args, **options)

    monkeypatch.setattr(Engine, "picture", editing)
    drawn_by(document, STATE)
    drawn_by(document, STATE)
    one, two = (picture.image for picture in events.pictures)
    np.testing.assert_array_equal(one, before)
    np.testing.assert_array_equal(two, alone(stage))


def test_a_document_says_what_it_holds(document, stage):
    """Oracle: what was authored."""
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(6)
    stage.SetTimeCodesPerSecond(25)
    opened = document.opened()
    assert (opened.start, opened.end, opened.rate, opened.up_axis) == (1, 6, 25, "Y")
    assert opened.cameras == ("/Camera",) and not opened.has_simulation
    stage.DefinePrim("/Sim", "SplatSim")
    assert document.opened().has_simulation


def test_closing_closes_what_was_added(document):
    """Oracle: counted."""

    class Part:
        closed = 0

        def close(self):
            self.closed += 1

    part = Part()
    document.edits = document.simulation = part
    document.close()
    assert part.closed == 2 and document.shown is None


def test_a_drawing_keeps_no_more_than_it_shows(document):
    """Oracle: weak references would need the collector; counted instead, after ten views."""
    for time in range(1, 11):
        drawn_by(document, replace(STATE, time=float(time), other=Look(aov="Z")))
    drawing = document._drawing
    assert isinstance(drawing, Drawing) and len(drawing._drawn) == 1
