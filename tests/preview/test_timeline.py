"""Tests of playing, stepping and scrubbing, with the test's own clock."""

from __future__ import annotations

import math

import pytest

from usdsplat.core.errors import UsageError
from usdsplat.preview.timeline import Timeline


def played(timeline, ticks):
    """What is shown at each tick."""
    timeline.play()
    timeline.tick(0.0)
    for now in ticks:
        timeline.tick(now)
        yield timeline.current


def test_it_plays_at_its_rate_however_often_it_is_ticked():
    """Oracle: time = start + floor(rate * seconds), at 60 ticks a second and at 7."""
    for hertz in (60, 7):
        timeline = Timeline(start=1.0, end=1000.0, current=1.0, rate=24.0)
        ticks = [number / hertz for number in range(1, 3 * hertz + 1)]
        shown = list(played(timeline, ticks))
        assert shown == [1.0 + math.floor(24.0 * now + 1e-9) for now in ticks]


def test_it_begins_again_at_the_end_or_stops_there():
    """Oracle: five frames, counted by hand."""
    ticks = [0.1 * number for number in range(1, 8)]
    loop = Timeline(start=1.0, end=5.0, current=1.0, rate=10.0)
    assert list(played(loop, ticks)) == [2, 3, 4, 5, 1, 2, 3]
    once = Timeline(start=1.0, end=5.0, current=1.0, rate=10.0, loops=False)
    assert list(played(once, ticks)) == [2, 3, 4, 5, 5, 5, 5]
    assert not once.is_playing
    once.play()
    assert once.current == 1.0


def test_a_tick_says_nothing_when_nothing_changes():
    """Oracle: a stopped timeline, one of a single frame, and a tick before the next frame."""
    timeline = Timeline(end=10.0, rate=10.0)
    assert timeline.tick(0.0) is None
    timeline.play()
    assert timeline.tick(5.0) is None
    assert timeline.tick(5.05) is None
    assert timeline.tick(5.1) == 1.0
    still = Timeline(start=3.0, end=3.0, current=3.0)
    still.play()
    assert [still.tick(0.1 * number) for number in range(20)] == [None] * 20


def test_a_long_pause_is_no_jump():
    """Oracle: a person's expectation: what did not move for a minute goes on where it was."""
    timeline = Timeline(end=100.0, rate=10.0)
    assert list(played(timeline, (0.5, 60.0, 60.1))) == [5.0, 5.0, 6.0]


def test_steps_go_by_whole_frames_and_stop_it():
    """Oracle: counted by hand, from a time between two frames too."""
    timeline = Timeline(start=1.0, end=5.0, current=2.5, is_playing=True)
    assert timeline.advance(1) == 3.0
    assert not timeline.is_playing
    timeline.go(2.5)
    assert timeline.advance(-1) == 2.0
    assert timeline.advance(-2) == 5.0
    timeline.loops = False
    assert timeline.advance(3) == 5.0
    halves = Timeline(start=1.0, end=5.0, step=0.5, current=5.0)
    assert halves.advance(-1) == 4.5


def test_a_step_that_does_not_divide_the_range_ends_before_its_end():
    """Oracle: 0, 0.4, 0.8 of a range to 1, counted by hand."""
    timeline = Timeline(end=1.0, rate=4.0, step=0.4)
    shown = [round(time, 9) for time in played(timeline, (0.1, 0.2, 0.3))]
    assert shown == [0.4, 0.8, 0.0]


def test_scrubbing_stays_in_the_range_and_playing_goes_on_from_there():
    """Oracle: a person's expectation."""
    timeline = Timeline(start=1.0, end=20.0, current=1.0, rate=10.0)
    assert timeline.go(99.0) == 20.0
    assert timeline.go(-math.inf) == 1.0
    timeline.play()
    timeline.tick(0.0)
    timeline.tick(0.25)
    timeline.go(10.0)
    assert timeline.tick(0.36) == 11.0
    timeline.set_range(1.0, 4.0)
    assert timeline.current == 4.0


@pytest.mark.parametrize("wrong", [0.0, -1.0, math.nan, math.inf])
def test_what_cannot_be_played_is_refused(wrong):
    """Oracle: a range and a rate that are as before."""
    timeline = Timeline(end=10.0)
    with pytest.raises(UsageError):
        timeline.set_rate(wrong)
    with pytest.raises(UsageError):
        timeline.set_range(5.0, -5.0 if wrong == 0 else math.nan)
    with pytest.raises(UsageError):
        timeline.go(math.nan)
    assert (timeline.start, timeline.end, timeline.rate) == (0.0, 10.0, 24.0)
