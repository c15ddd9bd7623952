"""Tests of splats in flight. Oracles: the splats on the ground, and what a grain is."""

from __future__ import annotations

import numpy as np

from tests.sim.recipes import ball
from usdsplat.core.cloud import SplatCloud
from usdsplat.sim.flying import LARGEST, MOST_GROWTH, TORN, WHOLE, Flight

COUNT = 400
COLOR = np.array([0.4, -0.2, 0.1], np.float32)


def flown(cloud: SplatCloud, rows: np.ndarray, part: float, stretch: float) -> SplatCloud:
    """Return splats of which some are on their way, with spacings of 0.01 and 0.03."""
    m = len(rows)
    flight = Flight(
        rows=rows, part=np.full(m, part, np.float32), spacings=(0.01, 0.03),
        stretch=np.full(m, stretch, np.float32), colors=np.tile(COLOR, (m, 1)),
    )  # fmt: skip
    return flight.seen(cloud)


def test_splats_that_are_not_on_their_way_keep_every_bit() -> None:
    """Oracle: the rows of the cloud itself, while every other splat is a grain."""
    cloud = ball(COUNT)
    rows = np.arange(0, COUNT, 2)
    seen = flown(cloud, rows, 0.5, TORN)
    assert not np.array_equal(seen.scales[rows], cloud.scales[rows])
    for name in ("positions", "rotations", "scales", "opacities", "sh"):
        assert np.array_equal(getattr(seen, name)[rows + 1], getattr(cloud, name)[rows + 1])


def test_grains_are_finite_whatever_the_colours_are() -> None:
    """Oracle: the mean colour."""
    cloud = ball(COUNT)
    cloud.sh[::7] = np.nan
    seen = flown(cloud, np.arange(COUNT), 0.5, TORN)
    np.testing.assert_allclose(seen.sh[:, 0], np.tile(COLOR, (COUNT, 1)), rtol=1e-5)
    assert not seen.sh[:, 1:].any()


def test_splats_keep_their_look_where_neighbours_stay_together() -> None:
    """Oracle: the cloud itself."""
    cloud = ball(COUNT)
    seen = flown(cloud, np.arange(COUNT), 0.5, WHOLE)
    assert seen is cloud


def test_what_is_torn_is_round_and_opaque_or_not_there() -> None:
    """Oracle: a grain: three equal axes, limited by the distance of what carries it, which changes
    on the way; faint splats are gone, others are nearly opaque; all have the mean colour."""
    cloud = ball(COUNT)
    cloud.opacities[:] = np.repeat(np.array([0.02, 0.9], np.float32), COUNT // 2)
    seen = flown(cloud, np.arange(COUNT), 0.5, TORN)
    np.testing.assert_allclose(seen.scales, seen.scales[:, :1] * np.ones(3), rtol=1e-5)
    assert seen.scales.max() <= LARGEST * MOST_GROWTH * 0.02 * 1.0001
    assert seen.opacities[: COUNT // 2].max() == 0 and seen.opacities[COUNT // 2 :].min() > 0.9
    np.testing.assert_allclose(seen.sh[:, 0], np.tile(COLOR, (COUNT, 1)), rtol=1e-5)
    assert not seen.sh[:, 1:].any()
