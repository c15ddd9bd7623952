"""The one thread that touches a stage, and how everybody else talks to it.

    session = Session(lambda publish: Document(stage, publish=publish))
    session.listen(print)                          # pictures and news, in the session's thread
    session.look(ViewState(size=(960, 720)))       # the latest wins
    session.ask(lambda document: properties(document.stage, path), done=show)

Tasks come before pictures and run in their order, under the document's lock. A picture is drawn
without the lock, from what the engine has synced: coarse while the view moves, in full when it
rests.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from typing import Any, TypeVar

from usdsplat.core.errors import UsdSplatError
from usdsplat.preview.compiling import telling
from usdsplat.preview.document import Document
from usdsplat.preview.values import Event, Problem, ViewState

T = TypeVar("T")
Listener = Callable[[Event], None]
Task = tuple[Callable[[Document], Any], Callable[[Any], None], Callable[[UsdSplatError], None]]

LOG = logging.getLogger("usdsplat")


class Session:
    """A document in a thread of its own.

    Args:
        open_document: Called in the session's thread with what it shall publish to, as soon as
            somebody listens, looks or asks, so that nobody misses what it says first.
        own_thread: False for a host that calls `turn` itself, in the thread that owns the stage.
    """

    def __init__(
        self,
        open_document: Callable[[Listener], Document],
        *,
        own_thread: bool = True,
    ) -> None:
        self._open = open_document
        self._changed = threading.Condition()
        self._tasks: deque[Task] = deque()
        self._state: ViewState | None = None
        self._is_stale = True
        self._is_closing = False
        self._listeners: tuple[Listener, ...] = ()
        self._news: deque[Event] = deque()
        self._owner = 0
        """Of `turn`, the last that called it."""
        self._document: Document | None = None
        self._has_failed = False
        self._thread = threading.Thread(target=self._run, name="usdsplat session", daemon=True)
        if own_thread:
            self._thread.start()

    # --- from any thread -------------------------------------------------------------------

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Tell `listener` of everything, in the session's thread; returns how to stop that."""
        with self._changed:
            self._listeners = (*self._listeners, listener)
            self._changed.notify_all()

        def stop() -> None:
            with self._changed:
                self._listeners = tuple(each for each in self._listeners if each is not listener)

        return stop

    def look(self, state: ViewState) -> None:
        """Say what shall be seen; what was asked before and is not begun is forgotten."""
        with self._changed:
            self._state = state
            self._wake()

    def ask(
        self,
        task: Callable[[Document], T],
        done: Callable[[T], None] = lambda result: None,
        failed: Callable[[UsdSplatError], None] | None = None,
    ) -> None:
        """Have something done with the document; `done` is called in the session's thread.

        A UsdSplatError goes to `failed`, or without one becomes a `Problem`. So does a bug, so that
        nobody waits for ever.
        """
        with self._changed:
            self._tasks.append((task, done, failed or self.complain))
            self._wake()

    def complain(self, error: UsdSplatError) -> None:
        """Have an error told as a `Problem`."""
        self._publish(Problem(sentence=str(error)))

    def wake(self) -> None:
        """Say that the stage may have changed."""
        with self._changed:
            self._wake()

    @property
    def has_failed(self) -> bool:
        """Whether there was no document to open; problems of one that opens are remarks."""
        return self._has_failed

    def close(self, timeout: float = 10.0) -> None:
        """End what goes on, and let go of the document; tasks that have not begun are dropped."""
        with self._changed:
            self._is_closing = True
            self._tasks.clear()
            self._changed.notify_all()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(timeout)
        elif not self._thread.ident:
            self._end()

    @property
    def has_work(self) -> bool:
        """Whether a `turn` would do something, as far as the session has been told."""
        with self._changed:
            return self._is_stale or bool(self._tasks)

    # --- from the session's thread ---------------------------------------------------------

    def turn(self) -> bool:
        """Do one task, or draw one picture; return whether there is more to do.

        For hosts without the session's own thread.
        """
        self._owner = threading.get_ident()
        self._tell_news()
        if self._document is None:
            if not self._has_failed:
                self._begin()
            return self._document is not None or self._drop()
        with self._changed:
            task = self._tasks.popleft() if self._tasks else None
            state = self._state
            if task is None:
                self._is_stale = False
        if task is not None:
            self._do(self._document, *task)
            return True
        if state is None:
            return False
        try:
            more = self._document.draw(state)
        except UsdSplatError as error:
            self._publish(Problem(sentence=str(error), of_picture=True))
            more = False
        return more or self.has_work

    # --- private ---------------------------------------------------------------------------

    def _run(self) -> None:
        with self._changed:
            self._changed.wait_for(
                lambda: self._listeners or self._tasks or self._state or self._is_closing
            )
        while not self._is_closing:
            try:
                more = self.turn()
            except Exception:  # a bug must not take the window with it
                self.complain(_bug())
                more = False
            with self._changed:
                while not (more or self._is_stale or self._tasks or self._is_closing):
                    self._changed.wait()
        self._end()

    def _begin(self) -> None:
        try:
            document = self._open(self._publish)
        except UsdSplatError as error:
            self._has_failed = True
            self.complain(error)
            return
        except Exception:
            self._has_failed = True
            raise
        document.wake = self.wake
        self._document = document
        self._publish(document.opened())
        if document.simulation is not None:
            self._publish(document.simulation.status)

    def _drop(self) -> bool:
        """Forget what was asked of a document that is not there."""
        with self._changed:
            self._tasks.clear()
            self._is_stale = False
        return False

    def _end(self) -> None:
        document, self._document = self._document, None
        self._has_failed = True
        if document is not None:
            document.close()

    def _do(
        self,
        document: Document,
        task: Callable[[Document], Any],
        done: Callable[[Any], None],
        failed: Callable[[UsdSplatError], None],
    ) -> None:
        try:
            with telling(document.publish), document.lock:
                result = task(document)
        except UsdSplatError as error:
            failed(error)
        except Exception:
            failed(_bug())
        else:
            done(result)

    def _wake(self) -> None:
        self._is_stale = True
        self._changed.notify_all()

    def _publish(self, event: Event) -> None:
        """Tell everybody, in the session's thread: a simulation has news in threads of its own."""
        if threading.get_ident() == self._owner:
            self._tell_news()
            self._tell(event)
            return
        with self._changed:
            self._news.append(event)
            self._wake()

    def _tell_news(self) -> None:
        while True:
            with self._changed:
                event = self._news.popleft() if self._news else None
            if event is None:
                return
            self._tell(event)

    def _tell(self, event: Event) -> None:
        for listener in self._listeners:
            try:
                listener(event)
            except Exception:  # others want to hear it, and the session goes on
                LOG.exception("a bug in who listens to the preview")


def _bug() -> UsdSplatError:
    """What users hear of the exception that is being handled; the terminal gets its traceback."""
    LOG.exception("a bug in the preview")
    return UsdSplatError("preview", "a bug", "none; see the terminal")
