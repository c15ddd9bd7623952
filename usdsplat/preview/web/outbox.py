"""Queue messages and pictures for one page.

The queue stays small even if a page is slow or silent: newer messages replace older ones of their
kind, and pictures wait until the link has room, see `stream`.
"""

from __future__ import annotations

import asyncio
from typing import Any

from usdsplat.core.errors import UsageError
from usdsplat.preview.values import Picture
from usdsplat.preview.web.messages import written
from usdsplat.preview.web.stream import Download, Order, PictureStream

MOST_NEWS = 200
"""Most messages that wait; of more, which only a page that reads nothing has, the oldest go,
except for those that are kept."""


class Outbox:
    """Messages and pictures for one page, used in the server's thread."""

    def __init__(self) -> None:
        self.stream = PictureStream()
        self._news: dict[str, str] = {}
        self._known: dict[str, str] = {}
        self._changed = asyncio.Event()

    def tell(self, kind: str, content: Any, *, subject: str = "") -> None:
        """Queue a message, replacing an unsent one of the same kind and subject."""
        self._news[f"{kind} {subject}"] = written(kind, content)
        others = (key for key in tuple(self._news) if key.removesuffix(" ") not in self._known)
        while len(self._news) > MOST_NEWS:
            del self._news[next(others)]
        self._changed.set()

    def keep(self, kind: str, content: Any) -> None:
        """Queue a message unless the page has it: a state, which would cross a slow link with
        every move of the pointer."""
        text = written(kind, content)
        if self._known.get(kind) != text:
            self._known[kind] = self._news[f"{kind} "] = text
            self._changed.set()

    def send(self, download: Download) -> None:
        """Queue a file that the page saves, or a sentence if too much waits already."""
        try:
            self.stream.send(download)
        except UsageError as error:
            self.tell("problem", str(error))
        self._changed.set()

    def show(self, picture: Picture) -> None:
        """Queue a picture, replacing one that was not sent."""
        self.stream.show(picture)
        self._changed.set()

    def acknowledged(self, message: int) -> None:
        """Record that a message with a picture arrived."""
        self.stream.acknowledged(message, asyncio.get_running_loop().time())
        self._changed.set()

    async def taken(self) -> tuple[tuple[str, ...], bytes | Order | None]:
        """Return what to send now, waiting until there is something: messages, then a part of a
        picture, or a picture to encode and pass to `stream.take` first."""
        while True:
            self._changed.clear()
            news, self._news = tuple(self._news.values()), {}
            now = asyncio.get_running_loop().time()
            found = (
                self.stream.next(now) or self.stream.order() or self.stream.next_of_download(now)
            )
            if news or found is not None:
                return news, found
            await self._changed.wait()
