"""Tests of frame rates and SMPTE time codes."""

from __future__ import annotations

from fractions import Fraction

import pytest

from usdsplat.images.timecode import Timecode, exact_rate, timecode_of


@pytest.mark.parametrize(
    ("rate", "expected"),
    [
        (24.0, Fraction(24)),
        (25.0, Fraction(25)),
        (23.976, Fraction(24000, 1001)),
        (23.976023976, Fraction(24000, 1001)),
        (29.97, Fraction(30000, 1001)),
        (59.94, Fraction(60000, 1001)),
        (12.5, Fraction(25, 2)),
        (0.5, Fraction(1, 2)),
        (0.0, None),
        (-24.0, None),
        (float("nan"), None),
        (float("inf"), None),
    ],
)
def test_rates_are_exact(rate, expected):
    """Oracle: the rates that ImfFramesPerSecond.h lists; ratios written out by hand."""
    assert exact_rate(rate) == expected


@pytest.mark.parametrize(
    ("frame", "rate", "expected"),
    [
        (0, Fraction(24), "00:00:00:00"),
        (1001, Fraction(24), "00:00:41:17"),
        (1001.75, Fraction(24), "00:00:41:17"),
        (1001, Fraction(24000, 1001), "00:00:41:17"),
        (86400 * 25 - 1, Fraction(25), "23:59:59:24"),
        (86400 * 25, Fraction(25), "00:00:00:00"),
        (107892, Fraction(30000, 1001), "00:59:56:12"),
    ],
)
def test_frames_are_counted(frame, rate, expected):
    """Oracle: division by hand; non-drop counts NTSC as the whole rate."""
    assert str(timecode_of(frame, rate)) == expected


@pytest.mark.parametrize(
    ("frame", "rate"), [(-1, Fraction(24)), (7, Fraction(25, 2)), (7, Fraction(120))]
)
def test_what_a_time_code_cannot_say_has_none(frame, rate):
    """Oracle: two digits for each number, none of them negative."""
    assert timecode_of(frame, rate) is None


def test_numbers_are_packed_as_decimals():
    """Oracle: ST 12-1: a byte for each number, tens in its upper half."""
    assert Timecode(12, 34, 56, 17).packed == 0x12345617
