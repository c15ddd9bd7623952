"""Tests that events of a simulation reach a window through the session."""

from __future__ import annotations

import threading
from pathlib import Path

from tests.preview.simulating.hosts import PATIENCE, shot
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
