"""A browser that shows a small stage, and functions that drive it as a user would."""

from __future__ import annotations

import base64
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from pxr import Usd

from usdsplat.preview.document import Document
from usdsplat.preview.session import Session
from usdsplat.preview.values import Event, Image, Picture
from usdsplat.preview.web.server import Server, serve

PATIENCE = 120.0
"""How long a page may take before a test fails [s]; kernels may have to be compiled."""

_PIXELS = """() => {
  const canvas = document.getElementById("picture");
  const copy = new OffscreenCanvas(canvas.width, canvas.height);
  const context = copy.getContext("2d", {willReadFrequently: true});
  context.drawImage(canvas, 0, 0);
  const {data} = context.getImageData(0, 0, canvas.width, canvas.height);
  let text = "";
  for (let at = 0; at < data.length; at += 32768) {
    text += String.fromCharCode(...data.subarray(at, at + 32768));
  }
  return [Number(canvas.dataset.number), canvas.width, canvas.height, btoa(text)];
}"""


class Seat:
    """A session, its server, and a page of a browser.

    Args:
        browser: Playwright's.
        open_document: As for `Session`.
        device: Of the browser's context, such as its viewport.
    """

    def __init__(
        self,
        browser: Any,
        open_document: Callable[[Callable[[Event], None]], Document],
        **device: Any,
    ) -> None:
        self.pictures: dict[int, Picture] = {}
        self.states: list[Any] = []
        self._lock = threading.Lock()
        self.session = Session(open_document)
        self.session.listen(self._keep)
        self.server: Server = serve(self.session)
        self.context = browser.new_context(**{"viewport": {"width": 1000, "height": 640}, **device})
        self.errors: list[str] = []
        self.page = self.sit()

    def sit(self, *, port: int | None = None, prepare: Callable[[Any], None] | None = None) -> Any:
        """A page of its own, that has opened the URL.

        Args:
            port: Of a proxy; None for the server's own.
            prepare: Called with the page before it is opened.
        """
        page = self.context.new_page()
        page.set_default_timeout(1000 * PATIENCE)
        page.on("console", self._hear)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        if prepare is not None:
            prepare(page)
        own = urlsplit(self.server.url).port
        page.goto(self.server.url.replace(f":{own}/", f":{port or own}/"))
        return page

    def close(self) -> None:
        """Leave."""
        self.context.close()
        self.server.close()
        self.session.close()

    def rested(self, after: int = -1, *, accept: Callable[[Picture], bool] | None = None) -> int:
        """The number of the final picture of what was asked for last, once the page has it.

        Args:
            after: It is a later one than this.
            accept: What else it has to be like.
        """
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            shown = self.page.evaluate("() => ({...document.getElementById('picture').dataset})")
            number = int(shown.get("number", -1))
            if number > after and shown["final"] == "true":
                picture, asked = self.picture(number), self.session._state
                if asked == picture.state and (accept is None or accept(picture)):
                    return number
            self.page.wait_for_timeout(20)
        raise AssertionError(f"no such picture; the last one is of {self.session._state}")

    def picture(self, number: int) -> Picture:
        """What the session drew."""
        with self._lock:
            return self.pictures[number]

    def restart(self) -> None:
        """Have the server go and come again, at the same address and with the same token."""
        parts = urlsplit(self.server.url)
        self.server.close()
        token = parts.path.strip("/")
        self.server = serve(self.session, port=parts.port or 0, token=token)

    def ask(self, task: Callable[[Document], Any]) -> None:
        """Have something done with the document, and wait until it is."""
        done = threading.Event()
        self.session.ask(task, lambda result: done.set())
        assert done.wait(PATIENCE)

    def canvas(self) -> tuple[int, Image]:
        """Number and pixels, shape (h, w, 3), of what the page shows."""
        number, width, height, data = self.page.evaluate(_PIXELS)
        rgba = np.frombuffer(base64.b64decode(data), np.uint8).reshape(height, width, 4)
        return number, rgba[..., :3]

    def shoot(self, path: Path) -> None:
        """Save what a person sees."""
        self.page.screenshot(path=path)

    def _keep(self, event: Event) -> None:
        if isinstance(event, Picture):
            with self._lock:
                self.pictures[event.number] = event

    def _hear(self, message: Any) -> None:
        if message.type in ("error", "warning"):
            self.errors.append(message.text)


def animated(stage: Usd.Stage, path: str, *, end: float = 10.0) -> Usd.Stage:
    """Have a prim move, and the stage a range of frames."""
    stage.SetStartTimeCode(1.0)
    stage.SetEndTimeCode(end)
    attribute = stage.GetPrimAtPath(path).GetAttribute("xformOp:translate")
    attribute.Set((2, 0, 0), 1.0)
    attribute.Set((4, 1, 0), end)
    return stage
