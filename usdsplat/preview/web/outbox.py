"""Queue messages for one page, keeping only the latest of each kind.

The queue stays small even if a page is slow or silent: newer messages replace older ones of their
kind, and a frame is sent only after the last one was acknowledged.
"""

from __future__ import annotations

import asyncio
from typing import Any

from usdsplat.preview.values import Picture
from usdsplat.preview.web.messages import written


class Outbox:
    """Messages and a picture for one page, used in the server's thread."""

    def __init__(self) -> None:
        self._news: dict[str, str] = {}
        self._picture: Picture | None = None
        self._sent: int | None = None
        self._changed = asyncio.Event()

    def tell(self, kind: str, content: Any) -> None:
        """Queue a message, replacing an unsent one of the same kind."""
        self._news[kind] = written(kind, content)
        self._changed.set()

    def show(self, picture: Picture) -> None:
        """Queue a picture; it is sent when the previous one was acknowledged."""
        self._picture = picture
        self._changed.set()

    def acknowledged(self, number: int) -> None:
        """Record that a picture was shown; numbers other than the last sent one are ignored."""
        if number == self._sent:
            self._sent = None
            self._changed.set()

    async def taken(self) -> tuple[tuple[str, ...], Picture | None]:
        """Return what to send now, messages first, waiting until there is something."""
        while not (self._news or self._is_due()):
            self._changed.clear()
            await self._changed.wait()
        news, self._news = tuple(self._news.values()), {}
        picture = None
        if self._is_due():
            picture, self._picture = self._picture, None
            self._sent = None if picture is None else picture.number
        return news, picture

    def _is_due(self) -> bool:
        return self._picture is not None and self._sent is None
