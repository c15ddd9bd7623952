"""Our docks in one usdview: viewport and panels of the window, on usdview's stage.

usdview owns its stage and the thread that uses it, so the session has no thread: a timer calls it.
A simulation has a thread, and may use the stage only while the document's lock is released, for a
moment of every turn.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from PySide6.QtCore import QCoreApplication, QEvent, QObject, Qt, QTimer
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QDockWidget, QWidget

from usdsplat.preview.document import Document
from usdsplat.preview.opening import document_of
from usdsplat.preview.qt import style
from usdsplat.preview.qt.session_proxy import SessionProxy
from usdsplat.preview.qt.workspace import Workspace
from usdsplat.preview.session import Session
from usdsplat.preview.usdview.following import Following
from usdsplat.preview.values import Busy, Event, Opened, Problem

TITLES = {
    "viewport": "Splat Viewport",
    "simulation": "Splat Simulation",
    "settings": "Splat Render Settings",
    "probe": "Splat Probe",
}
IDLE = 20
"""Interval at which usdview is polled [ms]."""
MOMENT = 0.001
"""Time per turn in which a simulation may take the lock; it keeps it until it is done [s]."""

PANEL = 340
"""Initial width of panels, where there is room [pixel]."""
PLAIN = f"QWidget {{ color: {style.TEXT.name()}; background: {style.GROUND.name()}; }}"
TITLE = f"QDockWidget::title {{ background: {style.GROUND.name()}; padding: 4px; }}"
SHEET = PLAIN + TITLE + style.sheet()
"""Style sheet of our docks: they would otherwise take colours from usdview's palette."""

LOG = logging.getLogger("usdsplat")


@dataclass(slots=True, kw_only=True)
class View:
    """Our objects for one stage of usdview."""

    session: Session
    proxy: SessionProxy
    document: Document | None = None
    workspace: Workspace | None = None
    following: Following | None = None

    def panel(self, name: str) -> QWidget:
        """Return the widget of a dock; empty until the stage has been read."""
        if self.workspace is None:
            return QWidget()
        return {
            "viewport": self.workspace.center,
            "simulation": self.workspace.simulation,
            "settings": self.workspace.render_panel,
            "probe": self.workspace.probe,
        }[name]


class Host(QObject):
    """Our docks and session in one main window of usdview, owned by that window."""

    def __init__(self, api: Any) -> None:
        super().__init__(api.qMainWindow)
        self._api = api
        self._device = "auto"
        self._follows_camera = False
        self._docks: dict[str, QDockWidget] = {}
        self._view: View | None = None
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._turn)
        api.dataModel.signalStageReplaced.connect(self._begin)
        api.dataModel.signalPrimsChanged.connect(self._wake)
        application = QCoreApplication.instance()
        assert application is not None
        application.aboutToQuit.connect(self._end)

    @classmethod
    def of(cls, api: Any) -> Host:
        """Return the host of usdview's main window, made on first use."""
        there = (child for child in api.qMainWindow.children() if isinstance(child, cls))
        return next(there, None) or cls(api)

    def show(self, name: str) -> None:
        """Run a menu command: open the dock of that name, or follow the camera."""
        if name == "camera":
            self._follows_camera = not self._follows_camera
            word = "follows" if self._follows_camera else "no longer follows"
            self._say(f"the viewport {word} usdview's camera")
            return
        dock = self._docks.get(name) or self._add(name)
        dock.show()
        dock.raise_()
        if self._view is None:
            self._begin()

    def use_device(self, name: str) -> None:
        """Draw and simulate on another device from now on."""
        self._device = name
        self._begin()

    # --- docks -----------------------------------------------------------------------------

    def _add(self, name: str) -> QDockWidget:
        window = self._api.qMainWindow
        dock = QDockWidget(TITLES[name], window)
        dock.setObjectName(f"usdsplat {name}")
        dock.setStyleSheet(SHEET)
        window.addDockWidget(Qt.DockWidgetArea.RightDockWidgetArea, dock)
        panels = [other for key, other in self._docks.items() if key != "viewport"]
        if name != "viewport" and panels:
            window.tabifyDockWidget(panels[-1], dock)
        elif name != "viewport" and "viewport" in self._docks:
            viewport = self._docks["viewport"]
            window.splitDockWidget(viewport, dock, Qt.Orientation.Horizontal)
            window.resizeDocks([viewport, dock], [2 * PANEL, PANEL], Qt.Orientation.Horizontal)
        self._docks[name] = dock
        if self._view is not None:
            self._fill(name, self._view.panel(name))
        return dock

    def _fill(self, name: str, panel: QWidget) -> None:
        self._docks[name].setWidget(panel)
        panel.show()

    @property
    def _is_open(self) -> bool:
        """Return whether any dock is open."""
        return any(dock.toggleViewAction().isChecked() for dock in self._docks.values())

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Pass plain letters to the viewport; elsewhere they are shortcuts of usdview."""
        if event.type() == QEvent.Type.ShortcutOverride and isinstance(event, QKeyEvent):
            is_plain = not event.modifiers() & ~Qt.KeyboardModifier.ShiftModifier
            if is_plain and Qt.Key.Key_A <= event.key() <= Qt.Key.Key_Z:
                event.accept()
        return False

    # --- a stage ---------------------------------------------------------------------------

    def _begin(self) -> None:
        """Open a session for usdview's current stage, in place of the previous one."""
        self._end()
        stage = self._api.stage
        if stage is None or not self._is_open:
            return
        session = Session(lambda publish: self._read(stage, publish), own_thread=False)
        session.listen(self._tell)
        self._view = View(session=session, proxy=SessionProxy(session))
        self._view.proxy.opened.connect(self._opened)
        self._timer.start(0)

    def _read(self, stage: Any, publish: Callable[[Event], None]) -> Document:
        """Return a document of usdview's stage, with its lock taken by this thread."""
        assert self._view is not None
        document = document_of(stage, device=self._device, publish=publish)
        document.lock.acquire()
        self._view.document = document
        return document

    def _opened(self, event: Opened) -> None:
        """Fill the docks, and start following usdview."""
        view = self._view
        if view is None:
            return
        workspace = view.workspace = Workspace(view.proxy, event, device=self._device)
        workspace.device_chosen.connect(self.use_device)
        workspace.viewport.installEventFilter(self)
        view.following = Following(self._api, workspace.context.viewer)
        for name in self._docks:
            self._fill(name, view.panel(name))

    def _end(self) -> None:
        """Close the session and release the stage."""
        self._timer.stop()
        view, self._view = self._view, None
        if view is None:
            return
        view.proxy.close()
        if view.document is not None:
            view.document.lock.release()  # else a simulation waiting for it never ends
        view.session.close()
        for dock in self._docks.values():
            old = dock.widget()
            dock.setWidget(QWidget())
            if old is not None:
                old.deleteLater()
        (view.workspace or view.proxy).deleteLater()

    # --- a turn ----------------------------------------------------------------------------

    def _turn(self) -> None:
        view = self._view
        if view is None or not self._is_open:
            self._end()
            return
        if view.following is not None:
            view.following.update(with_camera=self._follows_camera)
        try:
            is_busy = view.session.has_work and view.session.turn()
        except Exception:  # a bug of ours must not end usdview, nor repeat every turn
            LOG.exception("a bug in usdsplat's docks")
            self._say("found an internal error, expected none; see the terminal")
            self._end()
            return
        if view.document is not None:
            view.document.lock.release()
            time.sleep(MOMENT)
            view.document.lock.acquire()
        self._timer.setInterval(0 if is_busy else IDLE)

    def _wake(self) -> None:
        """Wake the session after an edit of the stage."""
        if self._view is not None:
            self._view.session.wake()

    def _tell(self, event: Event) -> None:
        if isinstance(event, Problem):
            self._say(event.sentence)
        elif isinstance(event, Busy) and event.what:
            self._say(event.what)

    def _say(self, sentence: str) -> None:
        """Show a sentence in usdview's status bar at once, as the following work may take long."""
        self._api.PrintStatus(f"usdsplat: {sentence}")
        self._api.qMainWindow.statusBar().repaint()
