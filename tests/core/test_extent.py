"""Tests of the bounding box of splats."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.extent import REACH, extent


def splats(n: int) -> SplatCloud:
    """Splats along x, one unit apart, twice as wide along y."""
    positions = np.zeros((n, 3), np.float32)
    positions[:, 0] = np.arange(n)
    return SplatCloud(
        positions=positions,
        scales=np.tile(np.float32([0.1, 0.2, 0.1]), (n, 1)),
        rotations=np.tile(np.float32([1, 0, 0, 0]), (n, 1)),
        opacities=np.ones(n, np.float32),
        sh=np.zeros((n, 1, 3), np.float32),
    )


def test_the_box_reaches_from_the_first_splat_to_the_last() -> None:
    """Oracle: centres 0 and 20000, and 0.1 or 0.2 times REACH; more splats than one chunk."""
    box = extent(splats(20_001))
    assert box is not None
    assert box.dtype == np.float64
    expected = REACH * np.array([[-0.1, -0.2, -0.1], [0.1, 0.2, 0.1]])
    expected[1, 0] += 20_000
    np.testing.assert_allclose(box, expected, rtol=1e-4)


def test_slack_widens_by_the_largest_scale() -> None:
    """Oracle: REACH times half of 0.2 in every direction."""
    wide, narrow = extent(splats(1), slack=0.5), extent(splats(1))
    assert wide is not None
    assert narrow is not None
    np.testing.assert_allclose(wide[1] - narrow[1], REACH * 0.1, rtol=1e-6)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", ["positions", "scales", "rotations"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_splats_that_are_not_finite_are_left_out_without_a_warning(name, value) -> None:
    """Oracle: the box of the other splat."""
    array = getattr(splats(2), name).copy()
    array[1] = value
    expected = extent(splats(1))
    assert expected is not None
    np.testing.assert_array_equal(extent(replace(splats(2), **{name: array})), expected)


@pytest.mark.filterwarnings("error")
def test_where_no_splat_is_left_there_is_no_box() -> None:
    """Oracle: the documented answer."""
    assert extent(splats(0)) is None
    lost = splats(3)
    assert extent(replace(lost, scales=lost.scales * np.float32(np.nan))) is None
