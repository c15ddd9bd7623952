"""A session's events as Qt signals, delivered in the thread of the window.

    proxy = SessionProxy(session)
    proxy.picture.connect(viewport.show_picture)
    proxy.ask(partial(properties, path=path), done=panel.show_rows)

If pictures arrive faster than the window shows them, only the latest is delivered. All other events
are delivered once and in order. After `close` nothing is delivered.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, TypeVar

from PySide6.QtCore import QObject, Qt, Signal

from usdsplat.core.errors import UsdSplatError
from usdsplat.preview.document import Document
from usdsplat.preview.session import Session
from usdsplat.preview.values import (
    Busy,
    Event,
    Opened,
    Picture,
    Problem,
    SimulationStatus,
    StageChanged,
    ViewState,
)

T = TypeVar("T")


class SessionProxy(QObject):
    """Proxy of a session for the widgets of one window; created and used in the window's thread.

    Args:
        session: The session.
        parent: Qt parent.
    """

    picture = Signal(object)
    opened = Signal(object)
    stage_changed = Signal(object)
    simulation = Signal(object)
    problem = Signal(object)
    busy = Signal(object)

    _news = Signal(object)
    _picture_waits = Signal()
    _answer = Signal(object, object)

    def __init__(self, session: Session, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.session = session
        self._lock = threading.Lock()
        self._is_closed = False
        self._latest: Picture | None = None
        self._signals: dict[type, Any] = {
            Opened: self.opened,
            StageChanged: self.stage_changed,
            SimulationStatus: self.simulation,
            Problem: self.problem,
            Busy: self.busy,
        }
        queued = Qt.ConnectionType.QueuedConnection
        self._news.connect(self._deliver, queued)
        self._picture_waits.connect(self._deliver_picture, queued)
        self._answer.connect(self._deliver_answer, queued)
        self._stop_listening = session.listen(self._heard)

    def look(self, state: ViewState) -> None:
        """Set the view state."""
        self.session.look(state)

    def ask(
        self,
        task: Callable[[Document], T],
        done: Callable[[T], None] | None = None,
        failed: Callable[[UsdSplatError], None] | None = None,
    ) -> None:
        """Run a task on the document; `done` or `failed` is called in this thread.

        Without `failed`, an error becomes a `problem`.
        """
        self.session.ask(
            task,
            lambda result: self.call(done, result) if done else None,
            lambda error: self.call(failed or self.complain, error),
        )

    def interrupt(self) -> None:
        """End a long picture of a view at rest, see `Session.interrupt`."""
        self.session.interrupt()

    def complain(self, error: UsdSplatError) -> None:
        """Report an error as a `problem`."""
        self._heard(Problem(sentence=str(error)))

    def call(self, call: Callable[[Any], None], value: Any) -> None:
        """Call a function in the window's thread, from any thread; dropped after `close`."""
        self._send(self._answer, call, value)

    def close(self) -> None:
        """Stop delivering. The session itself continues."""
        with self._lock:
            self._is_closed = True
            self._latest = None
        self._stop_listening()

    # --- in any thread -----------------------------------------------------------------------

    def _heard(self, event: Event) -> None:
        if not isinstance(event, Picture):
            self._send(self._news, event)
            return
        with self._lock:
            is_first = self._latest is None
            self._latest = event
        if is_first:
            self._send(self._picture_waits)

    def _send(self, signal: Any, *arguments: Any) -> None:
        with self._lock:  # a window that closes meanwhile would leave a deleted object
            if not self._is_closed:
                signal.emit(*arguments)

    # --- in the window's thread --------------------------------------------------------------

    def _deliver(self, event: Event) -> None:
        if not self._is_closed:
            self._signals[type(event)].emit(event)

    def _deliver_picture(self) -> None:
        with self._lock:
            picture, self._latest = self._latest, None
        if picture is not None:
            self.picture.emit(picture)

    def _deliver_answer(self, call: Callable[[Any], None], result: Any) -> None:
        if not self._is_closed:
            call(result)
