"""Cancel what is being drawn, from any thread."""

from __future__ import annotations

import threading


class Cancelled(Exception):
    """Raised where work stops because its token was cancelled; unfinished files are removed."""


class CancelToken:
    """A flag that asks for work to stop; it is set once, from any thread."""

    def __init__(self) -> None:
        self._event = threading.Event()

    def cancel(self) -> None:
        """Ask for the work to stop."""
        self._event.set()

    def check(self) -> None:
        """Stop here if that was asked for.

        Raises:
            Cancelled: If it was.
        """
        if self._event.is_set():
            raise Cancelled
