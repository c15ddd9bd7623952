"""Tests that our viewer follows usdview, and that usdview follows our picks."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

# the stand-in for usdview has its signals
pytest.importorskip("PySide6.QtCore", exc_type=ImportError)

from pxr import Gf, Usd

from tests.delegate.stages import add_camera, two_fields
from tests.preview.fakes import begun, camera_of
from tests.preview.usdview.usdviewq import Api, DataModel
from usdsplat.preview.usdview.following import Following, free_camera
from usdsplat.render.framing import conform
from usdsplat.render.specs import Framing


@pytest.fixture
def usdview():
    stage = two_fields()
    add_camera(stage)
    return SimpleNamespace(model=DataModel(stage), camera=Gf.Camera(), window=None)


@pytest.fixture
def following(usdview):
    viewer, session = begun()
    return Following(Api(usdview), viewer), viewer, session


def test_the_frame_is_followed_when_it_changes_and_only_then(following, usdview):
    """Oracle: a time that a user chose in our viewport stays until usdview moves on."""
    follow, viewer, _ = following
    follow.update(with_camera=False)
    assert viewer.state.time == 1.0  # usdview's default time is no frame
    usdview.model.currentFrame = Usd.TimeCode(7)
    follow.update(with_camera=False)
    assert (viewer.state.time, viewer.state.is_moving) == (7.0, False)
    viewer.set_time(9.0)
    follow.update(with_camera=False)
    assert viewer.state.time == 9.0
    usdview.model.currentFrame = Usd.TimeCode(8)
    follow.update(with_camera=False)
    assert viewer.state.time == 8.0


def test_pictures_may_be_coarse_while_usdview_plays(following, usdview):
    """Oracle: moving until it stops, at rest from then on."""
    follow, viewer, _ = following
    usdview.model.playing = True
    for frame in (3, 4):
        usdview.model.currentFrame = Usd.TimeCode(frame)
        follow.update(with_camera=False)
        assert (viewer.state.time, viewer.state.is_moving) == (frame, True)
    usdview.model.playing = False
    follow.update(with_camera=False)
    assert (viewer.state.time, viewer.state.is_moving) == (4.0, False)


def test_a_selection_goes_both_ways_and_never_in_circles(following, usdview):
    """Oracle: what the one selected is what the other has, and nobody is told twice."""
    follow, viewer, session = following
    selection, stage = usdview.model.selection, usdview.model.stage
    follow.update(with_camera=False)
    assert viewer.state.selected == ()
    selection.setPrim(stage.GetPrimAtPath("/World/A"))
    follow.update(with_camera=False)
    assert viewer.state.selected == ("/World/A",)
    viewer.select(("/World/B", "/World/A"))
    told = len(session.states)
    for _ in range(3):
        follow.update(with_camera=False)
    assert [str(path) for path in selection.getPrimPaths()] == ["/World/B", "/World/A"]
    assert viewer.state.selected == ("/World/B", "/World/A")
    assert len(session.states) == told
    viewer.select(())
    for _ in range(3):
        follow.update(with_camera=False)
    assert [str(path) for path in selection.getPrimPaths()] == ["/"]
    assert (viewer.state.selected, len(session.states)) == ((), told + 1)


def test_a_path_that_usdview_does_not_have_is_not_selected_there(following, usdview):
    """Oracle: usdview keeps at least its root."""
    follow, viewer, _ = following
    follow.update(with_camera=False)
    viewer.select(("/Gone",))
    follow.update(with_camera=False)
    assert [str(path) for path in usdview.model.selection.getPrimPaths()] == ["/"]


def test_the_camera_is_followed_only_where_it_is_asked_for(following, usdview):
    """Oracle: usdview's free camera at (0, 0, 8), then a prim of the stage; a move of ours stays
    until usdview's camera moves."""
    follow, viewer, _ = following
    before = viewer.state.camera
    usdview.camera.transform = Gf.Matrix4d().SetTranslate(Gf.Vec3d(0, 0, 8))
    follow.update(with_camera=False)
    assert viewer.state.camera == before
    follow.update(with_camera=True)
    assert camera_of(viewer).eye == (0.0, 0.0, 8.0)
    viewer.orbit(0.1, 0.0)
    viewer.end_move()
    moved = viewer.state.camera
    follow.update(with_camera=True)
    assert viewer.state.camera == moved
    usdview.model.viewSettings.cameraPrim = usdview.model.stage.GetPrimAtPath("/Camera")
    follow.update(with_camera=True)
    assert viewer.state.camera == "/Camera"


def test_a_camera_that_keeps_moving_is_shown_coarsely_until_it_rests(following, usdview):
    """Oracle: the second step in a row is a movement; the first turn without one ends it."""
    follow, viewer, _ = following
    seen = []
    for z in (8, 9, 10, 10):
        usdview.camera.transform = Gf.Matrix4d().SetTranslate(Gf.Vec3d(0, 0, z))
        follow.update(with_camera=True)
        seen.append(viewer.state.is_moving)
    assert seen == [False, True, True, False]


@pytest.mark.parametrize("projection", [Gf.Camera.Perspective, Gf.Camera.Orthographic])
@pytest.mark.parametrize(("wide", "high"), [(36.0, 24.0), (24.0, 36.0)])
def test_our_camera_sees_what_usdviews_sees(projection, wide, high):
    """Oracle: the window of USD's own frustum, in a viewport of the camera's shape."""
    camera = Gf.Camera()
    camera.projection = projection
    camera.horizontalAperture, camera.verticalAperture = wide, high
    camera.focalLength = 35.0
    camera.focusDistance = 6.0
    turn = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(0, 1, 0), 30.0))
    camera.transform = turn * Gf.Matrix4d().SetTranslate(Gf.Vec3d(1, 2, 3))
    aspect = wide / high
    spec = free_camera(camera, up_axis="Y").spec(aspect=aspect, bounds=None)
    window, _ = conform(spec.window, Framing(resolution=(1, 1), pixel_aspect_ratio=aspect))
    frame = camera.frustum.window
    np.testing.assert_allclose(window, (*frame.min, *frame.max), rtol=1e-6)
    expected = np.array(camera.transform.GetInverse()).T
    np.testing.assert_allclose(np.reshape(spec.world_to_camera, (4, 4)), expected, atol=1e-9)
    assert spec.orthographic == (projection == Gf.Camera.Orthographic)
    assert math.dist((1, 2, 3), free_camera(camera, up_axis="Y").target) == pytest.approx(6.0)
