"""Tests of the access control of the web view."""

from __future__ import annotations

import base64
import hashlib
import re
import socket
from http import HTTPStatus

import pytest
from websockets.datastructures import Headers

from usdsplat.preview.web.files import files
from usdsplat.preview.web.guard import SOCKET, Guard, Refusal, headers_of, is_loopback

TOKEN = "a-token_of-some-LENGTH"
OWN = "127.0.0.1:8000"


def judge(
    path: str = f"/{TOKEN}/",
    *,
    method: str = "GET",
    hosts: tuple[str, ...] = (OWN,),
    origins: tuple[str, ...] = (),
    host: str = "127.0.0.1",
) -> str | HTTPStatus:
    """What a server on `host` does with a request."""
    headers = Headers([*(("Host", each) for each in hosts), *(("Origin", e) for e in origins)])
    guard = Guard(token=TOKEN, host=host, files=files())
    answer = guard.judge(method=method, path=path, headers=headers)
    return answer.status if isinstance(answer, Refusal) else answer


def test_the_page_and_its_files_and_its_socket_are_served_with_the_token() -> None:
    """Oracle: the URL that the terminal shows."""
    assert judge() == ""
    assert judge(f"/{TOKEN}/icon.svg") == "icon.svg"
    assert judge(f"/{TOKEN}/?from=history") == ""
    assert judge(f"/{TOKEN}/socket", origins=(f"http://{OWN}",)) == SOCKET


@pytest.mark.parametrize(
    "path",
    [
        "/",
        "",
        "/socket",
        "/icon.svg",
        f"/{TOKEN[:-1]}/",
        f"/{TOKEN}x/",
        f"/{TOKEN.lower()}/",
        f"//{TOKEN}/",
        f"/?token={TOKEN}",
        f"/%61{TOKEN[1:]}/",
        f"http://127.0.0.1:8000/{TOKEN}/",
        "*",
        "/\u00e9/",
        "/\udce9/",
    ],
)
@pytest.mark.parametrize("origins", [(), (f"http://{OWN}",)])
def test_nothing_is_served_without_the_token(path: str, origins: tuple[str, ...]) -> None:
    """Oracle: the token, as it was made up and nothing else, is the first part of the path."""
    assert judge(path, origins=origins) == HTTPStatus.FORBIDDEN


@pytest.mark.parametrize(
    "origins",
    [
        (),
        ("http://elsewhere.example",),
        ("null",),
        ("http://127.0.0.1:8001",),
        ("http://127.0.0.1",),
        ("http://localhost:8000",),
        (f"https://{OWN}",),
        (f"http://{OWN}.elsewhere.example",),
        (f"http://{OWN}", "http://elsewhere.example"),
        (f"http://{OWN}", f"http://{OWN}"),
    ],
)
def test_the_socket_opens_for_its_own_origin_alone(origins: tuple[str, ...]) -> None:
    """Oracle: the same-origin rule, which browsers do not apply to sockets: scheme, host, port."""
    assert judge(f"/{TOKEN}/socket", origins=origins) == HTTPStatus.FORBIDDEN


def test_files_are_not_given_to_another_origin() -> None:
    """Oracle: the same-origin rule; the page's own requests may name its origin."""
    assert (
        judge(f"/{TOKEN}/icon.svg", origins=("http://elsewhere.example",)) == HTTPStatus.FORBIDDEN
    )
    assert judge(f"/{TOKEN}/icon.svg", origins=(f"http://{OWN}",)) == "icon.svg"


@pytest.mark.parametrize(
    "hosts",
    [
        (),
        ("elsewhere.example:8000",),
        ("localhost.elsewhere.example",),
        ("127.0.0.1.elsewhere.example:8000",),
        ("10.0.0.7:8000",),
        ("127.0.0.1:8000:1",),
        ("127.0.0.1:8000/",),
        ("user@127.0.0.1:8000",),
        ("127.0.0.1:\xb9",),
        ("",),
        (OWN, OWN),
        (OWN, "elsewhere.example"),
    ],
)
def test_names_that_others_point_here_are_refused(hosts: tuple[str, ...]) -> None:
    """Oracle: DNS rebinding arrives with the name of the page that was lured here as its Host."""
    assert judge(hosts=hosts) == HTTPStatus.FORBIDDEN


@pytest.mark.parametrize("own", ["127.0.0.1:9", "localhost:9000", "LOCALHOST", "[::1]:8000"])
def test_a_tunnel_may_come_from_another_port(own: str) -> None:
    """Oracle: ssh -L 9000:127.0.0.1:8000, whose browser says localhost:9000 throughout."""
    assert judge(hosts=(own,)) == ""
    assert judge(f"/{TOKEN}/socket", hosts=(own,), origins=(f"http://{own}",)) == SOCKET


def test_a_server_for_other_machines_has_addresses_and_its_own_names() -> None:
    """Oracle: rebinding needs a name; a number in Host was typed, not resolved."""
    assert judge(hosts=("10.0.0.7:8000",), host="0.0.0.0") == ""
    assert judge(hosts=("[fe80::7]:8000",), host="::") == ""
    assert judge(hosts=(f"{socket.gethostname()}:8000",), host="0.0.0.0") == ""
    assert judge(hosts=("elsewhere.example:8000",), host="0.0.0.0") == HTTPStatus.FORBIDDEN


@pytest.mark.parametrize(
    "name",
    [
        "nothing.js",
        "../guard.py",
        "../../../../../../etc/passwd",
        "..%2f..%2fguard.py",
        "%2e%2e/guard.py",
        "..\\guard.py",
        "/etc/passwd",
        "//etc/passwd",
        "C:\\Windows\\win.ini",
        "icon.svg/",
        "icon.svg%00",
        "./icon.svg",
        "%69con.svg",
        "ICON.SVG",
        "index.html",
        "socket/",
        "static/icon.svg",
        "__init__.py",
    ],
)
def test_paths_outside_the_table_do_not_exist(name: str) -> None:
    """Oracle: the names of the page's files, letter by letter."""
    assert judge(f"/{TOKEN}/{name}") == HTTPStatus.NOT_FOUND


@pytest.mark.parametrize("method", ["POST", "HEAD", "PUT", "DELETE", "OPTIONS", "CONNECT", "get"])
def test_methods_other_than_get_are_not_allowed(method: str) -> None:
    """Oracle: RFC 9110, 405 for a method that is known and not served."""
    assert judge(method=method) == HTTPStatus.METHOD_NOT_ALLOWED


def test_loopback_addresses_are_known() -> None:
    """Oracle: RFC 1122 and RFC 4291: 127.0.0.0/8 and ::1; wildcards are everything."""
    assert all(map(is_loopback, ("127.0.0.1", "127.8.8.8", "::1", "localhost")))
    assert not any(map(is_loopback, ("0.0.0.0", "::", "", "10.0.0.7", "render01", "fe80::1")))


def test_the_page_needs_nothing_from_elsewhere() -> None:
    """Oracle: no file names another host, and the policy would not let it load one."""
    served = files()
    assert set(served) == {"", "icon.svg"}
    for name, file in served.items():
        text = file.body.decode().replace("http://www.w3.org/2000/svg", "")
        assert not re.search(r"""(https?:|["'(=\s])//\w""", text), name
        assert "<script>" not in text and " style=" not in text and " onclick" not in text, name
        policy = dict(file.headers)["Content-Security-Policy"]
        assert "unsafe" not in policy and "*" not in policy and "frame-ancestors 'none'" in policy


def test_only_the_page_s_own_script_and_style_may_run() -> None:
    """Oracle: CSP level 3: the SHA-256 of what is between the tags; nothing at all elsewhere."""
    page = files()[""]
    policy = dict(page.headers)["Content-Security-Policy"]
    text = page.body.decode()
    for kind, pattern in (
        ("script", r'<script type="module">(.*?)</script>'),
        ("style", r"<style>(.*?)</style>"),
    ):
        (inside,) = re.findall(pattern, text, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(inside.encode()).digest()).decode()
        assert f"{kind}-src 'sha256-{digest}';" in policy
    nothing = dict(headers_of())["Content-Security-Policy"]
    assert "script-src 'none'; style-src 'none';" in nothing
