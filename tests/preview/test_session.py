"""Tests of the thread of a session: order of tasks, latest states, errors and closing."""

from __future__ import annotations

import gc
import threading
import weakref
from dataclasses import replace

import numba
import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.preview.documents import STATE, Shown, alone, animated
from usdsplat.core.errors import StageError
from usdsplat.delegate.engine import Engine
from usdsplat.preview.compiling import COMPILING
from usdsplat.preview.document import Document
from usdsplat.preview.session import Session
from usdsplat.preview.values import Busy, Look, Opened, Picture, Problem, StageChanged

SOON = 600.0
"""Seconds within which anything happens, kernels compiled."""


class Heard(Shown):
    """What a session told, and a way to wait for it."""

    def __init__(self) -> None:
        super().__init__()
        self._changed = threading.Condition()

    def __call__(self, event) -> None:
        with self._changed:
            self.append(event)
            self._changed.notify_all()

    def wait(self, is_there) -> None:
        with self._changed:
            assert self._changed.wait_for(lambda: any(map(is_there, self)), SOON)

    def count_of(self, kind: type) -> int:
        return sum(isinstance(event, kind) for event in self)

    def wait_for_final(self, state) -> Picture:
        def is_it(event):
            return isinstance(event, Picture) and event.is_final and event.state == state

        self.wait(is_it)
        return next(filter(is_it, reversed(self)))


@pytest.fixture
def heard():
    return Heard()


@pytest.fixture
def session(heard):
    session = Session(lambda publish: Document(animated(), publish=publish))
    session.listen(heard)
    yield session
    session.close(SOON)


def answered(session, task):
    """What a task returns, or the sentence that it failed with."""
    answers, there = [], threading.Event()

    def done(answer):
        answers.append(answer)
        there.set()

    session.ask(task, done, lambda error: done(str(error)))
    assert there.wait(SOON)
    return answers[0]


def turned(heard):
    """A session that a test drives itself."""
    session = Session(lambda publish: Document(animated(), publish=publish), own_thread=False)
    session.listen(heard)
    return session


# --- order -----------------------------------------------------------------------------


def test_a_picture_follows_a_look(session, heard):
    """Oracle: an engine of its own; bit for bit."""
    session.look(STATE)
    np.testing.assert_array_equal(heard.wait_for_final(STATE).image, alone(animated()))
    assert isinstance(heard[0], Opened)


def test_tasks_run_in_order_and_before_pictures(heard):
    """Oracle: the order of asking; one turn each."""
    session, order = turned(heard), []
    session.listen(lambda event: order.append(type(event).__name__))
    session.look(STATE)
    for name in ("one", "two", "three"):
        session.ask(lambda document, name=name: order.append(name))
    while session.turn():
        pass
    assert [each for each in order if each != "Busy"] == [
        "Opened",
        "one",
        "two",
        "three",
        "Picture",
    ]
    session.close()


def test_the_latest_look_wins(heard):
    """Oracle: counted: of ten states said before a turn one is drawn."""
    session = turned(heard)
    for time in range(10):
        session.look(replace(STATE, time=float(time)))
    while session.turn():
        pass
    assert [picture.state.time for picture in heard.pictures] == [9.0]
    session.close()


def test_a_task_holds_the_lock(session):
    """Oracle: another thread cannot take it meanwhile, and can afterwards."""

    def task(document):
        free = []

        def work():
            free.append(document.lock.acquire(blocking=False))
            if free[0]:
                document.lock.release()

        other = threading.Thread(target=work)
        other.start()
        other.join()
        return free[0]

    assert answered(session, task) is False


def test_an_edit_by_a_task_is_drawn(session, heard):
    """Oracle: an engine of its own on the edited stage."""
    session.look(STATE)
    before = heard.wait_for_final(STATE)

    def hide(stage):
        UsdGeom.Imageable(stage.GetPrimAtPath("/World/A")).MakeInvisible()

    session.ask(lambda document: hide(document.stage))
    heard.wait(lambda event: isinstance(event, Picture) and event.number > before.number)
    edited = animated()
    hide(edited)
    np.testing.assert_array_equal(heard.pictures[-1].image, alone(edited))


# --- errors ----------------------------------------------------------------------------


def test_an_error_is_told_and_leaves_the_last_picture(session, heard):
    """Oracle: the sentence names what was wrong; the next look is drawn as if nothing was."""
    session.look(STATE)
    first = heard.wait_for_final(STATE)
    session.look(replace(STATE, camera="/Nobody"))
    heard.wait(lambda event: isinstance(event, Problem))
    (problem,) = (event for event in heard if isinstance(event, Problem))
    assert "/Nobody" in problem.sentence and "expected" in problem.sentence
    assert answered(session, lambda document: document.shown.picture.number) == first.number
    later = replace(STATE, time=4.0)
    session.look(later)
    np.testing.assert_array_equal(heard.wait_for_final(later).image, alone(animated(), time=4.0))


def test_a_task_that_fails_says_so_to_who_asked_or_else_to_all(session, heard):
    """Oracle: the sentence."""

    def task(document):
        raise StageError("/A", "nothing", "something")

    assert answered(session, task) == "/A: found nothing, expected something"
    session.ask(task)
    heard.wait(lambda event: event == Problem(sentence="/A: found nothing, expected something"))


def test_a_bug_does_not_end_the_session(session, heard, caplog):
    """Oracle: who asked hears of it, a task after it is done; the terminal has the traceback."""
    session.ask(lambda document: 1 / 0)
    heard.wait(lambda event: isinstance(event, Problem) and "internal error" in event.sentence)
    assert "internal error" in answered(session, lambda document: 1 / 0)
    assert answered(session, lambda document: 7) == 7
    assert "ZeroDivisionError" in caplog.text


def test_a_listener_with_a_bug_is_alone_with_it(heard, caplog):
    """Oracle: who listens after it hears everything, and tasks are done."""
    session = Session(lambda publish: Document(animated(), publish=publish))
    session.listen(lambda event: 1 / 0)
    session.listen(heard)
    session.ask(lambda document: 1 / 0)
    heard.wait(lambda event: isinstance(event, Problem))
    assert any(isinstance(event, Opened) for event in heard)
    assert answered(session, lambda document: 7) == 7
    session.close(SOON)


def test_edits_are_told_and_undoing_them_too_but_not_the_frames_of_a_simulation(session, heard):
    """Oracle: one `StageChanged` for a task that edits, none for one that does not, nor for what
    another thread writes with the lock."""
    session.look(STATE)
    heard.wait_for_final(STATE)

    def changes() -> list[bool]:
        return [event.structure for event in heard if isinstance(event, StageChanged)]

    def told(task) -> list[bool]:
        before = len(changes())
        answered(session, task)
        heard.wait(lambda event: heard.count_of(StageChanged) > before)
        return changes()[before:]

    path = "/World/A"
    assert len(told(lambda document: document.edits.set_visible(path, False))) == 1
    assert len(told(lambda document: document.edits.undo())) == 1
    assert told(lambda document: document.edits.set_active(path, False)) == [True]
    before = changes()
    document = answered(session, lambda document: document)
    with document.lock:
        number = len(heard.pictures)
        document.stage.GetPrimAtPath("/World/B").SetActive(False)
    session.wake()
    heard.wait(lambda event: len(heard.pictures) > number)
    assert changes() == before


def test_what_cannot_be_opened_is_told(heard):
    """Oracle: the sentence; asking and closing do no harm."""

    def fail(publish):
        raise StageError("shot.usd", "no such file", "a stage")

    session = Session(fail)
    session.listen(heard)
    session.look(STATE)
    heard.wait(lambda event: isinstance(event, Problem))
    session.close(SOON)
    assert not heard.pictures


def test_nobody_misses_what_is_said_first(heard):
    """Oracle: a document that is opened at once: the one who listens a moment later hears of it."""
    session = Session(lambda publish: Document(animated(), publish=publish))
    threading.Event().wait(0.2)
    session.listen(heard)
    heard.wait(lambda event: isinstance(event, Opened))
    session.close(SOON)


def test_a_session_that_nobody_listened_to_is_closed():
    """Oracle: its thread is gone, and nothing was opened."""
    opened = []
    session = Session(opened.append)
    session.close(SOON)
    assert not session._thread.is_alive() and not opened


# --- the end ---------------------------------------------------------------------------


def test_closing_while_drawing_waits_for_the_picture_and_releases(heard, monkeypatch):
    """Oracle: the thread is gone, the engine closed, and no task runs afterwards."""
    begun, closed, late = threading.Event(), [], []
    draw, close = Engine.picture, Engine.close

    def slowly(engine, *args, **options):
        begun.set()
        return draw(engine, *args, **options)

    monkeypatch.setattr(Engine, "picture", slowly)
    monkeypatch.setattr(Engine, "close", lambda self: (closed.append(self), close(self)))
    session = Session(lambda publish: Document(animated(), publish=publish))
    session.listen(heard)
    session.look(STATE)
    assert begun.wait(SOON)
    session.close(SOON)
    session.ask(late.append)
    assert len(set(map(id, closed))) == 1 and not late
    assert not session._thread.is_alive()


def test_a_closed_session_returns_the_memory_of_its_document(heard, monkeypatch):
    """Oracle: the document is closed, and nothing refers to it any more, when freed memory is
    returned."""
    called, made = [], []
    close = Document.close
    monkeypatch.setattr(Document, "close", lambda self: (close(self), called.append("close")))
    monkeypatch.setattr(
        "usdsplat.preview.session.return_freed_memory",
        lambda: (gc.collect(), called.append(made[0]())),
    )

    def opened(publish):
        document = Document(animated(), publish=publish)
        made.append(weakref.ref(document))
        return document

    session = Session(opened)
    session.listen(heard)
    heard.wait(lambda event: isinstance(event, Opened))
    session.close(SOON)
    assert called == ["close", None]


def test_a_listener_that_stopped_hears_nothing(heard):
    """Oracle: counted."""
    session = turned(heard)
    stop = session.listen(other := Heard())
    session.turn()
    stop()
    session.look(STATE)
    while session.turn():
        pass
    assert len(other) == 1 and len(heard.pictures) == 1
    session.close()


# --- two at once -----------------------------------------------------------------------


def shots():
    """Two stages that share a layer and every path, and differ by their session layers."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    source = animated()
    layer.TransferContent(source.GetRootLayer())
    stages = []
    for number in range(2):
        stage = Usd.Stage.Open(layer, Sdf.Layer.CreateAnonymous(".usda"))
        stage.SetEditTarget(stage.GetSessionLayer())
        UsdGeom.Xformable(stage.GetPrimAtPath("/World/A")).AddTranslateOp().Set((number, 1.0, 0))
        stages.append(stage)
    return stages


def drive(session, heard, number):
    """Walk through times, looks and edits; return the pictures."""
    images = []
    for step in range(4):
        state = replace(STATE, time=1.0 + (step + number) % 4, wipe=0.5,
                        other=Look(time=5.0) if step % 2 else None)  # fmt: skip
        opacity = 0.3 + 0.1 * step + 0.05 * number

        def fade(document, opacity=opacity):
            attribute = document.stage.GetAttributeAtPath("/World/B.opacities")
            attribute.Set([opacity] * 12)

        session.ask(fade)
        session.look(state)
        images.append(heard.wait_for_final(state).image)
    return images


def test_two_sessions_draw_what_each_draws_alone():
    """Oracle: each with nobody else around; bit for bit."""
    expected = []
    for number, stage in enumerate(shots()):
        heard = Heard()
        session = Session(lambda publish, stage=stage: Document(stage, publish=publish))
        session.listen(heard)
        expected.append(drive(session, heard, number))
        session.close(SOON)
    assert len({image.tobytes() for images in expected for image in images}) == 8
    found, threads, sessions = [None, None], [], []
    for number, stage in enumerate(shots()):
        heard = Heard()
        session = Session(lambda publish, stage=stage: Document(stage, publish=publish))
        session.listen(heard)
        sessions.append(session)

        def work(number=number, session=session, heard=heard):
            found[number] = drive(session, heard, number)

        threads.append(threading.Thread(target=work))
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for session in sessions:
        session.close(SOON)
    for one, two in zip(found, expected, strict=True):
        for image, own in zip(one, two, strict=True):
            np.testing.assert_array_equal(image, own)


def test_a_task_that_compiles_says_so(stage):
    """Oracle: the task calls a function that nobody has compiled yet."""
    heard, done = Heard(), threading.Event()
    session = Session(lambda publish: Document(stage, publish=publish))
    session.listen(heard)
    session.ask(lambda document: numba.njit(lambda x: x + 2)(1), lambda found: done.set())
    assert done.wait(SOON)
    session.close()
    assert heard[heard.index(COMPILING) + 1] == Busy(what="")
