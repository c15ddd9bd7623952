"""Tests of the shared state of a session's panels."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from PySide6.QtWidgets import QApplication

from tests.preview.fakes import OPENED
from tests.preview.qt.conftest import wait_until
from usdsplat.core.errors import UsageError
from usdsplat.preview.qt.panel_context import PanelContext
from usdsplat.preview.qt.session_proxy import SessionProxy
from usdsplat.preview.session import Session

PATIENCE = 20.0  # s; only a failure takes as long


@pytest.fixture
def context(application: QApplication) -> Iterator[PanelContext]:
    """Of a document that has edits, and nothing else."""
    edits = SimpleNamespace(undoable="Set", redoable=None, has_unsaved=True)
    document = SimpleNamespace(
        edits=edits,
        lock=threading.RLock(),
        opened=lambda: OPENED,
        simulation=None,
        wake=None,
        publish=lambda event: None,
        close=lambda: None,
    )
    session = Session(lambda publish: document)
    yield PanelContext(SessionProxy(session))
    session.close()


def test_of_a_drag_that_is_faster_than_the_stage_the_last_step_counts(
    context: PanelContext,
) -> None:
    """Oracle: the first step is under way, the last one waits; steps alone are all done."""
    may_go_on = threading.Event()
    steps: list[tuple[str, int]] = []

    def step(name: str, number: int) -> Callable[[Any], object]:
        return lambda edits: steps.append((name, number))

    context.proxy.ask(lambda document: may_go_on.wait(PATIENCE))
    for number in range(100):
        context.edit(step("drag", number), drag="of a slider")
    for number in range(3):
        context.edit(step("alone", number))
    may_go_on.set()
    wait_until(lambda: len(steps) == 5)
    assert [step for step in steps if step[0] == "drag"] == [("drag", 0), ("drag", 99)]


def test_a_drag_goes_on_after_a_step_that_cannot_be_done(context: PanelContext) -> None:
    """Oracle: the sentence, the old value is asked for, and the next step is done."""
    sentences: list[str] = []
    told: list[tuple[object, object]] = []
    back: list[bool] = []
    context.proxy.problem.connect(lambda problem: sentences.append(problem.sentence))
    context.history_changed.connect(lambda *names: told.append(names))

    def wrong(edits: object) -> None:
        raise UsageError("here", "nothing", "something")

    context.edit(wrong, failed=lambda: back.append(True), drag="d")
    wait_until(lambda: back)
    assert sentences == ["here: found nothing, expected something"]
    context.edit(lambda edits: None, drag="d")
    wait_until(lambda: told)
    assert told == [("Set", None)]
