"""Tests of tracking and moving the selected prim, one request at a time."""

from __future__ import annotations

import pytest

from tests.preview.fakes import FakeSession, begun
from usdsplat.core.errors import StageError
from usdsplat.preview.values import StageChanged
from usdsplat.preview.viewer import Viewer
from usdsplat.render.specs import IDENTITY, Matrix


def at(x: float) -> Matrix:
    """A place on the x axis."""
    return (*IDENTITY[:3], x, *IDENTITY[4:])


def with_ball() -> tuple[Viewer, FakeSession]:
    """A viewer that has selected the ball."""
    viewer, session = begun()
    viewer.set_time(5.0)
    viewer.select(("/Look", "/Ball"))
    return viewer, session


def test_the_place_of_the_last_selected_prim_is_known() -> None:
    """Oracle: the stage's own translate op."""
    viewer, session = with_ball()
    assert viewer.placement is not None
    assert viewer.placement.path == "/Ball"
    assert viewer.placement.matrix == pytest.approx(at(0.5))
    session.document.stage.GetPrimAtPath("/Ball").GetAttribute("xformOp:translate").Set((2, 0, 0))
    viewer.stage_changed(StageChanged(structure=False))
    assert viewer.placement.matrix == pytest.approx(at(2.0))


def test_what_cannot_be_moved_has_no_place() -> None:
    """Oracle: a material has no transform; nothing selected has none either."""
    viewer, session = begun()
    viewer.select(("/Look",))
    assert viewer.placement is None
    viewer.select(("/Gone",))
    assert viewer.placement is None
    viewer.select(())
    viewer.place(at(1.0))
    assert session.document.edits.moves == []


def test_a_drag_is_one_step_at_the_time_that_is_shown() -> None:
    """Oracle: the key under which edits merge: one for a drag, another for the next."""
    viewer, session = with_ball()
    viewer.begin_drag()
    viewer.place(at(1.0))
    viewer.place(at(2.0))
    viewer.begin_drag()
    viewer.place(at(3.0))
    moves = session.document.edits.moves
    assert [(path, matrix, time) for path, matrix, time, _ in moves] == [
        ("/Ball", at(x), 5.0) for x in (1.0, 2.0, 3.0)
    ]
    first, second, third = (key for *_, key in moves)
    assert first == second != third


def test_pictures_are_fast_while_a_prim_is_dragged() -> None:
    """Oracle: the states that the session gets, until the button is released."""
    viewer, session = with_ball()
    viewer.begin_drag()
    viewer.place(at(1.0))
    assert session.states[-1].is_moving
    viewer.end_move()
    assert not session.states[-1].is_moving


def test_only_the_newest_place_waits_for_an_edit_that_goes_on() -> None:
    """Oracle: of many places during one edit the last is authored, and handles follow the hand."""
    viewer, session = with_ball()
    session.is_held_back = True
    viewer.begin_drag()
    for x in range(1, 9):
        viewer.place(at(float(x)))
    assert len(session.waiting) == 1
    viewer.stage_changed(StageChanged(structure=False))
    session.let()
    session.let()
    assert [matrix for _, matrix, *_ in session.document.edits.moves] == [at(1.0), at(8.0)]
    assert viewer.placement is not None
    assert viewer.placement.matrix == at(8.0)


def test_an_answer_about_another_prim_is_forgotten() -> None:
    """Oracle: a person's expectation: handles are on what is selected."""
    viewer, session = with_ball()
    session.is_held_back = True
    viewer.stage_changed(StageChanged(structure=False))
    viewer.select(())
    session.let()
    assert viewer.placement is None


def test_a_step_is_named_by_what_the_handle_does() -> None:
    """Oracle: the verb of the drag."""
    viewer, session = with_ball()
    for verb in ("Turn", "Scale"):
        viewer.begin_drag(verb)
        viewer.place(at(1.0))
    assert session.document.edits.verbs == ["Turn", "Scale"]


def test_a_prim_that_cannot_be_edited_is_a_problem_and_the_next_drag_goes_on() -> None:
    """Oracle: the edit's own error, told once for each try."""
    viewer, session = with_ball()
    session.document.edits.error = StageError("/Ball", "an instance", "a prim of its own")
    viewer.place(at(1.0))
    assert session.problems == ["/Ball: found an instance, expected a prim of its own"]
    session.document.edits.error = None
    viewer.place(at(2.0))
    assert len(session.document.edits.moves) == 1
