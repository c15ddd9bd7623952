"""Request queue of length one: a newer request replaces a waiting one. For drags and panels."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

from usdsplat.core.errors import UsdSplatError
from usdsplat.preview.values import ViewState

Done = Callable[[Any], None]
Failed = Callable[[UsdSplatError], None]


class Asks(Protocol):
    """A session, or a proxy that calls `done` and `failed` in the caller's thread."""

    def look(self, state: ViewState, /) -> None:
        """Set the view state."""

    def ask(self, task: Callable[[Any], Any], done: Done, failed: Failed | None = None, /) -> None:
        """Run a task on the document."""

    def complain(self, error: UsdSplatError, /) -> None:
        """Report an error as a `Problem`."""


class LatestRequest:
    """Sends one request at a time to a session; a newer request replaces a waiting one.

    Args:
        session: Receives the requests.
    """

    def __init__(self, session: Asks) -> None:
        self._session = session
        self._is_asking = False
        self._next: tuple[Callable[[Any], Any], Done, Failed | None] | None = None

    @property
    def is_busy(self) -> bool:
        """Whether a request is in progress."""
        return self._is_asking

    def ask(self, task: Callable[[Any], Any], done: Done, failed: Failed | None = None) -> None:
        """Send a request, now or after the current one; arguments as in `Session.ask`."""
        if self._is_asking:
            self._next = task, done, failed
            return
        self._is_asking = True
        refused = failed or self._session.complain
        self._session.ask(task, partial(self._answered, done), partial(self._answered, refused))

    def _answered(self, call: Callable[[Any], None], result: Any) -> None:
        self._is_asking = False
        waiting, self._next = self._next, None
        if waiting is not None:
            self.ask(*waiting)
        call(result)
