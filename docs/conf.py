"""Configuration of the site that `make docs` builds."""

from typing import Any

from sphinx.application import Sphinx
from sphinx.ext.napoleon import Config, GoogleDocstring

from usdsplat import __version__

project = "usdsplat"
author = "the usdsplat authors"
release = version = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc"]

source_suffix = {".md": "markdown"}
myst_heading_anchors = 3
default_role = "code"  # docstrings mark code by single backquotes

autodoc_member_order = "bysource"
autodoc_typehints = "signature"

html_theme = "furo"
html_title = f"usdsplat {__version__}"
html_copy_source = False


def setup(app: Sphinx) -> None:
    """Read docstrings in Google's style."""
    app.connect("autodoc-process-docstring", _read_sections)


def _read_sections(
    app: Sphinx, what: str, name: str, of: Any, options: Any, lines: list[str]
) -> None:
    """Replace the sections of a docstring, such as Args. Those of attributes have none, and
    Napoleon would take what is before their first colon for a type."""
    if what not in ("attribute", "data", "property"):
        style = Config(napoleon_use_ivar=True)
        lines[:] = GoogleDocstring(lines, style, app, what, name, of, options).lines()
