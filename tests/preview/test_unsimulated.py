"""Tests of the words on times that are not simulated."""

from __future__ import annotations

import pytest

from usdsplat.preview.unsimulated import unsimulated
from usdsplat.preview.values import SimulationStatus


@pytest.mark.parametrize(
    ("state", "frames", "time", "is_baked", "words"),
    [
        ("none", None, 5.0, False, ""),
        ("ready", None, None, False, ""),
        ("ready", None, 1.0, False, ""),
        ("ready", None, 5.0, False, "Frame 5 is not simulated yet"),
        ("ready", None, 5.0, True, ""),
        ("paused", (3.0, 8.0), 8.0, False, ""),
        ("paused", (3.0, 8.0), 8.5, True, "Frame 8.5 is not simulated yet: this is 8"),
        ("running", (3.0, 8.0), 2.0, False, "Frame 2 is not simulated: this is 3"),
    ],
)
def test_words_say_which_frame_is_shown(state, frames, time, is_baked, words):
    """Oracle: by hand."""
    status = SimulationStatus(state=state, frames=frames)
    assert unsimulated(status, time, first=1.0, is_baked=is_baked) == words


@pytest.mark.parametrize(
    ("start", "time", "words"),
    [
        (4.0, 3.0, ""),
        (4.0, 4.0, ""),
        (4.0, 4.5, "Frame 4.5 is not simulated yet"),
        (-9.0, 1.0, "Frame 1 is not simulated yet"),
    ],
)
def test_before_its_own_start_a_simulation_changes_nothing(start, time, words):
    """Oracle: by hand: one that starts before the timeline has moved splats at its first frame."""
    status = SimulationStatus(state="ready", start=start)
    assert unsimulated(status, time, first=1.0, is_baked=False) == words
