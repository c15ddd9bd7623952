"""Write a flipbook in one call, without a session."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from usdsplat.preview.document import Document
from usdsplat.preview.saving import Flipbook


def flipbook(document: Document, *args: Any, **options: Any) -> tuple[Path, ...]:
    """Take all turns of a `Flipbook` of these arguments, and return its files."""
    book = Flipbook(*args, **options)
    while book.turn(document):
        pass
    return book.files
