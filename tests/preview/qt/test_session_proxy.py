"""Tests that events of a session arrive in the window's thread, only the latest picture, and none
after closing."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from PySide6.QtWidgets import QApplication

from tests.preview.qt.conftest import wait_until
from usdsplat.core.errors import UsageError
from usdsplat.preview.qt.session_proxy import SessionProxy
from usdsplat.preview.session import Session
from usdsplat.preview.values import Busy, Event, Opened, Picture, Problem, ViewState
from usdsplat.render.specs import CameraSpec

OPENED = Opened(
    name="a.usda", start=0, end=0, rate=24, up_axis="Y", cameras=(), has_simulation=False
)


class Quiet:
    """A document without a stage."""

    def __init__(self, publish: Callable[[Event], None]) -> None:
        self.publish = publish
        self.lock = threading.RLock()
        self.wake: Callable[[], None] = lambda: None
        self.simulation = None

    def opened(self) -> Opened:
        return OPENED

    def draw(self, state: ViewState, cancel: object = None) -> bool:
        return False

    def close(self) -> None:
        """Nothing is held."""


def picture(number: int) -> Picture:
    image = np.zeros((2, 2, 3), np.uint8)
    return Picture(image=image, state=ViewState(), camera=CameraSpec(), number=number)


@pytest.fixture
def session(application: QApplication) -> Iterator[Session]:
    session = Session(Quiet)
    yield session
    session.close()


def test_answers_come_in_the_windows_thread(session: Session) -> None:
    """Oracle: the identity of threads."""
    proxy = SessionProxy(session)
    seen = []
    proxy.ask(
        lambda document: threading.get_ident(),
        lambda result: seen.append((result, threading.get_ident())),
    )
    wait_until(lambda: seen)
    ((asked_in, answered_in),) = seen
    assert answered_in == threading.get_ident() != asked_in


def test_an_error_goes_to_whoever_asked_or_to_everybody(session: Session) -> None:
    """Oracle: the sentence that was raised."""

    def wrong(document: object) -> None:
        raise UsageError("here", "nothing", "something")

    proxy = SessionProxy(session)
    mine, everybodys = [], []
    proxy.problem.connect(everybodys.append)
    proxy.ask(wrong, failed=lambda error: mine.append((str(error), threading.get_ident())))
    wait_until(lambda: mine)
    assert mine == [("here: found nothing, expected something", threading.get_ident())]
    assert not everybodys
    proxy.ask(wrong)
    wait_until(lambda: everybodys)
    assert everybodys == [Problem(sentence="here: found nothing, expected something")]


def test_the_latest_picture_wins_and_all_other_news_arrive(session: Session) -> None:
    """Oracle: what was published while the window did not look, counted."""
    proxy = SessionProxy(session)
    pictures, notes, published = [], [], threading.Event()
    proxy.picture.connect(lambda each: pictures.append(each.number))
    proxy.busy.connect(lambda each: notes.append(each.what))

    def publish(document: Quiet) -> None:
        for number in range(20):
            document.publish(picture(number))
            document.publish(Busy(what=str(number)))
        published.set()

    proxy.ask(publish)
    assert published.wait(30)  # this thread delivers nothing meanwhile
    wait_until(lambda: len(notes) == 20)
    assert pictures == [19]
    assert notes == [str(number) for number in range(20)]


def test_nothing_arrives_after_a_window_has_closed(session: Session) -> None:
    """Oracle: a person's expectation; a task that still runs then must not call a dead window."""
    proxy, watcher = SessionProxy(session), SessionProxy(session)
    begun, go_on, late, over = threading.Event(), threading.Event(), [], []

    def slow(document: Quiet) -> int:
        begun.set()
        go_on.wait(30)
        document.publish(picture(1))
        return 1

    proxy.picture.connect(late.append)
    proxy.ask(slow, late.append)
    assert begun.wait(30)
    proxy.close()
    proxy.deleteLater()
    go_on.set()
    watcher.ask(lambda document: None, lambda result: over.append(result))
    wait_until(lambda: over)
    assert not late


def test_news_already_under_way_are_dropped_when_the_window_closes(session: Session) -> None:
    """Oracle: a person's expectation; they were sent before it closed, and would come after."""
    proxy, watcher = SessionProxy(session), SessionProxy(session)
    sent, late, over = threading.Event(), [], []

    def publish(document: Quiet) -> None:
        document.publish(picture(1))
        document.publish(Busy(what="late"))
        sent.set()

    proxy.picture.connect(late.append)
    proxy.busy.connect(late.append)
    proxy.ask(publish, late.append)
    assert sent.wait(30)
    proxy.close()
    watcher.ask(lambda document: None, lambda result: over.append(result))
    wait_until(lambda: over)
    assert not late
