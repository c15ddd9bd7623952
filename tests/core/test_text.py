"""Tests of text that may hold anything."""

from __future__ import annotations

import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usdsplat.core.errors import FormatError
from usdsplat.core.text import shown


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a b.ply", "a b.ply"),
        ("Grüße σ ×", "Grüße σ ×"),
        ("a\nb\tc\rd", "a\\nb\\tc\\rd"),
        (os.fsdecode(b"bad\xff.ply"), "bad\\xff.ply"),
        ("\x1b[2J", "\\x1b[2J"),
        ("a\u2028b\u202ec", "a\\u2028b\\u202ec"),
        ("\ud800", "\\ud800"),
    ],
)
def test_what_is_not_printable_is_an_escape(text: str, expected: str) -> None:
    """Oracle: written out by hand, as Python writes them in a string."""
    assert shown(text) == expected


@given(st.text())
def test_any_text_is_one_line_of_utf_8(text: str) -> None:
    """Oracle: `str.splitlines` and the encoder."""
    assert len(f"{shown(text)}.".splitlines()) == 1
    shown(text).encode("utf-8")


def test_an_error_is_one_line_whatever_it_is_about() -> None:
    """Oracle: the sentence of a file with a newline in its name."""
    error = FormatError("a\nb.ply", "x\ny", "z")
    assert str(error) == "a\\nb.ply: found x\\ny, expected z"
    assert error.where == "a\nb.ply"
