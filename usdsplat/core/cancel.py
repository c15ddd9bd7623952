"""Cancel running work from any thread."""

from __future__ import annotations

import threading


class Cancelled(Exception):
    """Signal that work stopped because its token was cancelled. Unfinished files are removed."""


class CancelToken:
    """Flag that requests work to stop. It can be set from any thread and is never cleared."""

    def __init__(self) -> None:
        self._event = threading.Event()

    def cancel(self) -> None:
        """Request the work to stop."""
        self._event.set()

    def check(self) -> None:
        """Raise an error if a stop was requested.

        Raises:
            Cancelled: If a stop was requested.
        """
        if self._event.is_set():
            raise Cancelled
