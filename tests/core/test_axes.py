"""Tests of axes named by three letters."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from usdsplat.core.axes import UP_AXIS_FRAME, change, flipped, frame_matrix
from usdsplat.core.errors import UsageError

FRAMES = [
    "".join(letters)
    for axes in itertools.permutations(("rl", "ud", "fb"))
    for letters in itertools.product(*axes)
]


def test_known_changes_of_frame() -> None:
    """Oracle: the directions themselves, worked out by hand."""
    np.testing.assert_array_equal(change("rdf", "rub"), np.diag([1, -1, -1]))
    z_up = change("rub", "rfu")  # up is +y there and +z here, back +z there and -y here
    np.testing.assert_array_equal(z_up @ [1, 2, 3], [1, -3, 2])
    assert UP_AXIS_FRAME == {"Y": "rub", "Z": "rfu"}


@pytest.mark.parametrize("frame", FRAMES)
def test_each_of_the_48_frames_is_a_signed_permutation(frame: str) -> None:
    """Oracle: its columns are where its axes point; handedness is their triple product."""
    matrix = frame_matrix(frame)
    unit = {"r": [1, 0, 0], "u": [0, 1, 0], "b": [0, 0, 1], "l": [-1, 0, 0], "d": [0, -1, 0]}
    unit["f"] = [0, 0, -1]
    np.testing.assert_array_equal(matrix.T, [unit[letter] for letter in frame])
    assert np.linalg.det(matrix) == pytest.approx(np.dot(np.cross(*matrix.T[:2]), matrix.T[2]))


def test_changes_of_frame_compose() -> None:
    """Oracle: going through a third frame, or there and back, is the same."""
    for a, b, c in (("rdf", "rub", "rfu"), ("luf", "rdf", "bru"), ("rub", "rub", "ldb")):
        np.testing.assert_array_equal(change(b, c) @ change(a, b), change(a, c))
        np.testing.assert_array_equal(change(b, a) @ change(a, b), np.eye(3))


@pytest.mark.parametrize("frame", ["", "rd", "rdff", "rlu", "xyz", "RUB", "ruu"])
def test_other_names_are_refused(frame: str) -> None:
    """Oracle: they do not name three perpendicular directions."""
    with pytest.raises(UsageError, match="axes: found"):
        change(frame, "rub")


def test_a_capture_upside_down_is_turned_about_the_direction_right():
    """Oracle: half a turn about x in the reference axes, a diagonal matrix."""
    turn = np.diag([1, -1, -1])
    for frame in ("rdf", "rub", "rfu", "lub", "ulf"):
        assert np.array_equal(frame_matrix(flipped(frame)), turn @ frame_matrix(frame))
    assert flipped("rdf") == "rub"
