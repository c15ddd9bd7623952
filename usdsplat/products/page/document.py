"""Write the text of a page: our frame around the viewer, with everything inside or beside it."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import usdsplat

_HERE = Path(__file__).parent
VIEWER = _HERE / "viewer"
"""The viewer, whole and unmodified, with its licence and its source."""
VIEWER_FILES = ("index.js", "index.css", "LICENSE")
CHUNK = 12 << 20
"""Bytes of a capture in one element, a multiple of 3; browsers limit the length of a text."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Document:
    """A page. Everything that comes from a file is escaped in it."""

    title: str
    settings: Mapping[str, Any]
    ups: list[float]
    """Up vectors of the camera's keyframes, 3 numbers each."""
    aspect: float
    """Width over height of the picture that is visible at least."""
    antialiased: bool
    """Whether the splats are meant for the antialiased projection."""
    capture: str
    """Name of the capture, whose suffix states its format."""
    url: str = ""
    """Address of the capture, relative to the page; "" if it is in the page."""

    def parts(self, capture: memoryview) -> Iterator[bytes]:
        """Yield the text in pieces.

        Args:
            capture: The capture in the page; empty if it has an address.
        """
        yield _HEAD.format(
            title=html.escape(self.title),
            version=html.escape(usdsplat.__version__),
            style=f"<style>\n{_source('viewer/index.css')}</style>" if not self.url else _LINK,
            own_style=_source("page.css"),
            color=_color(self.settings["background"]["color"]),
            licence=html.escape((VIEWER / "LICENSE").read_text(encoding="utf-8")),
            data=for_script(self._data()),
        ).encode()
        for start in range(0, len(capture), CHUNK):
            yield b'<script type="text/plain" class="capture">'
            yield base64.b64encode(capture[start : start + CHUNK])
            yield b"</script>\n"
        yield b'<script type="module">\n'
        yield _IMPORT if self.url else (VIEWER / "index.js").read_bytes() + b"\n"
        yield _source("page.js").encode() + b"</script>\n</body>\n</html>\n"

    def _data(self) -> dict[str, Any]:
        """Return what the page's script reads."""
        return {
            "capture": self.capture,
            "url": self.url,
            "aspect": self.aspect,
            "antialiased": self.antialiased,
            "settings": self.settings,
            "ups": self.ups,
        }


def for_script(value: object) -> str:
    """Return JSON that does not end the script element around it, whatever its texts are."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _source(name: str) -> str:
    """Return a file of this package."""
    return (_HERE / name).read_text(encoding="utf-8")


def _color(color: list[float]) -> str:
    """Return a colour for CSS."""
    return f"rgb({' '.join(str(round(255 * each)) for each in color)})"


_LINK = '<link rel="stylesheet" href="viewer/index.css">'
_IMPORT = b"""\
const { createViewer } = await import("./viewer/index.js").catch(() => ({}));
"""
_HEAD = """\
<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>{title}</title>
<meta name="generator" content="usdsplat {version}">
<link rel="icon" href="data:,">
<meta name="viewport" content="width=device-width, initial-scale=1, viewport-fit=cover">
{style}
<style>
{own_style}body {{ background: {color}; }}
</style>
</head>
<body>
<noscript>This page draws with JavaScript, which is switched off.</noscript>
<div id="message" role="alert" hidden></div>
<template id="licence">SuperSplat Viewer
{licence}</template>
<script type="application/json" id="page">{data}</script>
"""
