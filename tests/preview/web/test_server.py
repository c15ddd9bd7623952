"""The web view's server, by its own wire: raw HTTP, and a socket without a browser."""

from __future__ import annotations

import http.client
import json
import logging
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from urllib.parse import urlsplit

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from tests.preview.web.fakes import FakeDocument
from usdsplat.core.errors import UsageError
from usdsplat.preview.session import Session
from usdsplat.preview.web.bridge import MOST
from usdsplat.preview.web.server import MOST_PAGES, Server, serve

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
    def page(self, *, name: str = "page", hello: bool = True) -> Iterator[Page]:
        """A page that has said hello."""
        url = f"ws://{self.address}{self.path}socket"
        with connect(url, origin=f"http://{self.address}") as wire:
            page = Page(wire)
            if hello:
                page.say("hello", page=name, width=64, height=48)
            yield page


class Page:
    """What a browser's page does on its socket."""

    def __init__(self, wire: ClientConnection) -> None:
        self.wire = wire
        self.frames: list[dict[str, Any]] = []
        self.heard: list[tuple[str, Any]] = []

    def say(self, kind: str, **members: Any) -> None:
        self.wire.send(json.dumps({"type": kind, **members}))

    def hear(self, kind: str) -> Any:
        """The content of the next message of a kind; frames are acknowledged on the way."""
        while True:
            found, content = self.next()
            if found == "frame":
                self.say("acknowledge", number=content["number"])
            if found == kind:
                return content

    def next(self) -> tuple[str, Any]:
        """Whatever comes next."""
        data = self.wire.recv(timeout=PATIENCE)
        if isinstance(data, bytes):
            (length,) = struct.unpack(">I", data[:4])
            self.frames.append(json.loads(data[4 : 4 + length]))
            return "frame", self.frames[-1]
        message = json.loads(data)
        self.heard.append((message["type"], message["content"]))
        return self.heard[-1]

    def final(self) -> dict[str, Any]:
        """The next frame after which nothing better comes."""
        while True:
            header: dict[str, Any] = self.hear("frame")
            if header["is_final"]:
                return header


@pytest.fixture
def host() -> Iterator[Host]:
    host = Host()
    yield host
    host.close()


def test_the_page_and_its_files_come_with_their_types_and_headers(host: Host) -> None:
    """Oracle: RFC 9110 and the policy that the page is written for."""
    status, headers, body = host.get(host.path)
    assert status == 200 and headers["content-type"] == "text/html; charset=utf-8"
    assert body.startswith(b"<!doctype html>") and len(body) == int(headers["content-length"])
    for name in ("main.js", "style.css"):
        status, headers, _ = host.get(host.path + name)
        assert status == 200
        assert headers["content-type"].split(";")[0] in ("text/javascript", "text/css")
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["cache-control"] == "no-store"
        assert headers["referrer-policy"] == "no-referrer"
        assert "script-src 'self'" in headers["content-security-policy"]


@pytest.mark.parametrize(
    ("path", "method", "headers", "status"),
    [
        ("/", "GET", {}, 403),
        ("/wrong/", "GET", {}, 403),
        ("{}", "GET", {"Host": "elsewhere.example"}, 403),
        ("{}", "GET", {"Origin": "http://elsewhere.example"}, 403),
        ("{}../guard.py", "GET", {}, 404),
        ("{}%2e%2e/guard.py", "GET", {}, 404),
        ("{}/etc/passwd", "GET", {}, 404),
        ("{}", "DELETE", {}, 405),
        ("{}", "HEAD", {}, 405),
        ("{}socket", "GET", {}, 403),
    ],
)
def test_refusals_go_over_the_wire(
    host: Host, path: str, method: str, headers: dict[str, str], status: int
) -> None:
    """Oracle: as test_guard has it; here that the server asks its guard, and says nothing more."""
    found, answered, body = host.get(path.format(host.path), method=method, headers=headers)
    assert found == status
    assert answered["x-content-type-options"] == "nosniff" and "set-cookie" not in answered
    assert host.path.strip("/").encode() not in body


@pytest.mark.parametrize(
    "raw",
    [
        b"POST {} HTTP/1.1\r\nHost: {h}\r\nContent-Length: 5\r\n\r\nhello",
        b"GET {}\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
        b"GET {} HTTP/1.1\r\n" + b"X: y\r\n" * 1000 + b"\r\n",
        b"GET {}" + b"a" * 20000 + b" HTTP/1.1\r\nHost: {h}\r\n\r\n",
    ],
)
def test_what_is_no_request_gets_no_page_and_leaves_no_trace(
    host: Host, raw: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    """Oracle: nothing is answered with 200, nothing is logged, and the next one is served."""
    name, _, port = host.address.partition(":")
    raw = raw.replace(b"{}", host.path.encode()).replace(b"{h}", host.address.encode())
    with (
        caplog.at_level(logging.WARNING),
        socket.create_connection((name, int(port)), timeout=PATIENCE) as wire,
    ):
        wire.sendall(raw)
        wire.shutdown(socket.SHUT_WR)
        answer = b""
        try:
            while part := wire.recv(65536):
                answer += part
        except ConnectionResetError:
            pass
    assert not answer.startswith(b"HTTP/1.1 200")
    assert host.get(host.path)[0] == 200
    assert not caplog.records


@pytest.mark.parametrize("origin", [None, "http://elsewhere.example", "null"])
def test_the_socket_does_not_open_for_others(host: Host, origin: str | None) -> None:
    """Oracle: 403 before the handshake."""
    with pytest.raises(InvalidStatus) as caught:
        connect(f"ws://{host.address}{host.path}socket", origin=origin)  # type: ignore[arg-type]
    assert caught.value.response.status_code == 403


def test_a_page_is_told_everything_and_shown_a_picture(host: Host) -> None:
    """Oracle: what the fake document says of itself."""
    with host.page() as page:
        header = page.final()
        while header["viewport"] != [64, 48]:
            header = page.final()
        told = dict(page.heard)
        assert told["opened"]["cameras"] == ["/A", "/B"] and told["state"]["end"] == 10.0
        assert {each["name"] for each in told["opened"]["aovs"]} >= {"color", "Z", "N"}
        assert {each["name"] for each in told["settings"]["display"]} >= {"exposure", "gamma"}
        names = {each["name"] for each in told["settings"]["render"]}
        assert "sh_degree" in names and "multipart" not in names
        assert (header["splats"], header["total"]) == (5, 7)


def test_the_next_frame_waits_for_an_acknowledgement(host: Host) -> None:
    """Oracle: a window of one; a page that does not answer gets news, but no second frame."""
    with host.page() as page:
        while page.next()[0] != "frame":
            pass
        for right in range(20):
            page.say("orbit", right=0.01 * right)
        page.say("end_move")
        page.say("use_camera", path="/none")
        while page.next()[0] != "problem":
            pass
        assert len(page.frames) == 1
        page.say("acknowledge", number=page.frames[0]["number"] + 1000)
        page.say("acknowledge", number=page.frames[0]["number"])
        assert page.final()["number"] == len(host.document.states)


def test_what_a_page_does_is_seen(host: Host) -> None:
    """Oracle: the state that the document was asked to draw."""
    with host.page() as page:
        page.final()
        page.say("orbit", right=0.2)
        page.say("end_move")
        page.say("use_camera", path="/B")
        page.say("set_time", time=4)
        page.say("set_aov", name="N")
        page.say("set_setting", name="sh_degree", value=1)
        page.say("set_display", name="exposure", value=-2)
        page.say("resize", width=80, height=60)
        while page.final()["viewport"] != [80, 60]:
            pass
        state = host.document.states[-1]
        assert (state.camera, state.time, state.look.aov) == ("/B", 4.0, "N")
        assert (state.look.settings.sh_degree, state.display.exposure) == (1, -2.0)
        assert state.size == (80, 60) and not state.is_moving


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        ("nonsense", "expected JSON"),
        ('{"type": "delete"}', "expected one of hello"),
        ('{"type": "orbit", "right": "far"}', "message orbit right: found 'far'"),
        (b"\x00\xff", "expected JSON as text"),
        ('{"type": "set_aov", "name": "beauty"}', "expected one of color"),
        ('{"type": "set_setting", "name": "sh_degree", "value": 9}', "0 to 4"),
        ('{"type": "set_setting", "name": "__class__", "value": 9}', "__class__"),
        ('{"type": "set_setting", "name": "ocio_config", "value": "/etc/passwd"}', "ocio:// name"),
        ('{"type": "set_display", "name": "gamma", "value": [[{}]]}', "gamma"),
        ('{"type": "set_range", "start": 5, "end": 1}', "range: found 5 to 1"),
        ('{"type": "simulate", "action": "run"}', "simulation: found none on the stage"),
        ('{"type": "set_aov", "name": "Z"}', "/World: found no depth"),
    ],
)
def test_a_wrong_message_is_one_sentence_and_the_page_goes_on(
    host: Host, data: str | bytes, sentence: str, caplog: pytest.LogCaptureFixture
) -> None:
    """Oracle: *where: found X, expected Y*, no traceback, and the next message is answered."""
    with caplog.at_level(logging.WARNING), host.page() as page:
        page.wire.send(data)
        assert sentence in page.hear("problem")
        page.say("set_aov", name="N")
        page.say("set_time", time=3)
        while page.hear("state")["time"] != 3:
            pass
    assert not caplog.records


def test_nothing_is_done_before_hello(host: Host) -> None:
    """Oracle: the protocol's first message."""
    with host.page(hello=False) as page:
        page.say("set_aov", name="N")
        assert "hello first" in page.hear("problem")
        assert not page.frames


def test_a_message_that_is_too_long_ends_the_connection(host: Host) -> None:
    """Oracle: RFC 6455, close code 1009; the next page is served."""
    with host.page() as page:
        page.say("set_aov", name="x" * 100_000)
        with pytest.raises(ConnectionClosed) as caught:
            page.hear("never")
        assert caught.value.rcvd is not None and caught.value.rcvd.code == 1009
    with host.page() as page:
        page.final()


def test_a_flood_of_moves_becomes_few_pictures(host: Host) -> None:
    """Oracle: the latest wins: nothing is lost of the last one, and few of the others are drawn."""
    with host.page() as page:
        page.final()
        before = len(host.document.states)
        for number in range(5000):
            page.say("set_time", time=1 + number % 9, is_scrubbing=True)
        page.say("set_time", time=7.5)
        while page.final()["time"] != 7.5:
            pass
        assert len(page.frames) < 2500 and len(host.document.states) - before < 5000


def test_a_flood_of_questions_is_bounded(host: Host) -> None:
    """Oracle: as many as may wait; the others are refused in a sentence, and it goes on after."""
    with host.page() as page:
        page.final()
        host.session.ask(lambda document: host.document.may_go_on.wait(PATIENCE))
        for _ in range(3 * MOST):
            page.say("frame")
        assert "fewer at a time" in page.hear("problem")
        assert len(host.session._tasks) <= MOST
        host.document.may_go_on.set()
        page.say("set_time", time=9)
        while page.final()["time"] != 9:
            pass


def test_of_questions_about_one_thing_the_last_is_answered(host: Host) -> None:
    """Oracle: the first is under way, the last one waits, and no other is asked at all."""
    with host.page() as page:
        page.final()
        host.session.ask(lambda document: host.document.may_go_on.wait(PATIENCE))
        for x in range(500):
            page.say("pick", x=x / 10, y=1)
        page.say("set_range", start=2, end=1)
        page.hear("problem")
        assert len(host.session._tasks) <= 2
        host.document.may_go_on.set()
        page.hear("picked")
        page.hear("picked")


def test_one_page_has_the_view_and_another_may_take_it(host: Host) -> None:
    """Oracle: pages.py says who has it."""
    with host.page(name="first") as first, host.page(name="second") as second:
        first.final()
        second.hear("in_use")
        second.say("set_aov", name="N")
        second.hear("in_use")
        second.say("take_over", width=96, height=64)
        first.hear("in_use")
        while second.final()["viewport"] != [96, 64]:
            pass
        assert host.document.states[-1].look.aov == "color"
        with host.page(name="second") as again:
            again.final()
            second.hear("in_use")


def test_the_view_is_free_when_its_page_goes(host: Host) -> None:
    """Oracle: playing stops when nobody looks; who waits is told, and who comes next has it."""
    with host.page(name="other", hello=False) as other:
        with host.page(name="first") as page:
            page.final()
            page.say("play", is_playing=True)
            while not page.hear("state")["is_playing"]:
                pass
            other.say("hello", page="other", width=64, height=48)
            other.hear("in_use")
        other.hear("free")
        other.say("take_over", width=64, height=48)
        assert other.hear("state")["is_playing"] is False


def test_so_many_pages_and_no_more(host: Host) -> None:
    """Oracle: RFC 6455's registry, 1013: try again later."""
    with ExitStack() as stack:
        for number in range(MOST_PAGES):
            page = stack.enter_context(host.page(name=str(number)))
            page.hear("in_use" if number else "welcome")
        more = stack.enter_context(host.page(hello=False))
        with pytest.raises(ConnectionClosed) as caught:
            more.hear("in_use")
        assert caught.value.rcvd is not None and caught.value.rcvd.code == 1013


def test_what_was_opened_before_the_server_came_is_told() -> None:
    """Oracle: the fake document's name, however long it has been open."""
    host = Host()
    try:
        is_open = threading.Event()
        host.session.ask(lambda document: is_open.set())
        assert is_open.wait(PATIENCE)
        late = serve(host.session)
        try:
            with connect(
                late.url.replace("http", "ws") + "socket", origin=late.url.rsplit("/", 2)[0]
            ) as wire:
                page = Page(wire)
                page.say("hello", page="p", width=64, height=48)
                assert page.hear("opened")["name"] == "fake.usda"
        finally:
            late.close()
    finally:
        host.close()


def test_addresses_that_cannot_be_listened_on_are_refused(host: Host) -> None:
    """Oracle: the port is taken; other machines are let in on request alone."""
    port = int(host.address.rpartition(":")[2])
    with pytest.raises(UsageError, match="port"):
        serve(host.session, port=port)
    with pytest.raises(UsageError, match="other machines"):
        serve(host.session, host="0.0.0.0")


def test_tokens_are_made_up_anew_and_the_url_is_told_once(host: Host) -> None:
    """Oracle: 32 random bytes are 43 letters of base64."""
    told: list[str] = []
    other: Server = serve(host.session, ready=told.append)
    try:
        assert told == [other.url]
        assert len(urlsplit(other.url).path) == 45 and urlsplit(other.url).path != host.path
    finally:
        other.close()
        other.close()


def test_a_page_begins_with_the_camera_and_time_that_were_asked_for() -> None:
    """Oracle: what the first page's pictures were drawn by."""
    host = Host(camera="/B", time=4.0)
    try:
        with host.page() as page:
            page.final()
        state = host.document.states[-1]
        assert (state.camera, state.time) == ("/B", 4.0)
    finally:
        host.close()
