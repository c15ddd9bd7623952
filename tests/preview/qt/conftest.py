"""What tests of windows share: an application without a screen, and patience."""

from __future__ import annotations

import os
import time
from collections.abc import Callable

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

import pytest
from PySide6.QtCore import QDeadlineTimer, QEvent, QEventLoop
from PySide6.QtWidgets import QApplication

PATIENCE = 120.0
"""Seconds until something that should happen is given up; kernels may have to compile first."""


def wait_until(condition: Callable[[], object], *, seconds: float = PATIENCE) -> None:
    """Let the event loop run until something is so; fails if it never is."""
    application = QApplication.instance()
    assert application is not None
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, f"this did not become so in {seconds:g} s"
        application.processEvents(QEventLoop.ProcessEventsFlag.AllEvents, QDeadlineTimer(50))
        application.sendPostedEvents(None, QEvent.Type.DeferredDelete)
        time.sleep(0.002)  # lets the session's thread have the interpreter


@pytest.fixture(scope="session")
def application() -> QApplication:
    """The one application that a process may have."""
    found = QApplication.instance()
    return found if isinstance(found, QApplication) else QApplication(["tests"])
