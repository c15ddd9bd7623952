"""Tests of the reference for garbage mattes."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.render.cropping import inside
from usdsplat.render.specs import IDENTITY, CropSpec

POINTS = {
    "sphere": ([(0, 0, 1), (0.57, 0.57, 0.57)], [(0, 0, 1.01), (0.58, 0.58, 0.58)]),
    "cube": ([(1, -1, 1), (0, 0.9, 0)], [(0, 1.01, 0), (-1.01, 0, 0)]),
    "cylinder": ([(0.6, 0.79, 1), (0, -1, 0)], [(0.71, 0.71, 0), (0, 0, -1.01)]),
    "cone": ([(0, 1, -1), (0.49, 0, 0), (0, 0, 1)], [(0, 0.51, 0), (0, 0, 1.01), (0, 0, -1.01)]),
    "capsule": ([(0, 0, 3), (1, 0, -2), (0.7, 0, 2.7)], [(0, 0, 3.01), (0.8, 0, 2.8)]),
    "plane": ([(9, 9, 0), (0, 0, -99)], [(0, 0, 0.01)]),
}


@pytest.mark.parametrize("shape", POINTS)
def test_the_canonical_shapes_are_those_that_are_described(shape):
    """Oracle: points on either side of each surface, by hand; the capsule's segment is 2 long."""
    crop = CropSpec(shape=shape, world_to_shape=IDENTITY, keeps=True, length=2.0)
    within, without = POINTS[shape]
    assert inside([crop], np.float32(within)).all()
    assert not inside([crop], np.float32(without)).any()


def test_what_keeps_is_joined_and_what_does_not_is_taken_away():
    """Oracle: set algebra on a line, with balls at 0 and 1.5 and a hole at 1.5."""

    def ball(x, radius, keeps):
        s = 1 / radius
        matrix = (s, 0, 0, -s * x, 0, s, 0, 0, 0, 0, s, 0, 0, 0, 0, 1)
        return CropSpec(shape="sphere", world_to_shape=matrix, keeps=keeps)

    points = np.zeros((4, 3))
    points[:, 0] = (-0.9, 0.7, 1.5, 4.0)
    one, two, hole = ball(0, 1, True), ball(1.5, 1, True), ball(1.5, 0.5, False)
    assert inside([], points).tolist() == [True, True, True, True]
    assert inside([one], points).tolist() == [True, True, False, False]
    assert inside([one, two], points).tolist() == [True, True, True, False]
    assert inside([hole, one, two], points).tolist() == [True, True, False, False]
    assert inside([hole], points).tolist() == [True, True, False, True]


def test_points_that_are_nowhere_are_in_nothing():
    """Oracle: NaN compares false."""
    points = np.array([[np.nan, 0, 0], [np.inf, 0, 0]])
    for shape in POINTS:
        crop = CropSpec(shape=shape, world_to_shape=IDENTITY, keeps=True)
        assert not inside([crop], points).any()
