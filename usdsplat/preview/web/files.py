"""The files of the page: a fixed table, read once; no request's path reaches a file system.

The page contains its style sheet and its scripts: behind a link of 200 ms each further file costs
two round trips. The scripts are modules in `static`; here each becomes a function that returns what
it exports, in the order of their imports.
"""

from __future__ import annotations

import gzip
import re
from dataclasses import dataclass, field
from functools import cache
from importlib import resources

from usdsplat.preview.web.guard import headers_of

_IMPORT = re.compile(r'^import \{ (.+) \} from "\./(\w+)\.js";$', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:class|function|const) (\w+))", re.MULTILINE)


@dataclass(frozen=True, slots=True, kw_only=True)
class File:
    """A file to answer with."""

    content_type: str
    body: bytes
    headers: tuple[tuple[str, str], ...] = field(default_factory=headers_of)

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
    texts = {each.name: each.read_text(encoding="utf-8") for each in folder.iterdir()}
    scripts = {
        name.removesuffix(".js"): text for name, text in texts.items() if name.endswith(".js")
    }
    script, style = joined(scripts, "main"), texts["style.css"]
    page = texts["index.html"]
    page = page.replace(
        '<link rel="stylesheet" href="style.css">', f"<style>{style}</style>"
    ).replace(
        '<script type="module" src="main.js"></script>',
        f'<script type="module">{script}</script>',
    )
    return {
        "": File(
            content_type="text/html; charset=utf-8",
            body=page.encode(),
            headers=headers_of(script, style),
        ),
        "icon.svg": File(content_type="image/svg+xml", body=texts["icon.svg"].encode()),
    }


def joined(scripts: dict[str, str], main: str) -> str:
    """Return one script of modules.

    Args:
        scripts: Their texts by name. Imports are whole lines with names in braces.
        main: Name of the module that imports the others.
    """
    done: dict[str, str] = {}

    def add(name: str) -> None:
        if name in done:
            return
        for _, needed in _IMPORT.findall(scripts[name]):
            add(needed)
        exports = ", ".join(_EXPORT.findall(scripts[name]))
        body = _IMPORT.sub(r"const { \1 } = \2_js;", _EXPORT.sub("", scripts[name]))
        done[name] = f"const {name}_js = (() => {{\n{body}\nreturn {{ {exports} }};\n}})();\n"

    add(main)
    return "".join(done.values())
