"""A session: the thread that owns a stage, and its thread-safe interface.

    session = Session(lambda publish: Document(stage, publish=publish))
    session.listen(print)                          # pictures and news, in the session's thread
    session.look(ViewState(size=(960, 720)))       # the latest wins
    session.ask(lambda document: properties(document.stage, path), done=show)

Tasks run before pictures, in order, under the document's lock. A picture is drawn without the lock,
from the state that the engine has synced: coarse while the view moves, in full when it rests.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, TypeVar

from usdsplat.core.cancel import CancelToken
from usdsplat.core.errors import UsdSplatError
from usdsplat.core.freed import return_freed_memory
from usdsplat.preview.compiling import telling
from usdsplat.preview.document import Document
from usdsplat.preview.values import Event, Problem, ViewState

T = TypeVar("T")
Listener = Callable[[Event], None]
Task = tuple[Callable[[Document], Any], Callable[[Any], None], Callable[[UsdSplatError], None]]

PATIENCE = 0.3
"""Time after which a change ends the picture of a view at rest [s]. A quicker one is finished, or
a steady change would show none."""
WANTED = ("camera", "look", "other", "purposes", "selected", "shows_bounds", "shows_edges")
"""Fields of the state whose change ends a picture of a view at rest. The others change steadily
without a movement, such as the time of a running simulation, or need no new drawing."""

LOG = logging.getLogger("usdsplat")


class _PictureToken(CancelToken):
    """A token that is cancelled at once, or when its picture has had its time."""

    def __init__(self, state: ViewState | None) -> None:
        super().__init__()
        self.state = state
        self._began = time.monotonic()
        self._is_outdated = False

    def outdate(self) -> None:
        """Let the picture end once it has taken `PATIENCE`."""
        self._is_outdated = True

    def check(self) -> None:
        if self._is_outdated and time.monotonic() - self._began > PATIENCE:
            self.cancel()
        super().check()


class Session:
    """A document in its own thread.

    Args:
        open_document: Function that opens the document; called in the session's thread with
            `publish`, at the first `listen`, `look` or `ask`, so that no event is missed.
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
        self._picture = _PictureToken(None)
        self._is_resting = False
        """Whether the picture in progress is of a view at rest, which a movement cancels. Pictures
        of movements are fast, and each is finished, or a steady movement would show none."""
        self._listeners: tuple[Listener, ...] = ()
        self._news: deque[Event] = deque()
        self._owner = 0
        """Thread that called `turn` last."""
        self._document: Document | None = None
        self._has_failed = False
        self._thread = threading.Thread(target=self._run, name="usdsplat session", daemon=True)
        if own_thread:
            self._thread.start()

    # --- from any thread -------------------------------------------------------------------

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Send all events to `listener`, in the session's thread; return a function that stops
        this."""
        with self._changed:
            self._listeners = (*self._listeners, listener)
            self._changed.notify_all()

        def stop() -> None:
            with self._changed:
                self._listeners = tuple(each for each in self._listeners if each is not listener)

        return stop

    def look(self, state: ViewState) -> None:
        """Set the view state; an earlier one that is not drawn yet is dropped."""
        with self._changed:
            self._state = state
            drawn = self._picture.state
            if state.is_moving and self._is_resting:
                self._picture.cancel()
            elif drawn is not None and any(
                getattr(state, name) != getattr(drawn, name) for name in WANTED
            ):
                self._outdate()
            self._wake()

    def interrupt(self) -> None:
        """End a picture of a view at rest that takes long: the stage is about to be changed, or a
        user waits for an answer. It is drawn again after the tasks."""
        with self._changed:
            self._outdate()

    def ask(
        self,
        task: Callable[[Document], T],
        done: Callable[[T], None] = lambda result: None,
        failed: Callable[[UsdSplatError], None] | None = None,
    ) -> None:
        """Run a task on the document; `done` is called in the session's thread.

        A UsdSplatError is passed to `failed`, or without it published as a `Problem`. An unexpected
        exception is handled in the same way, so that no caller waits forever.
        """
        with self._changed:
            self._tasks.append((task, done, failed or self.complain))
            self._wake()

    def complain(self, error: UsdSplatError) -> None:
        """Publish an error as a `Problem`."""
        self._publish(Problem(sentence=str(error)))

    def wake(self) -> None:
        """Notify the session that the stage may have changed."""
        with self._changed:
            self._wake()

    @property
    def has_failed(self) -> bool:
        """Whether the document could not be opened; problems of an open document do not count."""
        return self._has_failed

    def close(self, timeout: float = 10.0) -> None:
        """End the session and release the document; waiting tasks are dropped."""
        with self._changed:
            self._is_closing = True
            self._picture.cancel()
            self._tasks.clear()
            self._changed.notify_all()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(timeout)
        elif not self._thread.ident:
            self._end()

    @property
    def has_work(self) -> bool:
        """Whether a `turn` has something to do, as far as is known."""
        with self._changed:
            return self._is_stale or bool(self._tasks)

    # --- from the session's thread ---------------------------------------------------------

    def turn(self) -> bool:
        """Run one task or draw one picture; return whether there is more to do.

        For hosts that do not use the session's own thread.
        """
        self._owner = threading.get_ident()
        self._tell_news()
        if self._document is None:
            if not self._has_failed:
                self._begin()
            return self._document is not None or self._drop()
        with self._changed:
            task = self._tasks.popleft() if self._tasks else None
            state = None if self._is_closing else self._state
            if task is None:
                self._is_stale = False
                self._picture = cancel = _PictureToken(state)
                self._is_resting = state is not None and not state.is_moving
        if task is not None:
            self._do(self._document, *task)
            return True
        if state is None:
            return False
        try:
            more = self._document.draw(state, cancel)
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
            except Exception:  # an unexpected exception must not end the window
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
        """Drop requests to a document that failed to open."""
        with self._changed:
            self._tasks.clear()
            self._is_stale = False
        return False

    def _end(self) -> None:
        document, self._document = self._document, None
        self._has_failed = True
        if document is not None:
            document.close()
            del document  # with its stage, which may hold a capture
            return_freed_memory()

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

    def _outdate(self) -> None:
        if self._is_resting:
            self._picture.outdate()
            self._is_stale = True

    def _wake(self) -> None:
        self._is_stale = True
        self._changed.notify_all()

    def _publish(self, event: Event) -> None:
        """Publish an event in the session's thread; simulations publish from their own threads."""
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
            except Exception:  # other listeners and the session continue
                LOG.exception("a bug in a listener of the preview")


def _bug() -> UsdSplatError:
    """Log the current exception and return an error for users."""
    LOG.exception("a bug in the preview")
    return UsdSplatError("preview", "an internal error", "none; see the terminal")
