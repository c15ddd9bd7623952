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
    """A session, or a bridge to one that calls `done` and `failed` in the thread that asked."""

    def look(self, state: ViewState, /) -> None:
        """Say what shall be seen."""

    def ask(self, task: Callable[[Any], Any], done: Done, failed: Failed | None = None, /) -> None:
        """Have something done with the document."""

    def complain(self, error: UsdSplatError, /) -> None:
        """Have an error told as a `Problem`."""


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
        """Whether an answer is to come."""
        return self._is_asking

    def ask(self, task: Callable[[Any], Any], done: Done, failed: Failed | None = None) -> None:
        """Have it done, now or after what is being done; arguments as `Session.ask` takes them."""
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
