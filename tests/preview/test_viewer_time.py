"""Tests of a viewer's timeline: scrubbing, playing, following a simulation, restoring bookmarks."""

from __future__ import annotations

import numpy as np
import pytest

from tests.preview.fakes import begun, camera_of
from usdsplat.preview.values import SimulationStatus


def test_bookmarks_come_back_and_are_replaced_by_name() -> None:
    """Oracle: a person's expectation."""
    viewer, session = begun()
    viewer.orbit(0.3, 0.0)
    viewer.set_time(12.0)
    kept = camera_of(viewer)
    assert viewer.add_bookmark().name == "View 1"
    viewer.use_camera("/Camera")
    viewer.set_time(3.0)
    assert viewer.add_bookmark().name == "View 2"
    viewer.restore("View 1")
    assert (session.states[-1].camera, session.states[-1].time) == (kept, 12.0)
    viewer.restore("View 2")
    assert (session.states[-1].camera, session.states[-1].time) == ("/Camera", 3.0)
    viewer.restore("nobody's")
    assert session.states[-1].camera == "/Camera"
    viewer.use_camera(kept)
    viewer.add_bookmark("View 2")
    assert [each.name for each in viewer.bookmarks] == ["View 1", "View 2"]
    viewer.remove("View 1")
    assert [each.camera for each in viewer.bookmarks] == [kept]


def test_scrubbing_is_a_move_and_a_set_time_is_not() -> None:
    """Oracle: a person's expectation: coarse while dragged, in full when let go."""
    viewer, session = begun()
    viewer.set_time(7.0, is_scrubbing=True)
    assert (session.states[-1].time, session.states[-1].is_moving) == (7.0, True)
    viewer.end_move()
    assert not session.states[-1].is_moving
    viewer.set_time(99.0)
    assert (session.states[-1].time, session.states[-1].is_moving) == (24.0, False)
    viewer.advance(-1)
    assert session.states[-1].time == 23.0


def test_playing_shows_each_time_as_a_move_until_it_stops() -> None:
    """Oracle: the timeline's own frames at 24 in a second."""
    viewer, session = begun()
    viewer.play()
    assert viewer.is_ticking
    for now in np.arange(10.0, 10.5, 1.0 / 48.0):
        viewer.tick(float(now))
    assert session.states[-1].time == pytest.approx(12.0)
    assert session.states[-1].is_moving
    viewer.end_move()
    assert session.states[-1].is_moving, "letting go of the mouse does not stop it"
    viewer.play(False)
    assert not session.states[-1].is_moving
    assert not viewer.is_ticking


def test_a_running_simulation_is_followed_and_widens_the_timeline() -> None:
    """Oracle: a person's expectation."""
    viewer, session = begun()
    viewer.simulated(SimulationStatus(state="running", frame=30.0, frames=(1.0, 30.0)))
    assert viewer.timeline.end == 30.0
    assert session.states[-1].time == 30.0
    viewer.set_time(4.0)
    viewer.simulated(SimulationStatus(state="paused", frame=30.0, frames=(1.0, 30.0)))
    assert session.states[-1].time == 4.0
