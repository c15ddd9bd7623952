"""Tests of header entries that users add."""

from __future__ import annotations

import pytest

from usdsplat.core.errors import UsageError
from usdsplat.images.user_metadata import entry, parse_entry


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("shot=sq010", ("shot", "sq010")),
        ("shot=0010", ("shot", "0010")),
        ("take=12", ("take", 12)),
        ("gain=-0.5", ("gain", -0.5)),
        ("take=1e5", ("take", "1e5")),
        ("big=99999999999", ("big", "99999999999")),
        ("note=a=b", ("note", "a=b")),
        ("empty=", ("empty", "")),
        ("lines=a\nb", ("lines", "a\\nb")),
        ("isoSpeed=800", ("isoSpeed", 800.0)),
        ("studio:shot/id=7", ("studio:shot/id", 7)),
    ],
)
def test_values_are_numbers_if_they_look_like_one(text, expected):
    """Oracle: the list above."""
    name, value = parse_entry("--metadata", text)
    assert (name, value) == expected and type(value) is type(expected[1])


@pytest.mark.parametrize(
    "text",
    [
        "no sign", "=7", "version=12", "1st=a", "ü=a", f"{'a' * 80}=b", "dataWindow=a",
        "DATETIME=a", "usdsplat:ids=a", "cryptomatte/0/name=a", "oiio:ColorSpace=a", "worldToNDC=1",
        "isoSpeed=fast", "ExposureTime=3", "FNumber=9", "worldtoscreen=1", "cameraCCTSetting=1",
    ],
)  # fmt: skip
def test_names_with_another_meaning_are_refused(text):
    """Oracle: names that EXR or PNG cannot hold, and those of entries with a meaning."""
    with pytest.raises(UsageError):
        parse_entry("--metadata", text)


@pytest.mark.parametrize("value", [2**31, -(2**31) - 1, 1e300, float("nan"), (1.0, float("inf"))])
def test_numbers_that_no_header_holds_are_refused(value):
    """Oracle: OpenEXR's numbers have 32 bits."""
    with pytest.raises(UsageError, match="found score"):
        entry("--metadata", "score", value)
