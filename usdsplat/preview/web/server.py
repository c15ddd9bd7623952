"""Serve a preview to a browser on this machine: the page, and its socket.

    server = serve(session, ready=print)     # prints the URL, once it can be opened
    server.wait()
    server.close()

The server has its own thread and event loop; the session and the renderer never wait for it.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
import threading
from collections.abc import Callable
from concurrent.futures import Future
from email.utils import formatdate
from http import HTTPStatus

from websockets.asyncio.server import ServerConnection
from websockets.asyncio.server import serve as listen
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from usdsplat.core.errors import UsageError
from usdsplat.preview.session import Session
from usdsplat.preview.web.compression import TextDeflateFactory
from usdsplat.preview.web.controller import WebController
from usdsplat.preview.web.files import File, files
from usdsplat.preview.web.guard import SOCKET, Guard, Refusal, is_loopback, spoken
from usdsplat.preview.web.messages import MAX_BYTES, Acknowledge, Hello, read
from usdsplat.preview.web.pages import Page, Pages
from usdsplat.preview.web.stream import Order

MOST_PAGES = 8
"""Most connections at a time."""
_HANDSHAKE = 5.0  # s; a slower handshake gets no answer
_GOODBYE = 1.0  # s

LOG = logging.getLogger("usdsplat")


class Server:
    """A running server, made by `serve`."""

    def __init__(
        self,
        session: Session,
        *,
        host: str,
        port: int,
        token: str,
        camera: str | None,
        time: float | None,
    ) -> None:
        self.url = ""
        """URL to open in a browser.

        It contains the token: whoever has it can do whatever the page can.
        """
        self._session = session
        self._host, self._port, self._token = host, port, token
        self._camera, self._time = camera, time
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stop = asyncio.Event()
        self._pages = Pages()
        self._started: Future[None] = Future()
        self._thread = threading.Thread(target=self._run, name="usdsplat web", daemon=True)
        self._thread.start()
        self._started.result()

    def wait(self, timeout: float | None = None) -> None:
        """Wait until the server has been closed, or for `timeout` [s]."""
        self._thread.join(timeout)

    def close(self) -> None:
        """Close every page and the port. The session goes on."""
        if self._loop is not None and self._thread.is_alive():
            with contextlib.suppress(RuntimeError):  # it ended by itself meanwhile
                self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join()

    # --- in the server's thread ------------------------------------------------------------

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except OSError as error:
            if self._started.done():
                raise
            self._started.set_exception(
                UsageError(
                    f"address {self._host} port {self._port}",
                    error.strerror or str(error),
                    "a free port on an address of this machine",
                )
            )

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        guard = Guard(token=self._token, host=self._host, files=files())
        controller = WebController(self._session, self._pages, camera=self._camera, time=self._time)
        try:
            async with listen(
                lambda socket: self._talk(socket, controller),
                # a name may have several addresses; port 0 would differ on each
                "127.0.0.1" if self._host == "localhost" else self._host,
                self._port,
                process_request=lambda socket, request: _answer(guard, request),
                compression=None,  # of images; that of text is an extension
                extensions=[TextDeflateFactory()],
                max_size=MAX_BYTES,
                open_timeout=_HANDSHAKE,
                close_timeout=_GOODBYE,
                server_header=None,
                # it would log tracebacks for every port scan
                logger=logging.Logger("usdsplat.web", logging.CRITICAL),
            ) as server:
                port = next(iter(server.sockets)).getsockname()[1]
                self.url = f"http://{spoken(self._host)}:{port}/{self._token}/"
                self._started.set_result(None)
                await self._stop.wait()
        finally:
            controller.close()

    async def _talk(self, socket: ServerConnection, controller: WebController) -> None:
        """Handle one page's connection."""
        if len(self._pages) >= MOST_PAGES:
            await socket.close(1013, "too many pages")
            return
        page = Page()
        self._pages.enter(page)
        writing = asyncio.create_task(_write(socket, page))
        try:
            async for data in socket:
                self._hear(page, data, controller)
        except ConnectionClosed:
            pass
        finally:
            writing.cancel()
            controller.leave(page)

    def _hear(self, page: Page, data: str | bytes, controller: WebController) -> None:
        """Handle one message. On any error, the page gets a sentence and the terminal no
        traceback."""
        try:
            message = read(data)
            if isinstance(message, Acknowledge):
                page.outbox.acknowledged(message.message)
            elif isinstance(message, Hello):
                page.size = message.width, message.height
                self._pages.greet(page, message.page)
                controller.welcome(page)
            elif page.name is None:
                raise UsageError("message", "another message", "hello first")
            else:
                controller.hear(page, message)
        except UsageError as error:
            page.outbox.tell("problem", str(error))
        except Exception:
            LOG.exception("a bug in the web view")
            page.outbox.tell("problem", "found an internal error, expected none; see the terminal")


def serve(
    session: Session,
    *,
    host: str = "127.0.0.1",
    port: int = 0,
    token: str | None = None,
    allow_remote: bool = False,
    camera: str | None = None,
    time: float | None = None,
    ready: Callable[[str], None] = lambda url: None,
) -> Server:
    """Serve a session to browsers.

    Args:
        session: The session; the caller closes it.
        host: The address to listen on.
        port: Port; 0 chooses a free one.
        token: Token of the URL; None generates one.
        allow_remote: Whether `host` may be reachable from other machines. The connection is not
            encrypted: whoever can listen on the network can see the pictures and the token, and
            with it do whatever the page can. An SSH tunnel to a loopback address is better.
        camera: Path of the first camera; None frames everything.
        time: First time code; None is the first of the stage.
        ready: Called with the URL once it can be opened.

    Raises:
        UsageError: If the server cannot listen on the address, or the address is not a loopback
            address and `allow_remote` is false.
    """
    if not allow_remote and not is_loopback(host):
        raise UsageError(
            "host",
            f"{host or 'every address'!s}, which other machines can reach without encryption",
            "a loopback address and an SSH tunnel, or allow_remote",
        )
    server = Server(
        session,
        host=host,
        port=port,
        token=token or secrets.token_urlsafe(32),
        camera=camera,
        time=time,
    )
    try:
        ready(server.url)
    except BaseException:  # Ctrl-C while a browser starts
        server.close()
        raise
    return server


def _answer(guard: Guard, request: Request) -> Response | None:
    """Return a file or a refusal; None accepts the socket."""
    name = guard.judge(method=request.method, path=request.path, headers=request.headers)
    if isinstance(name, Refusal):
        body = (name.sentence + "\n").encode()
        return _response(name.status, File(content_type="text/plain; charset=utf-8", body=body))
    if name == SOCKET:
        return None
    accepted = ",".join(request.headers.get_all("Accept-Encoding"))
    names = {each.strip().lower() for each in accepted.split(",")}
    return _response(HTTPStatus.OK, files()[name], is_packed="gzip" in names)


def _response(status: HTTPStatus, file: File, *, is_packed: bool = False) -> Response:
    body = file.packed if is_packed else file.body
    headers = Headers(
        [
            ("Date", formatdate(usegmt=True)),
            ("Connection", "close"),
            ("Content-Length", str(len(body))),
            ("Content-Type", file.content_type),
            *file.headers,
        ]
    )
    if is_packed:
        headers["Content-Encoding"] = "gzip"
    if status is HTTPStatus.METHOD_NOT_ALLOWED:
        headers["Allow"] = "GET"
    return Response(status.value, status.phrase, headers, body)


async def _write(socket: ServerConnection, page: Page) -> None:
    """Send a page its queued messages and pictures until it disconnects."""
    try:
        while True:
            news, picture = await page.outbox.taken()
            for text in news:
                await socket.send(text)
            if isinstance(picture, Order):
                # encoding takes as long as drawing a small picture, and releases the GIL
                page.outbox.stream.take(picture, await asyncio.to_thread(picture.encoded))
            elif picture is not None:
                await socket.send(picture)
    except ConnectionClosed:
        pass
    except Exception:  # the page must reconnect
        LOG.exception("a bug in the web view")
        await socket.close(1011)
