"""Tests of the whole procedural capture."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from usdsplat.core import quaternion, sh
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import UsageError
from usdsplat.interchange.procedural import capture


@pytest.fixture(scope="module")
def small() -> SplatCloud:
    """A coarse one, quick to make."""
    return capture(20_000)


def test_the_default_is_rich_and_about_as_large_as_asked() -> None:
    """Oracle: the default of 200,000, to a tenth; a demo needs 150,000."""
    assert len(capture()) == pytest.approx(200_000, rel=0.1)


def test_equal_arguments_give_equal_clouds_and_seeds_differ(small: SplatCloud) -> None:
    """Oracle: a second call, bit for bit."""
    again, other = capture(20_000), capture(20_000, seed=8)
    for field in fields(small):
        if getattr(small, field.name) is not None:
            np.testing.assert_array_equal(getattr(small, field.name), getattr(again, field.name))
    assert not np.array_equal(small.positions[-100:], other.positions[-100:])


def test_it_stands_on_the_ground_in_metres_y_up(small: SplatCloud) -> None:
    """Oracle: the documented size: 2 m across about the origin, ground at 0, 0.8 m high."""
    radius = np.hypot(small.positions[:, 0], small.positions[:, 2])
    assert 0.98 < radius.max() < 1.06
    assert -0.06 < small.positions[:, 1].min() < 0
    assert 0.7 < small.positions[:, 1].max() < 0.9
    assert np.abs(small.positions[:, [0, 2]].mean(axis=0)).max() < 0.1
    pavement = (radius > 0.45) & (radius < 0.6) & (np.abs(small.positions[:, 1]) < 0.002)
    axes = quaternion.to_matrix(small.rotations[pavement])
    thin = axes[np.arange(len(axes)), :, small.scales[pavement].argmin(axis=1)]
    assert (np.abs(thin[:, 1]) > 0.98).all()  # flat splats lie flat


def test_values_are_legal(small: SplatCloud) -> None:
    """Oracle: what `SplatCloud` documents."""
    assert small.sh_degree == 3
    for field in fields(small):
        array = getattr(small, field.name)
        assert array is None or np.isfinite(array).all(), field.name
    np.testing.assert_allclose(np.linalg.norm(small.rotations, axis=1), 1, atol=1e-5)
    assert (small.scales > 0).all() and small.scales.max() < 0.1
    assert (small.opacities > 0.5).all() and (small.opacities <= 1).all()


def test_surfaces_are_discs_and_strands_are_needles(small: SplatCloud) -> None:
    """Oracle: sorted standard deviations: thin, wide, wide or thin, thin, long."""
    a, b, c = np.sort(small.scales, axis=1).T
    is_disc, is_needle = a < 0.35 * b, (c > 2.5 * b) & (b < 1.3 * a)
    assert is_disc.mean() > 0.5
    assert is_needle.mean() > 0.15
    assert (is_disc | is_needle | (b > 0.2 * c)).all()


def test_colours_are_displayable_and_change_with_the_view(small: SplatCloud) -> None:
    """Oracle: [0, 1] with some ringing; shell and gold shimmer, bare soil does not."""
    seen = []
    for direction in ((0, 0, -1), (0.8, -0.6, 0), (-0.6, -0.8, 0)):
        d = np.tile(np.float32([direction]), (len(small), 1))
        seen.append(sh.evaluate(small.sh, d))
    colours = np.stack(seen)
    assert np.quantile(colours, 0.999) < 1.1
    assert colours.std(axis=1).min() > 0.1  # a picture, not a grey
    change = np.ptp(colours, axis=0).max(axis=1)
    assert np.median(change[small.positions[:, 1] > 0.4]) > 0.12
    assert (change == 0).mean() > 0.01


def test_a_handful_of_splats_is_refused() -> None:
    """Oracle: the documented lower limit."""
    with pytest.raises(UsageError, match="count: found 10, expected 2000 or more"):
        capture(10)
    assert len(capture(2_000)) > 1_000
