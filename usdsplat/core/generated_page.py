"""Keep a page of docs/ that is generated from the code."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from usdsplat.core.output import write_output

REFERENCE = Path(__file__).parents[2] / "docs" / "reference"
"""Folder of the generated pages in a checkout."""


def keep_page(target: Path, text: str, arguments: Sequence[str]) -> int:
    """Write the text of a page, or with --check return 1 if the stored one differs."""
    if list(arguments) == ["--check"]:
        return 0 if target.is_file() and target.read_text(encoding="utf-8") == text else 1
    target.parent.mkdir(parents=True, exist_ok=True)
    write_output(target, text.encode())
    return 0


def table_text(text: str) -> str:
    """Return the text of a cell of a Markdown table: one line, with bars and tags escaped."""
    return " ".join(text.split()).replace("|", "\\|").replace("<", "\\<")
