"""Tests of which requests the web view's server answers, and where it listens."""

from __future__ import annotations

import gzip
import logging
import socket
from typing import Any
from urllib.parse import urlsplit

import pytest
from websockets.exceptions import InvalidStatus
from websockets.extensions.permessage_deflate import ClientPerMessageDeflateFactory
from websockets.frames import Opcode
from websockets.sync.client import connect

from tests.preview.web.wire import PATIENCE, Host, Page
from usdsplat.core.errors import UsageError
from usdsplat.preview.web.server import Server, serve


def test_the_page_and_its_files_come_with_their_types_and_headers(host: Host) -> None:
    """Oracle: RFC 9110 and the policy that the page is written for."""
    status, headers, body = host.get(host.path)
    assert status == 200 and headers["content-type"] == "text/html; charset=utf-8"
    assert body.startswith(b"<!doctype html>") and len(body) == int(headers["content-length"])
    for name, kind in (("", "text/html"), ("icon.svg", "image/svg+xml")):
        status, headers, _ = host.get(host.path + name)
        assert status == 200
        assert headers["content-type"].split(";")[0] == kind
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["cache-control"] == "no-store"
        assert headers["referrer-policy"] == "no-referrer"
        assert "default-src 'none'" in headers["content-security-policy"]


def test_files_are_compressed_for_those_who_accept_it(host: Host) -> None:
    """Oracle: gzip's own reader, and RFC 9110: Content-Length is that of what is sent."""
    _, _, plain = host.get(host.path)
    _, headers, packed = host.get(host.path, headers={"Accept-Encoding": "gzip, deflate, br"})
    assert headers["content-encoding"] == "gzip"
    assert int(headers["content-length"]) == len(packed) < 0.5 * len(plain)
    assert gzip.decompress(packed) == plain


def test_text_is_compressed_on_the_socket_and_images_are_not(host: Host) -> None:
    """Oracle: RFC 7692: the first reserved bit marks a compressed message."""
    frames: list[Any] = []

    class Watching(ClientPerMessageDeflateFactory):
        def process_response_params(self, *arguments: Any) -> Any:
            extension = super().process_response_params(*arguments)
            decode = extension.decode
            extension.decode = lambda frame, **limits: (
                frames.append((frame.opcode, frame.rsv1)) or decode(frame, **limits)
            )
            return extension

    with connect(
        f"ws://{host.address}{host.path}socket",
        origin=f"http://{host.address}",
        compression=None,
        extensions=[Watching()],
    ) as wire:
        page = Page(wire)
        page.say("hello", page="page", width=64, height=48)
        page.final()
    assert {rsv1 for opcode, rsv1 in frames if opcode is Opcode.TEXT} == {True}
    assert {rsv1 for opcode, rsv1 in frames if opcode is Opcode.BINARY} == {False}


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
        connect(f"ws://{host.address}{host.path}socket", origin=origin)
    assert caught.value.response.status_code == 403


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
