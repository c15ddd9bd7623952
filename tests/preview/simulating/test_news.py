"""Tests that events of a simulation reach a window through the session."""

from __future__ import annotations

import threading
from pathlib import Path

from tests.preview.simulating.hosts import PATIENCE, running, shot
from usdsplat.preview.document import Document
from usdsplat.preview.session import Session
from usdsplat.preview.simulating.runner import Runner
from usdsplat.preview.values import Event, SimulationStatus


def test_news_of_other_threads_are_told_in_the_sessions(tmp_path: Path) -> None:
    """Oracle: the name of the thread in which each event comes; nothing is lost and order is kept:
    frames come one after the other."""
    stage = shot(tmp_path, {"particles:enabled": True}, last=20)
    told: list[SimulationStatus] = []
    threads: set[str] = set()
    ended = threading.Event()

    def listen(event: Event) -> None:
        threads.add(threading.current_thread().name)
        if isinstance(event, SimulationStatus):
            told.append(event)
            if "the last frame" in event.message:
                ended.set()

    def open_document(publish) -> Document:
        document = Document(stage, publish=publish)
        document.simulation = Runner(document, is_paced=False)
        return document

    session = Session(open_document)
    session.listen(listen)
    try:
        session.ask(lambda document: document.simulation.run())
        assert ended.wait(PATIENCE)
    finally:
        session.ask(lambda document: document.simulation.close())
        session.close()
    assert threads == {"usdsplat session"}
    assert [each.frame for each in told if each.seconds][:20] == [float(n) for n in range(1, 21)]


def test_what_was_chosen_for_the_user_is_a_note_and_no_message(tmp_path: Path) -> None:
    """Oracle: the meaning of the finding's code; a budget that the user chose is a message."""
    values = {"dissolve:enabled": True, "refine:spacing": 1e-3}
    for budget, is_chosen in ((-1, False), (10, True)):
        (tmp_path / str(budget)).mkdir()
        stage = shot(tmp_path / str(budget), {**values, "refine:budget": budget}, last=2)
        with running(stage) as (host, runner):
            runner.step()
            status = host.reached(1.0)
        notes = ("Splats stay larger than refine:maxSize, because there are enough already.",)
        assert status.notes == (() if is_chosen else notes)
        assert ("refine:budget" in status.message) == is_chosen
