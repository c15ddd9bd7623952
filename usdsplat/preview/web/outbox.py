"""What waits to be told to one page: the latest of each kind, and never more.

A page that is slow, or that does not answer, makes nothing grow: newer news take the place of older
ones, and a frame is sent only after the last one was acknowledged.
"""

from __future__ import annotations

import asyncio
from typing import Any

from usdsplat.preview.values import Picture
from usdsplat.preview.web.messages import written


class Outbox:
    """For one page, in the server's thread."""

    def __init__(self) -> None:
        self._news: dict[str, str] = {}
        self._picture: Picture | None = None
        self._sent: int | None = None
        self._changed = asyncio.Event()

    def tell(self, kind: str, content: Any) -> None:
        """Have the page told; what it was not told yet of this kind, it never will."""
        self._news[kind] = written(kind, content)
        self._changed.set()

    def show(self, picture: Picture) -> None:
        """Have the page shown a picture, as soon as it has the one before."""
        self._picture = picture
        self._changed.set()

    def acknowledged(self, number: int) -> None:
        """Note that a picture has arrived; others than the one that was sent do not count."""
        if number == self._sent:
            self._sent = None
            self._changed.set()

    async def taken(self) -> tuple[tuple[str, ...], Picture | None]:
        """What is to be sent now, news first; waits until there is something."""
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
