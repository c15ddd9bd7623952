"""Fixtures for tests of windows: an application without a display, and waiting for conditions."""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

import pytest

try:
    from PySide6.QtCore import QEventLoop, QSettings, QTimer
    from PySide6.QtWidgets import QApplication
except ImportError as error:  # Qt needs libraries of the system, such as libEGL
    warnings.warn(f"windows are not tested: {error}", stacklevel=1)
    collect_ignore_glob = ["test_*.py"]

if TYPE_CHECKING:
    from tests.preview.qt.bench import Bench
    from usdsplat.preview.qt.window import Window
    from usdsplat.preview.qt.workspace import Workspace

PATIENCE = 120.0
"""Seconds until something that should happen is given up; kernels may have to compile first."""


def wait_until(condition: Callable[[], object], *, seconds: float = PATIENCE) -> None:
    """Let the event loop run until something is so; fails if it never is."""
    assert QApplication.instance() is not None
    deadline = time.monotonic() + seconds
    # A loop that runs deletes what is to be deleted later. QApplication.sendPostedEvents would too,
    # but PySide 6.12 lets go of a None with each call, until Python ends for the lack of it.
    loop, timer = QEventLoop(), QTimer()  # QTimer.singleShot leaks, see benchmarks.window_latency
    timer.timeout.connect(loop.quit)
    timer.start(5)
    while not condition():
        assert time.monotonic() < deadline, f"this did not become so in {seconds:g} s"
        loop.exec()


@pytest.fixture(scope="session")
def application() -> QApplication:
    """The one application that a process may have."""
    found = QApplication.instance()
    return found if isinstance(found, QApplication) else QApplication(["tests"])


@pytest.fixture
def bench(application: QApplication) -> Iterator[Bench]:
    """A viewport before a session that remembers; closed in the end."""
    from tests.preview.qt.bench import Bench

    made = Bench()
    yield made
    made.viewport.close()


@pytest.fixture(autouse=True)
def _settings_of_a_new_user(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Windows remember nothing of the user who runs the tests, and nothing for them."""
    folder = tmp_path_factory.mktemp("settings")
    QSettings.setPath(QSettings.Format.IniFormat, QSettings.Scope.UserScope, str(folder))


@pytest.fixture
def window(application: QApplication) -> Iterator[Window]:
    """A window of nothing; closed in the end."""
    from tests.preview.qt import windows
    from usdsplat.preview.qt.window import Window

    window = windows.show(Window())
    yield window
    window.leave()


@pytest.fixture(scope="session")
def stage_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The stage that most tests open; none writes it."""
    from tests.preview.qt import windows

    return windows.write_stage(tmp_path_factory.mktemp("stage") / "two.usda")


@pytest.fixture
def workspace(window: Window, stage_path: Path) -> Workspace:
    """What the window shows of that stage."""
    from tests.preview.qt import windows

    return windows.opened(window, stage_path)
