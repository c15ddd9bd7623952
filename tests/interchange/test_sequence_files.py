"""Tests of finding the files of a sequence and their common metadata."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from usdsplat.core.errors import FormatError, UsageError
from usdsplat.interchange.sequence_files import Notes, files_of


def touch(folder: Path, *frames: int) -> Path:
    """Empty files of a sequence; returns its pattern."""
    for frame in frames:
        (folder / f"cap.{frame:04d}.ply").touch()
    return folder / "cap.####.ply"


def test_files_come_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    """Oracle: written out by hand; printf's way of writing the place is the same."""
    pattern = touch(tmp_path, 10, 9, 11)
    assert list(files_of(pattern)) == [9, 10, 11]
    assert files_of(tmp_path / "cap.%04d.ply") == files_of(pattern)
    assert files_of(pattern, [11, 9]) == {
        9: tmp_path / "cap.0009.ply",
        11: tmp_path / "cap.0011.ply",
    }


@pytest.mark.parametrize(
    ("there", "asked", "missing"),
    [
        ((1, 2, 4), None, "frame 3,"),
        ((1, 3, 7, 8), None, "frames 2, 4 to 6,"),
        ((1, 999_999), None, "frames 2 to 999998,"),
        (range(1, 40, 2), None, "frames 2, 4, 6, 8, 10, 12, 14, 16 and others,"),
        ((1, 2), (1, 2, 3), "frame 3,"),
        ((1, 2), (1.5,), "frame 1.5,"),
    ],
)
def test_missing_frames_are_listed(tmp_path, there, asked, missing: str) -> None:
    """Oracle: written out by hand."""
    pattern = touch(tmp_path, *there)
    if asked == (1.5,):
        pattern = tmp_path / "cap.####.#.ply"
    with pytest.raises(FormatError, match=re.escape(f"found no file for {missing} expected")):
        files_of(pattern, asked)


def test_names_that_stand_for_no_file_are_refused(tmp_path: Path) -> None:
    """Oracle: a sentence for each."""
    with pytest.raises(FormatError, match=r"found no file of that name, expected one for each"):
        files_of(tmp_path / "cap.####.ply")
    with pytest.raises(FormatError, match=r"found no such file or directory, expected a folder"):
        files_of(tmp_path / "none" / "cap.####.ply")
    with pytest.raises(UsageError, match=r"found no placeholder, expected one placeholder for"):
        files_of(tmp_path / "cap.ply")


def test_notes_say_which_frames_they_are_about() -> None:
    """Oracle: written out by hand; what all frames say is said once."""
    notes = Notes()
    for time, said in ((1, ["a", "b"]), (2, ["a", "a"]), (3, ["a", "b", "c"]), (4, ["a", "b"])):
        notes.add(time, said)
    assert notes.told() == ("a", "frames 1, 3 to 4: b", "frame 3: c")
