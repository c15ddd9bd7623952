"""The files of the page: a fixed table, read once; no request's path reaches a file system."""

from __future__ import annotations

import gzip
from dataclasses import dataclass
from functools import cache
from importlib import resources

_TYPES = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "svg": "image/svg+xml",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class File:
    """A file to answer with."""

    content_type: str
    body: bytes

    @property
    def packed(self) -> bytes:
        """The body, compressed with gzip: a quarter."""
        return _packed(self.body)


@cache
def _packed(body: bytes) -> bytes:
    return gzip.compress(body, mtime=0)


@cache
def files() -> dict[str, File]:
    """Return the files by their name in the URL; "" is the page itself."""
    folder = resources.files("usdsplat.preview.web") / "static"
    found = {
        each.name: File(content_type=_TYPES[each.name.rpartition(".")[2]], body=each.read_bytes())
        for each in folder.iterdir()
        if each.name.rpartition(".")[2] in _TYPES
    }
    return {"": found.pop("index.html"), **found}
