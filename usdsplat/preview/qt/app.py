"""Run the application until the last window is closed, or a signal such as Ctrl-C ends it."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from types import FrameType

from PySide6.QtCore import QObject, QTimer
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication

from usdsplat.core.interrupt import SIGNALS
from usdsplat.preview.qt import style
from usdsplat.preview.qt.glyphs import window_icon
from usdsplat.preview.qt.opening_again import Opener
from usdsplat.preview.qt.window import Window
from usdsplat.preview.values import Opened

LISTEN = 200
"""Interval at which Python checks for signals while Qt waits [ms]."""


class Windows(QObject):
    """All windows of an application; each has its own session.

    Args:
        device, threads: As `Engine` takes them.
    """

    def __init__(self, *, device: str = "auto", threads: int | None = None) -> None:
        super().__init__()
        self._device = device
        self._threads = threads
        self.open: list[Window] = []

    def new(self, path: Path | None = None) -> Window:
        """Show another window, with a file if given."""
        window = Window(device=self._device, threads=self._threads)
        self.open.append(window)
        window.new_requested.connect(self.new)
        window.closed.connect(lambda: self.open.remove(window))
        window.show()
        if path is not None:
            window.open(path)
        return window


def run(
    first: Opener | Path | None = None,
    *,
    path: Path | None = None,
    camera: str | None = None,
    time: float | None = None,
    device: str = "auto",
    threads: int | None = None,
) -> int:
    """Show a window until the last one is closed; return the exit status.

    Args:
        first: Content of the first window: a path, a function that opens a document and is called
            with `publish`, or nothing.
        path: File that such a function opens; None if there is none.
        camera: Path of the initial camera; None frames everything.
        time: Initial time code; None is the first.
        device, threads: As `Engine` takes them.
    """
    application = QApplication.instance()
    if not isinstance(application, QApplication):
        application = QApplication(["usdsplat"])
        style.dress(application)
    application.setApplicationName("usdsplat")
    application.setWindowIcon(window_icon())
    QGuiApplication.setDesktopFileName("usdsplat")
    windows = Windows(device=device, threads=threads)
    window = windows.new(first if isinstance(first, Path) else None)
    window.opened.connect(_once(lambda opened: _begin(window, camera, time)))
    if first is not None and not isinstance(first, Path):
        window.open_with(first, path=path)

    def interrupt(number: int, frame: FrameType | None) -> None:
        application.exit(128 + number)  # an exception would be lost in Qt's loop

    before = {each: signal.getsignal(each) for each in SIGNALS}
    for each, handler in before.items():
        if handler != signal.SIG_IGN:
            signal.signal(each, interrupt)
    listening = QTimer()
    listening.timeout.connect(lambda: None)  # lets Python's signal handlers run
    listening.start(LISTEN)
    try:
        return application.exec()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for each in tuple(windows.open):
            each.leave()


def _begin(window: Window, camera: str | None, time: float | None) -> None:
    if window.workspace is not None:
        viewer = window.workspace.context.viewer
        if camera is not None:
            viewer.use_camera(camera)
        if time is not None:
            viewer.set_time(time)


def _once(call: Callable[[Opened], None]) -> Callable[[Opened], None]:
    """Return a function that runs once, because later stages have other cameras."""
    waiting = [call]

    def called(opened: Opened) -> None:
        if waiting:
            waiting.pop()(opened)

    return called
