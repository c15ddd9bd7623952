"""Tests of splats in flight. Oracles: the splats at both ends, and what a grain is."""

from __future__ import annotations

import numpy as np

from tests.sim.recipes import ball
from usdsplat.sim.flying import LARGEST, in_flight

COUNT = 400


def test_splats_that_are_not_on_their_way_keep_every_bit() -> None:
    """Oracle: the cloud itself before the start and after the arrival of all; its rows of those
    that have not started or have arrived while others fly."""
    cloud = ball(COUNT)
    for still in (0.0, 1.0):
        assert in_flight(cloud, np.full(COUNT, still, np.float32), 0.1, 0.1) is cloud
    part = np.repeat(np.array([0, 0.5, 1, 0.5], np.float32), COUNT // 4)
    flown = in_flight(cloud, part, 0.1, 0.1)
    rows = (part == 0) | (part == 1)
    for name in ("positions", "rotations", "scales", "opacities", "sh"):
        assert np.array_equal(getattr(flown, name)[rows], getattr(cloud, name)[rows])


def test_what_flies_is_round_and_opaque_or_not_there() -> None:
    """Oracle: a grain: three equal axes, no longer than a part of the distance of what carries it,
    which changes on the way; faint splats are gone, others are nearly opaque."""
    cloud = ball(COUNT)
    cloud.opacities[:] = np.repeat(np.array([0.02, 0.9], np.float32), COUNT // 2)
    flown = in_flight(cloud, np.full(COUNT, 0.5, np.float32), 0.01, 0.03)
    np.testing.assert_allclose(flown.scales, flown.scales[:, :1] * np.ones(3), rtol=1e-5)
    assert flown.scales.max() <= LARGEST * 0.02 * 1.0001
    assert flown.opacities[: COUNT // 2].max() == 0 and flown.opacities[COUNT // 2 :].min() > 0.9
