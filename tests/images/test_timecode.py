"""Tests of frame rates and SMPTE time codes."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import OpenEXR
import pytest

from usdsplat.core.errors import UsageError
from usdsplat.images.labels import time_metadata, timecode_offset
from usdsplat.images.layout import ImageLayout
from usdsplat.images.timecode import (
    Timecode,
    exact_rate,
    frame_count,
    frame_of,
    parse_timecode,
    timecode_of,
)


@pytest.mark.parametrize(
    ("rate", "expected"),
    [
        (24.0, Fraction(24)),
        (25.0, Fraction(25)),
        (23.976, Fraction(24000, 1001)),
        (23.976023976, Fraction(24000, 1001)),
        (23.98, Fraction(24000, 1001)),
        (23.97, Fraction(24000, 1001)),
        (29.97, Fraction(30000, 1001)),
        (47.95, Fraction(48000, 1001)),
        (119.88, Fraction(120000, 1001)),
        (24.97, Fraction(2497, 100)),
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
        (59, Fraction(60), "00:00:00:29.1"),
        (60, Fraction(60000, 1001), "00:00:01:00.0"),
        (1001, Fraction(50), "00:00:20:00.1"),
        (47, Fraction(48), "00:00:00:23.1"),
    ],
)
def test_frames_are_counted(frame, rate, expected):
    """Oracle: division by hand; non-drop counts NTSC as the whole rate, and pairs above 30."""
    assert str(timecode_of(frame, rate)) == expected


@pytest.mark.parametrize(
    ("frame", "rate"),
    [(-1, Fraction(24)), (7, Fraction(25, 2)), (7, Fraction(120)), (7, Fraction(31))],
)
def test_what_a_time_code_cannot_say_has_none(frame, rate):
    """Oracle: ST 12-1's rates, and 2 bits for the tens of frames."""
    assert timecode_of(frame, rate) is None


def test_numbers_are_packed_as_decimals():
    """Oracle: ST 12-1: a byte for each number, tens in its upper half."""
    assert Timecode(12, 34, 56, 17).packed == 0x12345617
    assert Timecode(12, 34, 56, 17, True).packed == 0x1234D617
    assert Timecode(12, 34, 56, 17, False).packed == 0x12345617


@pytest.mark.parametrize("authored", [23.976, 23.98, 24000 / 1001, 29.97, 59.94, 24.0, 25.0])
def test_whole_frames_keep_their_number(authored):
    """Oracle: with as many time codes as frames a second, the time code's own number."""
    rate = exact_rate(authored)
    counted = [timecode_of(frame_count(float(i), authored, rate), rate) for i in range(3000)]
    assert counted == [timecode_of(i, rate) for i in range(3000)]


def test_rounded_times_belong_to_the_frame_that_they_mean():
    """Oracle: at 24 time codes and 30 frames a second, frame i is at time code i * 0.8."""
    rate = Fraction(30)
    counted = [timecode_of(frame_count(i * 0.8, 24.0, rate), rate) for i in range(3000)]
    assert counted == [timecode_of(i, rate) for i in range(3000)]


@pytest.mark.parametrize("rate", [*map(Fraction, (24, 25, 30, 48, 50, 60)), Fraction(60000, 1001)])
def test_openexr_reads_every_frame_of_two_seconds(rate, tmp_path):
    """Oracle: OpenEXR's reader of the attribute; division by hand, in pairs above 30 frames."""
    from usdsplat.images import open_writer

    whole = round(rate)
    pairs = 2 if whole > 30 else 1
    for frame in (*range(0, 2 * whole, 7), whole - 1, 2 * whole - 1):
        file = tmp_path / "a.exr"
        layout = ImageLayout(resolution=(2, 1), metadata={"timeCode": timecode_of(frame, rate)})
        with open_writer(file, layout) as writer:
            writer.write_band(0, {"color": np.zeros((1, 2, 4), np.float32)})
        code = OpenEXR.File(str(file)).header()["timeCode"]
        found = (code.hours, code.minutes, code.seconds, code.frame, code.fieldPhase)
        within = frame % whole
        assert found == (0, 0, frame // whole, within // pairs, bool(within % pairs))


@pytest.mark.parametrize(
    ("text", "rate", "frame"),
    [
        ("01:00:00:00", Fraction(24000, 1001), 86400),
        ("00:00:01:24.1", Fraction(50), 99),
        ("00:00:00:24", Fraction(24), None),
        ("00:00:00:01.1", Fraction(24), None),
        ("00:00:00:01", Fraction(120), None),
    ],
)
def test_written_time_codes_are_frames(text, rate, frame):
    """Oracle: multiplication by hand; numbers that the rate does not have."""
    assert frame_of(parse_timecode(text, "--start-timecode"), rate) == frame


@pytest.mark.parametrize("text", ["", "1:00:00:00", "24:00:00:00", "00:60:00:00", "00:00:00:30"])
def test_other_notations_are_refused(text):
    """Oracle: the ranges of hours, minutes, seconds and frames."""
    with pytest.raises(UsageError):
        parse_timecode(text, "--start-timecode")


@pytest.mark.parametrize(("rate", "per_second"), [(25, 24), (23.976, 24), (24, 25), (30, 24)])
def test_the_first_frame_has_the_time_code_that_is_asked_for(rate: float, per_second: float):
    """Oracle: the option's promise, and that frames are counted on from there; the stage's first
    frame is 1001, which is not a whole number of frames from 0 at these rates."""
    start = timecode_offset("10:00:00:00", first=1001, rate=rate, per_second=per_second)
    found = [
        time_metadata(frame=frame, rate=rate, per_second=per_second, shutter=(0, 0), offset=start)[
            "timeCode"
        ]
        for frame in (1001, 1002, 1003)
    ]
    assert str(found[0]) == "10:00:00:00"
    assert [str(code) for code in found] == sorted(str(code) for code in found)
