"""Tests of the viewer's settings."""

from __future__ import annotations

import numpy as np
import pytest

from tests.products.page.pages import moving_stage, still_stage, turntable_stage
from usdsplat.products.page.camera import PageRequest, page_camera
from usdsplat.products.page.settings import HELD, viewer_settings


def made(stage, time=None, **request):
    return viewer_settings(page_camera(stage, PageRequest(**request), time))


def test_colours_are_drawn_as_captured():
    """Oracle: the viewer's documentation of its settings, version 2."""
    settings, _ = made(still_stage(), background="0.1,0.2,0.3")
    assert (settings["version"], settings["tonemapping"]) == (2, "none")
    assert not any(effect["enabled"] for effect in settings["postEffectSettings"].values())
    assert settings["background"] == {"color": [0.1, 0.2, 0.3]}


def test_a_still_camera_is_the_initial_one():
    """Oracle: its place by hand, and its up vector; there is no track."""
    settings, ups = made(still_stage())
    assert (settings["animTracks"], settings["startMode"]) == ([], "default")
    assert settings["cameras"][0]["initial"]["position"] == pytest.approx([-1, 2, -10])
    assert ups == pytest.approx([0, 1, 0])


def test_a_track_has_a_key_for_each_frame_and_holds_the_last():
    """Oracle: 12 frames at 24 per second last half a second; the viewer's times are frames."""
    settings, ups = made(moving_stage(), 5.0)
    (track,) = settings["animTracks"]
    values = track["keyframes"]["values"]
    assert track["keyframes"]["times"] == pytest.approx([*range(12), 11 + HELD])
    assert (track["duration"], track["frameRate"], track["smoothness"]) == (0.5, 24, 0)
    assert (track["loopMode"], settings["startMode"]) == ("repeat", "animTrack")
    assert [len(values[name]) for name in ("position", "target", "fov")] == [39, 39, 13]
    assert len(ups) == 39
    assert values["position"][-6:-3] == values["position"][-3:]
    initial = settings["cameras"][0]["initial"]
    assert initial["position"] == values["position"][12:15]  # frame 5


def test_a_turntable_goes_on_at_its_end():
    """Oracle: its last pose is one step before the first, so nothing is held."""
    (track,) = made(turntable_stage(), 0.0)[0]["animTracks"]
    assert track["keyframes"]["times"] == list(range(24))
    assert track["duration"] == 1


def test_frames_with_steps_keep_their_times():
    """Oracle: frames 1, 3, 5, 11 of 24 per second; the last is held for a step of two."""
    (track,) = made(moving_stage(), 1.0, frames=(1.0, 3.0, 5.0, 11.0))[0]["animTracks"]
    assert track["keyframes"]["times"] == pytest.approx([0, 2, 4, 10, 10 + 2 * HELD])
    assert track["duration"] == pytest.approx(12 / 24)


def test_numbers_are_short():
    """Oracle: seven digits at most."""
    values = made(moving_stage(), 1.0)[0]["animTracks"][0]["keyframes"]["values"]["position"]
    assert all(np.float64(f"{value:.7g}") == value for value in values)
