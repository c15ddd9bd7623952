"""Tests that a movement ends the full picture in progress, and of what is drawn after it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.preview.documents import STATE, alone, animated, drawn_by
from usdsplat.core.cancel import CancelToken
from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.document import Document
from usdsplat.preview.pacing import Quality
from usdsplat.preview.session import Session
from usdsplat.preview.values import Look, Picture
from usdsplat.render.frame_stats import Clock

MOVING = replace(STATE, camera=FreeCamera(eye=(0, 0, 9)), is_moving=True)


class Until(CancelToken):
    """Lets a picture go on for a number of stages, and counts."""

    def __init__(self, most: int) -> None:
        super().__init__()
        self.most, self.asked = most, 0

    def check(self) -> None:
        self.asked += 1
        if self.asked > self.most:
            self.cancel()
        super().check()


@pytest.mark.parametrize("aov", ["color", "depth", "primId"])
def test_a_picture_may_end_after_any_launch_and_the_next_one_is_whole(stage, events, aov):
    """Oracle: counted: no launch follows the one after which it was not wanted. The next picture is
    that of a document that was never interrupted; bit for bit."""
    state = replace(STATE, look=Look(aov=aov))
    whole = Document(animated(), publish=events.append)
    drawn_by(whole, state)
    whole.close()
    expected = events.pictures[-1].image
    events.clear()
    document = Document(stage, publish=events.append)
    launches = 0
    while not events.pictures:
        until = Until(launches)
        document.draw(state, until)
        assert until.asked == launches + 1 or events.pictures
        launches += 1
    assert launches > 8
    document.close()
    np.testing.assert_array_equal(events.pictures[-1].image, expected)


def test_a_picture_that_was_ended_after_another_one_leaves_that_as_it_was(document, events):
    """Oracle: the arrays of the last picture before and after; a pick reads them."""
    drawn_by(document, STATE)
    before = {name: array.copy() for name, array in document.shown.sides[0].arrays.items()}
    document.draw(replace(STATE, camera=FreeCamera(eye=(1, 2, 9))), Until(3))
    assert len(events.pictures) == 1 and document.shown.picture is events.pictures[0]
    for name, array in document.shown.sides[0].arrays.items():
        np.testing.assert_array_equal(array, before[name])


@pytest.fixture
def session(events):
    """A session that the test drives, with a document open."""
    session = Session(lambda publish: Document(animated(), publish=publish), own_thread=False)
    session.listen(events.append)
    while session.turn():
        pass
    yield session
    session.close()


@pytest.fixture
def at_a_stage(monkeypatch):
    """Calls a function once, at the end of the next stage of a picture."""
    waiting, lap = [], Clock.lap

    def lapped(self, stage):
        if waiting:
            waiting.pop()()
        lap(self, stage)

    monkeypatch.setattr(Clock, "lap", lapped)
    return waiting.append


def test_a_movement_ends_the_full_picture_in_progress(session, events, at_a_stage, paced):
    """Oracle: the pictures that came: the coarse one of the movement is the first."""
    paced(Quality(scale=2.0))
    session.look(STATE)
    at_a_stage(lambda: session.look(MOVING))
    while session.turn():
        pass
    assert [(each.state, each.scale) for each in events.pictures] == [(MOVING, 2.0)]
    session.look(STATE)
    while session.turn():
        pass
    np.testing.assert_array_equal(events.pictures[-1].image, alone(animated()))


@pytest.mark.parametrize("before", [STATE, MOVING])
def test_other_news_let_a_picture_be_finished(session, events, at_a_stage, before):
    """Oracle: the pictures that came: a view at rest that changes, and a movement that goes on,
    show what was begun, so that a steady stream of news does not stop all pictures."""
    after = replace(before, size=(80, 48))
    session.look(before)
    at_a_stage(lambda: session.look(after))
    while session.turn():
        pass
    assert [each.state for each in events.pictures if isinstance(each, Picture)] == [before, after]


def test_closing_ends_the_picture_in_progress(session, events, at_a_stage):
    """Oracle: nothing comes."""
    session.look(STATE)
    at_a_stage(session.close)
    session.turn()
    assert not events.pictures


def test_a_movement_ends_a_picture_even_if_it_is_over_by_then(session, events, at_a_stage, paced):
    """Oracle: the pictures that came: only that of the view where the movement ended."""
    after = replace(STATE, camera=FreeCamera(eye=(0, 0, 9)))

    def moved():
        session.look(MOVING)
        session.look(after)

    session.look(STATE)
    at_a_stage(moved)
    while session.turn():
        pass
    assert [each.state for each in events.pictures] == [after]


def test_a_closed_session_begins_no_picture(session, events):
    """Oracle: nothing comes; the view was set before."""
    session.look(STATE)
    session.close()
    session.turn()
    assert not events.pictures
