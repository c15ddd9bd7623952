"""A session's events and answers, delivered in the server's thread, with a bounded queue.

Only the latest picture is delivered. Of requests with the same key only the latest waits while
another is being answered.
"""

from __future__ import annotations

import asyncio
import threading
from collections import Counter
from collections.abc import Callable
from typing import Any, TypeVar

from usdsplat.core.errors import UsdSplatError
from usdsplat.preview.document import Document
from usdsplat.preview.latest_request import LatestRequest
from usdsplat.preview.session import Session
from usdsplat.preview.values import Event, Picture, Problem, ViewState

T = TypeVar("T")

MOST = 64
"""Requests of one asker that may wait for answers."""


class SessionProxy:
    """Proxy of a session for a server; created and used in the server's thread.

    Args:
        session: The session.
        heard: Called with each event, in the thread of the running loop.
    """

    def __init__(self, session: Session, *, heard: Callable[[Event], None]) -> None:
        self._session = session
        self._heard = heard
        self._loop = asyncio.get_running_loop()
        self._lock = threading.Lock()
        self._is_closed = False
        self._latest: Picture | None = None
        self._asked: Counter[object] = Counter()
        self._keys: dict[str, LatestRequest] = {}
        self._stop_listening = session.listen(self._happened)

    def is_overrun(self, asker: object = None) -> bool:
        """Return whether too many requests of an asker wait for answers."""
        return self._asked[asker] >= MOST

    def look(self, state: ViewState) -> None:
        """Request a view from the session."""
        self._session.look(state)

    def ask(
        self,
        task: Callable[[Document], T],
        done: Callable[[T], None] = lambda result: None,
        failed: Callable[[UsdSplatError], None] | None = None,
        *,
        key: str | None = None,
        asker: object = None,
    ) -> None:
        """Run a task on the document; `done` or `failed` is called in this thread.

        Args:
            task: Task, run in the session's thread.
            done: Called with the task's result.
            failed: Called with its error; by default the error is reported as a `Problem`.
            key: Key of requests of which only the latest matters.
            asker: Who asks; the requests of each are counted apart.
        """
        if key is not None:
            self._keys = {name: each for name, each in self._keys.items() if each.is_busy}
            self._keys.setdefault(key, LatestRequest(_Asker(self, asker))).ask(task, done, failed)
            return
        self._asked[asker] += 1
        self._session.ask(
            task,
            lambda result: self._post(self._answered, asker, done, result),
            lambda error: self._post(self._answered, asker, failed or self.complain, error),
        )

    def complain(self, error: UsdSplatError) -> None:
        """Report an error as a `Problem`."""
        self._heard(Problem(sentence=str(error)))

    def close(self) -> None:
        """Stop all deliveries. The session itself goes on."""
        with self._lock:
            self._is_closed = True
        self._stop_listening()

    # --- in the server's thread ------------------------------------------------------------

    def _answered(self, asker: object, call: Callable[[Any], None], result: Any) -> None:
        self._asked[asker] -= 1
        if not self._asked[asker]:
            del self._asked[asker]  # pages come and go
        call(result)

    def _deliver_picture(self) -> None:
        with self._lock:
            picture, self._latest = self._latest, None
        if picture is not None:
            self._heard(picture)

    # --- in the session's thread -----------------------------------------------------------

    def _happened(self, event: Event) -> None:
        if not isinstance(event, Picture):
            self._post(self._heard, event)
            return
        with self._lock:
            is_first, self._latest = self._latest is None, event
        if is_first:
            self._post(self._deliver_picture)

    def _post(self, call: Callable[..., None], *arguments: Any) -> None:
        with self._lock:  # a loop that closes meanwhile would raise
            if not self._is_closed:
                self._loop.call_soon_threadsafe(call, *arguments)


class _Asker:
    """The proxy as one asker sees it."""

    def __init__(self, proxy: SessionProxy, asker: object) -> None:
        self._proxy, self._name = proxy, asker
        self.look, self.complain = proxy.look, proxy.complain

    def ask(
        self,
        task: Callable[[Document], Any],
        done: Callable[[Any], None],
        failed: Callable[[UsdSplatError], None] | None = None,
    ) -> None:
        """Run a task on the document for this asker."""
        self._proxy.ask(task, done, failed, asker=self._name)
