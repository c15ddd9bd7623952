"""Tests of two numbers in one word."""

from __future__ import annotations

import pytest

from usdsplat.core.pairs import whole_pair


@pytest.mark.parametrize(
    ("text", "mark", "expected"),
    [
        ("1920x1080", "x", (1920, 1080)),
        ("1/8", "/", (1, 8)),
        ("999999x1", "x", (999999, 1)),
        *((text, "x", None) for text in ("", "x", "1x", "x1", "0x1", "1x0", "01x1", "1/1", "1 x1")),
        *((text, "x", None) for text in ("1x1x1", "1x-1", "1.5x1", "1000000x1", "١x1", "1x1\n")),
    ],
)
def test_two_whole_numbers_or_nothing(text, mark, expected):
    """Oracle: by hand."""
    assert whole_pair(text, mark) == expected
