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
    assert unsimulated(status, time, start=1.0, is_baked=is_baked) == words
