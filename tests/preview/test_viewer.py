"""Tests that user actions become states that the viewer sends to its session."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.preview.fakes import BOX, OPENED, FakeSession, begun, camera_of, picture_of
from tests.render.rendering import scene_of
from tests.render.test_subject import place
from usdsplat.core.errors import UsageError
from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.values import Look, StageChanged
from usdsplat.preview.viewer import FLIGHT, Viewer
from usdsplat.render.settings import RenderSettings
from usdsplat.render.subject import of_box


def test_a_stage_begins_framed_at_its_first_time_and_in_the_same_look() -> None:
    """Oracle: a person's expectation."""
    session = FakeSession()
    viewer = Viewer(session)
    viewer.set_look(aov="depth")
    viewer.select(("/Gone",))
    viewer.set_other(Look(time=3.0))
    viewer.opened(OPENED)
    state = session.states[-1]
    assert (state.camera, state.time, state.look.aov) == (None, 1.0, "depth")
    assert (state.selected, state.other) == ((), None)
    assert viewer.cameras == ("/Camera",)
    assert viewer.subject is not None
    assert viewer.subject.extent(np.eye(3))[0] == pytest.approx(0.5 * (BOX[0] + BOX[1]))


def test_a_stage_without_a_range_is_seen_at_its_default_time() -> None:
    """Oracle: USD's default time ignores samples, as usdview shows a stage without a range."""
    viewer, session = begun()
    viewer.opened(replace(OPENED, start=0.0, end=0.0))
    assert session.states[-1].time is None


def test_the_first_move_begins_where_the_picture_was_seen_from() -> None:
    """Oracle: the spec of the picture: what was framed is framed, to a millionth. Orbits are around
    the point of its axis that is nearest to the middle of all."""
    viewer, session = begun()
    seen = picture_of(viewer.state).camera
    viewer.orbit(0.0, 0.0)
    state = session.states[-1]
    spec = camera_of(viewer).spec(aspect=2.0, bounds=BOX)
    assert spec.world_to_camera == pytest.approx(seen.world_to_camera, abs=1e-6)
    assert spec.window == pytest.approx(seen.window)
    matrix = np.reshape(seen.world_to_camera, (4, 4))
    target, middle = (matrix @ (*point, 1) for point in (camera_of(viewer).target, (0, 0.5, 0)))
    assert target[:3] == pytest.approx((0, 0, middle[2]), abs=1e-6)
    assert state.is_moving


def test_moves_are_around_what_a_camera_frames_of_a_place() -> None:
    """Oracle: the block in the middle of a place, of which the rest is background."""
    viewer, _ = begun()
    viewer.subject = scene_of((place(), np.eye(4))).seen()
    matrix = np.eye(4)
    matrix[2, 3] = -30.0
    seen = replace(picture_of(viewer.state).camera, world_to_camera=tuple(matrix.ravel()))
    viewer.shown(replace(picture_of(viewer.state), camera=seen))
    camera = viewer.free_camera()
    assert camera is not None
    assert camera.target == pytest.approx((0, 0, 0), abs=1.5)


def test_before_a_picture_moves_do_nothing() -> None:
    """Oracle: a person's expectation: what nobody has seen cannot be dragged."""
    session = FakeSession()
    viewer = Viewer(session)
    viewer.opened(OPENED)
    told = len(session.states)
    viewer.orbit(0.1, 0.0)
    viewer.frame()
    viewer.aim((1.0, 2.0, 3.0))
    assert viewer.free_camera() is None
    assert len(session.states) == told


def test_a_picture_of_another_camera_does_not_say_where_moves_begin() -> None:
    """Oracle: a late picture of the camera before must not take the place of the one chosen."""
    viewer, _ = begun()
    late = picture_of(viewer.state)
    viewer.use_camera("/Camera")
    chosen = picture_of(replace(viewer.state, camera=FreeCamera(eye=(0.0, 0.0, 9.0))))
    viewer.shown(replace(chosen, state=viewer.state))
    viewer.shown(late)
    viewer.pan(0.0, 0.0)
    assert camera_of(viewer).eye == pytest.approx((0.0, 0.0, 9.0))


def test_moves_are_the_cameras_and_end_when_told() -> None:
    """Oracle: the free camera's own moves."""
    viewer, session = begun()
    start = viewer.free_camera()
    assert start is not None
    viewer.orbit(0.1, 0.2)
    viewer.pan(0.3, -0.1)
    viewer.dolly(0.5)
    viewer.look_around(0.02, 0.03)
    expected = start.orbited(0.1, 0.2).panned(0.3, -0.1, aspect=2.0).dollied(0.5)
    expected = expected.looked_around(0.02, 0.03)
    assert camera_of(viewer) == expected
    assert session.states[-1].is_moving
    viewer.end_move()
    assert not session.states[-1].is_moving
    told = len(session.states)
    viewer.end_move()
    assert len(session.states) == told, "a second end says nothing new"


def test_a_flight_covers_its_share_of_the_way_each_second() -> None:
    """Oracle: the closed form, in ticks of different lengths."""
    viewer, session = begun()
    viewer.pan(0.0, 0.0)
    start = camera_of(viewer)
    viewer.set_speed(2.0)
    viewer.set_flight(0.0, 0.0, 1.0)
    assert viewer.is_ticking
    for now in (5.0, 5.04, 5.05, 5.1, 5.15):
        viewer.tick(now)
    way = np.subtract(camera_of(viewer).eye, start.eye)
    assert way == pytest.approx(-start.axes[2] * 0.15 * 2.0 * FLIGHT * start.distance)
    viewer.end_move()
    assert not viewer.is_ticking
    assert not session.states[-1].is_moving


def test_a_hiccup_is_no_leap_and_speeds_have_limits() -> None:
    """Oracle: the closed forms of the limits."""
    viewer, _ = begun()
    viewer.pan(0.0, 0.0)
    start = camera_of(viewer)
    viewer.set_flight(1.0, 0.0, 0.0)
    viewer.tick(0.0)
    viewer.tick(60.0)
    way = np.linalg.norm(np.subtract(camera_of(viewer).eye, start.eye))
    assert way == pytest.approx(0.1 * FLIGHT * start.distance)
    viewer.set_speed(1e9)
    assert viewer.speed == 1e3


def test_a_selection_is_framed_by_its_box() -> None:
    """Oracle: the free camera's framing."""
    viewer, session = begun()
    start = viewer.free_camera()
    assert start is not None
    session.document.box = (np.array((4.0, 0.0, 0.0)), np.array((5.0, 1.0, 1.0)))
    viewer.frame(("/World/Thing",))
    assert session.document.asked[-1] == ("/World/Thing",)
    assert camera_of(viewer) == start.framing(of_box(session.document.box), aspect=2.0)
    session.document.box = None
    viewer.frame(("/World/Empty",))
    assert camera_of(viewer) == start.framing(
        of_box((np.array((4.0, 0.0, 0.0)), np.array((5.0, 1.0, 1.0)))), aspect=2.0
    ), "nothing to frame: nothing happens"


def test_a_glide_ends_at_what_was_framed_and_a_move_breaks_it_off() -> None:
    """Oracle: the camera without a glide, and distances in between."""
    viewer, session = begun(glide=0.2)
    viewer.pan(0.0, 0.0)
    viewer.end_move()
    start = camera_of(viewer)
    box = of_box((np.array((4.0, 0.0, 0.0)), np.array((5.0, 1.0, 1.0))))
    viewer.frame_subject(box)
    end = start.framing(box, aspect=2.0)
    viewer.tick(1.0)
    assert camera_of(viewer) == start
    viewer.tick(1.1)
    between = camera_of(viewer)
    assert end.distance < between.distance < start.distance
    assert session.states[-1].is_moving
    viewer.tick(1.25)
    assert camera_of(viewer) == end
    assert not session.states[-1].is_moving
    assert not viewer.is_ticking
    viewer.aim((0.0, 0.0, 0.0))
    viewer.tick(2.0)
    viewer.orbit(0.0, 0.0)
    assert not viewer.is_ticking
    assert camera_of(viewer).target == pytest.approx(end.target)


def test_what_is_shown_changes_field_by_field() -> None:
    """Oracle: dataclasses.replace."""
    viewer, session = begun()
    viewer.set_look(aov="depth", time=2.0)
    viewer.set_look(settings=RenderSettings(sh_degree=1))
    viewer.set_display(exposure=1.5)
    viewer.set_purposes(("default", "proxy"))
    viewer.set_other(Look(aov="normal"))
    viewer.set_wipe(1.5)
    state = session.states[-1]
    assert (state.look.aov, state.look.time) == ("depth", 2.0)
    assert state.look.settings.sh_degree == 1
    assert state.display.exposure == 1.5
    assert state.purposes == ("default", "proxy")
    assert state.other == Look(aov="normal")
    assert state.wipe == 1.0


def test_a_setting_that_cannot_be_leaves_the_view_as_it_was() -> None:
    """Oracle: the knob's own range."""
    viewer, session = begun()
    told = len(session.states)
    with pytest.raises(UsageError):
        viewer.set_display(gamma=0.0)
    assert len(session.states) == told


def test_other_prims_bring_other_cameras_and_a_range_only_where_the_stage_has_another() -> None:
    """Oracle: a person's expectation: what was chosen on the timeline stays, unless the stage says
    something new."""
    viewer, session = begun()
    viewer.timeline.set_range(5.0, 10.0)
    viewer.set_time(7.0)
    session.document.says = replace(OPENED, cameras=("/Camera", "/Shot"), has_simulation=True)
    viewer.stage_changed(StageChanged(structure=False))
    assert viewer.cameras == ("/Camera",)
    viewer.stage_changed(StageChanged(structure=True))
    assert viewer.cameras == ("/Camera", "/Shot") and viewer.has_simulation
    assert (viewer.timeline.start, viewer.timeline.end, viewer.state.time) == (5.0, 10.0, 7.0)
    session.document.says = replace(OPENED, end=6.0)
    viewer.stage_changed(StageChanged(structure=True))
    assert (viewer.timeline.start, viewer.timeline.end, viewer.state.time) == (1.0, 6.0, 6.0)
    assert not viewer.has_simulation
