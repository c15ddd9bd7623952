"""Access control: a request must have the token, and must be addressed to this server.

The token is the first part of every path (`http://127.0.0.1:8000/TOKEN/`). A page's relative links
therefore contain it, no cookie exists that other servers of this machine could read, and nothing
needs parsing before the comparison.

Rejected, in this order:

- another Host than this machine's own: a name resolved here by someone else's DNS (DNS rebinding);
- another method than GET;
- a path without the token, compared in constant time;
- an Origin other than the page's own, and for the socket also none at all;
- a path that is not in the table of files. Paths are never looked up in a file system.

The port in Host may differ from ours: it does behind an SSH tunnel.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import ipaddress
import re
import socket
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from http import HTTPStatus
from typing import Protocol

SOCKET = "socket"
"""Name of the page's socket among the files."""

_HOST = re.compile(r"(?P<name>\[[0-9a-f:.]+\]|[0-9a-z.-]+)(?P<port>:[0-9]{1,5})?", re.ASCII)
_LOOPBACK = ("localhost", "127.0.0.1", "[::1]")
_ANY = ("0.0.0.0", "::", "")

_POLICY = (
    "default-src 'none'; script-src {script}; style-src {style}; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_OTHERS = (
    ("X-Content-Type-Options", "nosniff"),
    ("X-Frame-Options", "DENY"),
    ("Referrer-Policy", "no-referrer"),
    ("Cross-Origin-Resource-Policy", "same-origin"),
    ("Cross-Origin-Opener-Policy", "same-origin"),
    ("Cache-Control", "no-store"),
)


def headers_of(script: str = "", style: str = "") -> tuple[tuple[str, str], ...]:
    """Return the headers of an answer: no foreign content, no framing, no caching, no token in a
    Referer.

    Args:
        script, style: Text of the only script and style sheet that the answer may run: those inside
            the page, known by their SHA-256. By default none may.
    """
    policy = _POLICY.format(script=_source(script), style=_source(style))
    return (("Content-Security-Policy", policy), *_OTHERS)


def _source(text: str) -> str:
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return f"'sha256-{digest}'" if text else "'none'"


class Headers(Protocol):
    """The part of a request's headers that is used."""

    def get_all(self, key: str, /) -> Iterable[str]:
        """Return every value of a header."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """The reason why a request is rejected."""

    status: HTTPStatus
    sentence: str


class Guard:
    """Checks requests.

    Args:
        token: Token that the URL must contain.
        host: Address that the server listens on. Unless it is a loopback address, this machine's
            names and every numeric address count as own too: rebinding needs a name.
        files: Names that may be requested, besides the socket.
    """

    def __init__(self, *, token: str, host: str, files: Collection[str]) -> None:
        self._token = token.encode()
        self._files = frozenset(files) | {SOCKET}
        names = {*_LOOPBACK, _bracketed(host)}
        self._is_local = is_loopback(host)
        if not self._is_local:
            names |= {socket.gethostname().lower(), socket.getfqdn().lower()}
        self._names = names

    def judge(self, *, method: str, path: str, headers: Headers) -> str | Refusal:
        """Return the name of the requested file, or `SOCKET`, or why the request is rejected."""
        hosts = list(headers.get_all("Host"))
        if len(hosts) != 1 or not self._is_own(hosts[0]):
            return _refused("Host: found the name of another machine, expected that of this one")
        if method != "GET":
            return Refusal(
                status=HTTPStatus.METHOD_NOT_ALLOWED,
                sentence=f"method: found {method}, expected GET",
            )
        token, _, name = path.partition("?")[0].removeprefix("/").partition("/")
        if not hmac.compare_digest(token.encode(errors="replace"), self._token):
            return _refused(
                "URL: found no token or a wrong one, expected the URL printed in the terminal"
            )
        origins = list(headers.get_all("Origin"))
        if origins not in ([], [f"http://{hosts[0]}"]) or (name == SOCKET and not origins):
            return _refused("Origin: found another origin, expected that of this page")
        if name not in self._files:
            return Refusal(
                status=HTTPStatus.NOT_FOUND,
                sentence="path: found an unknown path, expected one of the page's files",
            )
        return name

    def _is_own(self, host: str) -> bool:
        """Return whether a Host header names this machine."""
        found = _HOST.fullmatch(host.lower())
        if found is None:
            return False
        name = found["name"]
        return name in self._names or (not self._is_local and _is_address(name))


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach an address."""
    if host in _ANY:
        return False
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def spoken(host: str) -> str:
    """Return a host as written in a URL; the any-address becomes this machine's name."""
    return socket.gethostname() if host in _ANY else _bracketed(host)


def _bracketed(host: str) -> str:
    return f"[{host.lower()}]" if ":" in host else host.lower()


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name.strip("[]"))
    except ValueError:
        return False
    return True


def _refused(sentence: str) -> Refusal:
    return Refusal(status=HTTPStatus.FORBIDDEN, sentence=sentence)
