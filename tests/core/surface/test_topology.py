"""Tests of the validation of mesh topology."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.core.surface.meshes import CUBE_FACES, CUBE_POINTS, surface
from usdsplat.core.errors import StageError
from usdsplat.core.surface.refine import Surface
from usdsplat.core.surface.topology import Topology, creases


def whole(**rest: Any) -> Topology:
    """A quad and what is given."""
    given: dict[str, Any] = {"counts": np.int32([4]), "indices": np.int32([0, 1, 2, 3]), **rest}
    return Topology(**given)


@pytest.mark.parametrize(
    ("rest", "message"),
    [
        (
            {"counts": np.int32([5])},
            "4 face vertex indices, expected 5, the sum of the face vertex counts",
        ),
        ({"counts": np.int32([-1, 5])}, "a face of -1 corners, expected none below 0"),
        ({"indices": np.int32([0, 1, 2, 4])}, "face vertex index 4, expected 0 or more and less"),
        ({"indices": np.int32([0, 1, -2, 3])}, "face vertex index -2, expected"),
        ({"holes": np.int32([1])}, "hole 1, expected 0 or more and less than 1"),
        ({"crease_lengths": np.int32([2])}, "0 crease indices, expected 2, the sum"),
        (
            {"crease_lengths": np.int32([1]), "crease_indices": np.int32([1])},
            "a crease of 1 points, expected two points or more",
        ),
        (
            {"crease_lengths": np.int32([4]), "crease_indices": np.int32([0, 1, 2, 3])},
            "0 crease sharpnesses, expected 1, one for each crease, or 3, one for each edge",
        ),
        ({"corner_indices": np.int32([4])}, "corner index 4, expected"),
        ({"corner_indices": np.int32([3])}, "0 corner sharpnesses, expected 1, one for each"),
        ({"scheme": "loop"}, "a face of 4 corners, expected triangles, for the loop scheme"),
    ],
)
def test_a_topology_that_does_not_hold_together_is_refused(
    rest: dict[str, Any], message: str
) -> None:
    """Oracle: one sentence with the prim, what is there and what should be."""
    with pytest.raises(StageError, match=f"/World/Box: found {message}"):
        Surface(whole(**rest), points=4, where="/World/Box")


def test_a_crease_has_one_sharpness_or_one_for_each_edge() -> None:
    """Oracle: the edges of two chains, written out."""
    chains = {"crease_indices": np.int32([0, 1, 2, 2, 3]), "crease_lengths": np.int32([3, 2])}
    for sharpness, expected in (([1, 2], [1, 1, 2]), ([3, 4, 5], [3, 4, 5])):
        first, second, sharp = creases(whole(**chains, crease_sharpnesses=np.float32(sharpness)))
        assert first.tolist() == [0, 1, 2]
        assert second.tolist() == [1, 2, 3]
        assert sharp.tolist() == expected


def test_faces_without_area_are_dropped_and_values_keep_their_places() -> None:
    """Oracle: the cube alone, with a face of no corners, one of two and one of a repeated point in
    between; a quad that repeats a point is a triangle."""
    slivers = [[], [0, 1], *CUBE_FACES[:3], [5, 5, 6], *CUBE_FACES[3:]]
    values = np.arange(sum(map(len, slivers)), dtype=np.float32)
    for scheme in ("none", "bilinear"):
        plain = surface(CUBE_FACES, 8, scheme=scheme)
        padded = surface(slivers, 8, scheme=scheme)
        np.testing.assert_array_equal(plain.triangles, padded.triangles)
        assert set(padded.faces) == {2, 3, 4, 6, 7, 8}
        expected = plain.corners(np.concatenate([values[2:14], values[17:]]), "faceVarying")
        np.testing.assert_array_equal(padded.corners(values, "faceVarying"), expected)
    collapsed = surface([[0, 1, 1, 2]], 3, scheme="none")
    np.testing.assert_array_equal(collapsed.triangles, [[0, 1, 2]])
    values = collapsed.corners(np.float32([3, 5, 7, 9]), "faceVarying")[0, :, 0]
    assert values[0] == 3
    assert values[2] == 9


def test_creases_between_points_without_an_edge_say_nothing() -> None:
    """Oracle: the cube without creases."""
    plain, creased = surface(CUBE_FACES, 8), surface(CUBE_FACES, 8, {(0, 7): 10.0})
    np.testing.assert_array_equal(plain.points(CUBE_POINTS), creased.points(CUBE_POINTS))


def test_a_sharpness_that_is_no_number_or_below_zero_is_none() -> None:
    """Oracle: the cube without creases and corners."""
    plain = surface(CUBE_FACES, 8).points(CUBE_POINTS)
    for sharpness in (np.nan, -3.0):
        odd = surface(
            CUBE_FACES,
            8,
            {(0, 1): sharpness},
            corner_indices=np.int32([3]),
            corner_sharpnesses=np.float32([sharpness]),
        )
        np.testing.assert_array_equal(odd.points(CUBE_POINTS), plain)
