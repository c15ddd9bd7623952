"""Raw HTTP and a socket to the web view's server, without a browser."""

from __future__ import annotations

import http.client
import json
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

from websockets.sync.client import ClientConnection, connect

from tests.preview.web.fakes import FakeDocument
from usdsplat.preview.session import Session
from usdsplat.preview.web.server import serve

PATIENCE = 20.0  # s; only a failure takes as long


class Host:
    """A session with a fake document, and its server."""

    def __init__(self, **options: Any) -> None:
        self.documents: list[FakeDocument] = []
        self.session = Session(self._open)
        self.server = serve(self.session, **options)
        parts = urlsplit(self.server.url)
        self.address = parts.netloc
        self.path = parts.path

    @property
    def document(self) -> FakeDocument:
        return self.documents[0]

    def close(self) -> None:
        for document in self.documents:
            document.may_go_on.set()
        self.server.close()
        self.session.close()

    def _open(self, publish: Any) -> Any:
        self.documents.append(FakeDocument(publish))
        return self.documents[0]

    def get(
        self, path: str, *, method: str = "GET", headers: dict[str, str] | None = None
    ) -> tuple[int, dict[str, str], bytes]:
        """Status, headers in lower case, and body."""
        connection = http.client.HTTPConnection(self.address, timeout=PATIENCE)
        try:
            connection.request(method, path, headers=headers or {})
            response = connection.getresponse()
            found = {name.lower(): value for name, value in response.getheaders()}
            return response.status, found, response.read()
        finally:
            connection.close()

    @contextmanager
    def page(
        self, *, name: str = "page", hello: bool = True, size: tuple[int, int] = (64, 48)
    ) -> Iterator[Page]:
        """A page that has said hello."""
        url = f"ws://{self.address}{self.path}socket"
        # without a limit, a page that reads nothing would not see the end of its connection either
        with connect(url, origin=f"http://{self.address}", max_queue=None) as wire:
            page = Page(wire)
            if hello:
                page.say("hello", page=name, width=size[0], height=size[1])
            yield page


class Page:
    """What a browser's page does on its socket."""

    def __init__(self, wire: ClientConnection) -> None:
        self.wire = wire
        self.frames: list[dict[str, Any]] = []
        self._about: dict[str, Any] = {}
        self.heard: list[tuple[str, Any]] = []

    def say(self, kind: str, **members: Any) -> None:
        self.wire.send(json.dumps({"type": kind, **members}))

    def hear(self, kind: str) -> Any:
        """The content of the next message of a kind; frames are acknowledged on the way."""
        while True:
            found, content = self.next()
            if found == "frame":
                self.say("acknowledge", message=content["message"])
            if found == kind:
                return content

    def last(self, kind: str) -> Any:
        """The content of the last message of a kind so far."""
        return next(content for found, content in reversed(self.heard) if found == kind)

    def next(self) -> tuple[str, Any]:
        """Whatever comes next; of a picture in parts, each of them."""
        data = self.wire.recv(timeout=PATIENCE)
        if isinstance(data, bytes):
            (length,) = struct.unpack(">I", data[:4])
            header = json.loads(data[4 : 4 + length])
            self._about = header if header["part"] == 0 else self._about
            self.frames.append({**self._about, **header})
            return "frame", self.frames[-1]
        message = json.loads(data)
        self.heard.append((message["type"], message["content"]))
        return self.heard[-1]

    def final(self) -> dict[str, Any]:
        """The next frame after which nothing better comes."""
        while True:
            header: dict[str, Any] = self.hear("frame")
            if header["is_final"] and header["part"] == header["parts"] - 1:
                return header
