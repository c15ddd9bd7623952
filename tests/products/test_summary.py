"""Tests of summaries of splats in values that JSON can hold."""

from __future__ import annotations

import numpy as np
import pytest

from tests.cli.conftest import ball
from usdsplat.products import summary


def test_a_cloud_that_is_not_finite_can_still_be_described():
    """Oracle: counted by hand; the bounds are those of what is left."""
    cloud = ball(4)
    cloud.positions[0] = np.nan
    cloud.positions[1] = np.inf
    cloud.opacities[0] = np.nan
    told = summary.of_cloud(cloud)
    assert told["not_finite"] == 7
    np.testing.assert_array_equal(told["bounds"][0], cloud.positions[2:].min(axis=0))


def test_flat_splats_have_no_anisotropy_and_do_not_hide_that_of_others():
    """Oracle: two splats by hand, of which the flat one's ratio is no number for JSON."""
    cloud = ball(2)
    cloud.scales[:] = [[0.1, 0.2, 0.0], [0.1, 0.4, 0.2]]
    assert summary.of_cloud(cloud)["anisotropy"]["p50"] == pytest.approx(4)


def test_an_empty_cloud_has_no_bounds():
    """Oracle: there is nothing to take a minimum of."""
    told = summary.of_cloud(ball(0))
    assert (told["splats"], told["bounds"], told["scale"]) == (0, None, None)
