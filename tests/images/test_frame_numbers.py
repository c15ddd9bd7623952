"""Tests of frame ranges and of file names with a frame number."""

from __future__ import annotations

from pathlib import Path

import pytest

from usdsplat.core.errors import UsageError
from usdsplat.images.frame_numbers import (
    frame_path,
    frame_paths,
    frames_found,
    has_place,
    parse_frames,
    without_place,
)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("7", [7]),
        ("1-4", [1, 2, 3, 4]),
        ("1:4", [1, 2, 3, 4]),
        ("1-10x4", [1, 5, 9]),
        ("1-10x2,20", [1, 3, 5, 7, 9, 20]),
        ("3-1", [3, 2, 1]),
        ("10:1x-3", [10, 7, 4, 1]),
        ("-2-2x2", [-2, 0, 2]),
        ("-4--2", [-4, -3, -2]),
        ("1-2x0.25", [1, 1.25, 1.5, 1.75, 2]),
        ("0-1x0.1", [i / 10 for i in range(11)]),
        ("1, 5 ,3", [1, 5, 3]),
        ("1-3,2-4", [1, 2, 3, 4]),
        ("12.5", [12.5]),
    ],
)
def test_ranges_name_these_frames(text, expected):
    """Oracle: written out by hand."""
    assert parse_frames(text) == pytest.approx(expected)


@pytest.mark.parametrize(
    "text", ["", "a", "1-", "1-10x0", "1-10x-1", "1--", "1 10", "1x2", "1-2-3", ",", "1e3", "nan"]
)
def test_what_is_no_range_is_refused(text):
    """Oracle: one sentence that shows what is expected."""
    with pytest.raises(UsageError, match=r"frames: found .*, expected"):
        parse_frames(text)


def test_a_slip_of_the_finger_is_not_a_week_of_rendering():
    """Oracle: the limit; nothing is allocated for it."""
    with pytest.raises(UsageError, match=r"1000000000001 frames .* expected 1000000 or fewer"):
        parse_frames("0-1000000000000")


@pytest.mark.parametrize(
    ("pattern", "frame", "expected"),
    [
        ("out.####.exr", 7, "out.0007.exr"),
        ("out.##.exr", 123, "out.123.exr"),
        ("take#2.####.exr", 7, "take#2.0007.exr"),
        ("out.$F.exr", 7, "out.7.exr"),
        ("out.$F4.exr", 7, "out.0007.exr"),
        ("out.${F4}F.exr", 7, "out.0007F.exr"),
        ("out_$F4_v2.exr", 1001, "out_1001_v2.exr"),
        ("out.<F>.exr", 7, "out.7.exr"),
        ("out.<F4>.exr", 7, "out.0007.exr"),
        ("out.<f4>.exr", 7, "out.0007.exr"),
        ("out.$FF.exr", 7.25, "out.7.25.exr"),
        ("out.<FF>.exr", 7, "out.7.exr"),
        ("out.$FF.exr", -0.0, "out.0.exr"),
        ("out_%04d.exr", 7, "out_0007.exr"),
        ("out_%d.exr", 7, "out_7.exr"),
        ("out.####.exr", -7, "out.-007.exr"),
        ("out.####.##.exr", 7.25, "out.0007.25.exr"),
        ("out.####.##.exr", 7, "out.0007.00.exr"),
        ("out.exr", 7, "out.exr"),
        ("a.##/out.####.exr", 7, "a.##/out.0007.exr"),
        ("100%.####.exr", 7, "100%.0007.exr"),
    ],
)
def test_names_take_the_number(pattern, frame, expected):
    """Oracle: written out by hand; C's printf for the sign."""
    assert frame_path(pattern, frame) == Path(expected)
    assert has_place(pattern) == (expected != pattern)


@pytest.mark.parametrize("name", ["take#2.exr", "$FOO.exr", "$F4x.exr", "<Frame>.exr", "%4d.exr"])
def test_other_names_have_no_place(name):
    """Oracle: a single # is a letter, and other variables are none of ours."""
    assert not has_place(name)
    assert frame_path(name, 7) == Path(name)


def test_names_without_room_are_refused():
    """Oracle: two frames in one file, or half a frame in a whole number, lose a picture."""
    with pytest.raises(UsageError, match=r"2 frames, expected a placeholder for the frame number"):
        frame_paths("out.exr", (1, 2))
    with pytest.raises(UsageError, match=r"frame 1\.5, expected room for its fraction"):
        frame_path("out.####.exr", 1.5)
    with pytest.raises(UsageError, match="2 frames"):
        frame_paths("out.##.#.exr", (1.01, 1.02))
    with pytest.raises(UsageError, match="2 placeholders"):
        frame_path("out.####.%04d.exr", 1)


def test_a_single_frame_needs_no_place():
    """Oracle: the name as it was given."""
    assert frame_paths("out.exr", (12.5,)) == (Path("out.exr"),)
    assert frame_paths("out.##.exr", (1, 2)) == (Path("out.01.exr"), Path("out.02.exr"))


@pytest.mark.parametrize(
    ("pattern", "expected"),
    [
        ("cap.####.ply", {-1: "cap.-001.ply", 2: "cap.0002.ply", 12345: "cap.12345.ply"}),
        ("cap.%04d.ply", {-1: "cap.-001.ply", 2: "cap.0002.ply", 12345: "cap.12345.ply"}),
        ("cap.%d.ply", {3: "cap.3.ply", 12345: "cap.12345.ply"}),
        ("cap.$F.ply", {3: "cap.3.ply", 12345: "cap.12345.ply"}),
        ("cap.<F4>.ply", {-1: "cap.-001.ply", 2: "cap.0002.ply", 12345: "cap.12345.ply"}),
        ("cap.$FF.ply", {3: "cap.3.ply", 12345: "cap.12345.ply"}),
        ("cap.####.##.ply", {2.5: "cap.0002.50.ply"}),
        ("cap[1]+####.ply", {1: "cap[1]+0001.ply"}),
        ("none.####.ply", {}),
    ],
)
def test_files_of_a_pattern_are_found(tmp_path, pattern, expected):
    """Oracle: written out by hand; what `frame_path` would not name is somebody else's."""
    names = ["cap.12345.ply", "cap.0002.ply", "cap.-001.ply", "cap.3.ply", "cap.04.ply", "cap..ply"]
    names += [
        "cap.0002.50.ply",
        "cap[1]+0001.ply",
        "xcap.0007.ply",
        "cap.0007.plyx",
        "cap.٠٠٠١.ply",
    ]
    names += [f"cap.{'9' * 200}.ply"]
    for name in names:
        (tmp_path / name).touch()
    found = frames_found(tmp_path / pattern)
    assert {frame: path.name for frame, path in found.items()} == expected
    assert list(found) == sorted(found)


@pytest.mark.parametrize("pattern", ["cap.ply", "cap.##.x.##.ply"])
def test_files_are_found_by_one_place(tmp_path, pattern):
    """Oracle: one sentence; without a number there is no sequence."""
    with pytest.raises(UsageError, match=r"place.*, expected one placeholder for the frame number"):
        frames_found(tmp_path / pattern)


@pytest.mark.parametrize(
    ("pattern", "expected"),
    [
        ("in/cap.####.ply", "in/cap.ply"),
        ("cap_%04d.compressed.ply", "cap.compressed.ply"),
        ("cap.####.##.ply", "cap.ply"),
        ("####.ply", ".ply"),
        ("cap.$F4.ply", "cap.ply"),
        ("cap.ply", "cap.ply"),
    ],
)
def test_a_pattern_has_a_name_without_the_number(pattern, expected):
    """Oracle: written out by hand."""
    assert without_place(pattern) == Path(expected)
