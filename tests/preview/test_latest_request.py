"""Tests of the request queue of length one."""

from __future__ import annotations

import threading

from tests.preview.fakes import FakeSession
from usdsplat.core.errors import UsageError
from usdsplat.preview.document import Document
from usdsplat.preview.latest_request import LatestRequest
from usdsplat.preview.session import Session


def test_of_many_that_wait_the_last_is_asked():
    """Oracle: the first is under way; of nine others one is left."""
    session, answers = FakeSession(), []
    request = LatestRequest(session)
    session.is_held_back = True
    for number in range(10):
        request.ask(lambda document, number=number: number, answers.append)
    assert request.is_busy and len(session.waiting) == 1
    session.let()
    assert answers == [0] and request.is_busy
    session.let()
    assert answers == [0, 9] and not request.is_busy


def test_what_fails_is_told_and_the_next_is_asked():
    """Oracle: the sentence, by who asked or else by the session."""

    def wrong(document):
        raise UsageError("here", "nothing", "something")

    session, answers, errors = FakeSession(), [], []
    request = LatestRequest(session)
    request.ask(wrong, answers.append, errors.append)
    request.ask(wrong, answers.append)
    request.ask(lambda document: 3, answers.append)
    sentence = "here: found nothing, expected something"
    assert [str(error) for error in errors] == [sentence]
    assert (session.problems, answers) == ([sentence], [3])


def test_a_bug_leaves_nobody_waiting(stage, caplog):
    """Oracle: a task that divides by zero, and one after it, in a session's own thread."""
    answered = threading.Event()
    session = Session(lambda publish: Document(stage, publish=publish))
    request = LatestRequest(session)
    session.ask(lambda document: request.ask(lambda document: 1 / 0, lambda result: None))
    session.ask(lambda document: request.ask(lambda document: 3, lambda result: answered.set()))
    assert answered.wait(600)
    session.close()
    assert "ZeroDivisionError" in caplog.text
