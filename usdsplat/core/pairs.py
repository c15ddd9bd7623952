"""Parse two whole numbers in one word, such as 1920x1080 or 1/8."""

from __future__ import annotations

import re


def whole_pair(text: str, mark: str) -> tuple[int, int] | None:
    """Return two numbers from 1 to 999999 with a mark between them; None for any other text."""
    match = re.fullmatch(rf"([1-9]\d{{0,5}}){re.escape(mark)}([1-9]\d{{0,5}})", text, re.ASCII)
    return (int(match[1]), int(match[2])) if match else None
