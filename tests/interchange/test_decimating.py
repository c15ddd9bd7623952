"""Tests of decimation."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from benchmarks import minification
from benchmarks.decimation import at_random, picture, psnr, thinner, views
from tests.formats.samples import random_cloud
from tests.interchange.samples import assert_same
from usdsplat import formats
from usdsplat.core import edit
from usdsplat.core.errors import UsageError
from usdsplat.interchange.decimating import FAR_LINES, decimate, framing_pixel, level
from usdsplat.kernels.devices import open_device
from usdsplat.render.renderer import Renderer


def named(count, degree=1, seed=0):
    """A random cloud with ids and velocities."""
    random = np.random.default_rng(seed)
    return replace(
        random_cloud(count, degree, seed),
        ids=random.permutation(count) + 1000,
        velocities=random.normal(size=(count, 3)).astype(np.float32),
    )


def masses(cloud):
    """Opacity times the root mean square area, float64."""
    a, b, c = cloud.scales.astype(np.float64).T ** 2
    return np.sqrt((a * b + b * c + c * a) / 3) * cloud.opacities


def rows_of(cloud, found):
    """Rows of `cloud` that the ids of another name."""
    return [cloud.ids.tolist().index(each) for each in found.ids]


@pytest.mark.parametrize("count", [1, 2, 100, 499])
def test_as_many_are_left_as_were_wanted(count) -> None:
    """Oracle: closed form; and all numbers are finite, turns of unit length, ids unique."""
    found = decimate(named(500), count)
    assert len(found) == count
    for field in fields(found):
        assert np.isfinite(getattr(found, field.name)).all(), field.name
    np.testing.assert_allclose(np.linalg.norm(found.rotations, axis=1), 1, atol=1e-6)
    assert found.opacities.min() > 0 and found.opacities.max() <= 0.999
    assert len(np.unique(found.ids)) == count


@pytest.mark.parametrize("count", [20, 21])
def test_no_more_than_wanted_are_left_alone(count) -> None:
    """Oracle: itself."""
    cloud = named(20)
    assert decimate(cloud, count) is cloud


@pytest.mark.parametrize("count", [0, -5])
def test_none_at_all_cannot_be_wanted(count) -> None:
    """Oracle: a person's expectation."""
    with pytest.raises(UsageError, match=f"found {count} splats, expected 1 or more"):
        decimate(named(20), count)


def test_mass_and_what_it_weighs_are_kept() -> None:
    """Oracle: sums over all splats before and after, float64; nothing here becomes opaque, and
    splats are too small to hide anything of each other."""
    cloud = named(2000, degree=2)
    cloud.scales[:] *= np.float32(1e-3)
    found = decimate(cloud, 500)
    before, after = masses(cloud), masses(found)
    assert after.sum() == pytest.approx(before.sum(), rel=1e-4)
    for name in ("positions", "sh", "velocities"):
        expected = np.tensordot(before, getattr(cloud, name), axes=1)
        total = np.tensordot(after, getattr(found, name), axes=1)
        np.testing.assert_allclose(total, expected, atol=1e-4 * before.sum(), err_msg=name)


def test_those_that_were_merged_with_none_are_as_they_were() -> None:
    """Oracle: the rows that the ids name; one pair makes one splat of two."""
    cloud = named(300)
    found = decimate(cloud, 299)
    kept = edit.take(cloud, np.array(rows_of(cloud, found)))
    same = (found.positions == kept.positions).all(axis=1)
    assert same.sum() == 298
    assert_same(edit.take(found, same), edit.take(kept, same))
    assert rows_of(cloud, found) == sorted(rows_of(cloud, found))


def test_of_a_pair_the_heavier_gives_its_name() -> None:
    """Oracle: closed form."""
    cloud = named(2)
    for opacities in ((0.01, 0.9), (0.9, 0.01)):
        pair = replace(
            cloud,
            scales=np.full((2, 3), 0.1, np.float32),
            opacities=np.array(opacities, np.float32),
        )
        assert decimate(pair, 1).ids == cloud.ids[np.argmax(opacities)]


def test_what_no_picture_shows_goes_first() -> None:
    """Oracle: the other splats, bit for bit."""
    cloud = named(400)
    cloud.opacities[::4] = 0.003
    shown = edit.take(cloud, cloud.opacities > 0.003)
    assert_same(decimate(cloud, 300), shown)
    assert len(decimate(cloud, 301)) == 301
    assert_same(decimate(cloud, 100), decimate(shown, 100))


def test_what_is_not_finite_goes_first() -> None:
    """Oracle: the sound splats alone."""
    cloud = named(400)
    cloud.positions[3, 1], cloud.sh[7, 2, 0], cloud.scales[9, 0] = np.nan, np.inf, np.inf
    sound = np.setdiff1d(np.arange(400), [3, 7, 9])
    assert_same(decimate(cloud, 399), edit.take(cloud, sound))  # fewer than there may be
    assert_same(decimate(cloud, 100), decimate(edit.take(cloud, sound), 100))


def test_the_cloud_that_is_given_stays_as_it_is() -> None:
    """Oracle: a copy."""
    cloud = named(300)
    before = edit.take(cloud, np.arange(300))
    decimate(cloud, 50)
    assert_same(cloud, before)


def test_one_thread_and_several_merge_the_same() -> None:
    """Oracle: a single thread."""
    cloud = named(5000)
    one, all_ = (decimate(cloud, 1000, device=open_device(threads=t)) for t in (1, None))
    assert_same(one, all_)


class Listener:
    """Remembers what it is told."""

    def __init__(self):
        self.told = []

    def step(self, label, done, total):
        self.told.append((label, done, total))


def test_the_order_of_splats_does_not_matter() -> None:
    """Oracle: the same splats in another order; costs of pairs do not depend on it, and equal ones
    are not among them."""
    cloud = named(3000)
    mixed = edit.take(cloud, np.random.default_rng(5).permutation(3000))
    found, other = decimate(cloud, 700), decimate(mixed, 700)
    assert rows_of(mixed, other) == sorted(rows_of(mixed, other))
    assert_same(edit.take(found, np.argsort(found.ids)), edit.take(other, np.argsort(other.ids)))


@pytest.mark.parametrize("pixel", [-1.0, np.nan, np.inf])
@pytest.mark.parametrize("function", [decimate, level])
def test_a_pixel_has_a_size(function, pixel) -> None:
    """Oracle: a person's expectation."""
    with pytest.raises(UsageError, match="expected a finite size, 0 or more"):
        function(named(20), 10, pixel=pixel)


def widened(cloud, variance):
    """The same splats with a variance added along every axis."""
    squares = cloud.scales.astype(np.float64) ** 2 + variance
    return replace(cloud, scales=np.sqrt(squares).astype(np.float32))


def test_a_level_is_merged_from_widened_splats() -> None:
    """Oracle: decimation of splats to whose variances 0.3 pixel^2 was added by hand; where nothing
    is merged, they are these splats. Nothing here becomes opaque."""
    cloud = named(800)
    cloud.opacities[:] = 0.02 * cloud.opacities + 0.004
    by_hand = widened(cloud, 0.3 * 0.2**2)
    assert level(cloud, 800) is cloud
    for count in (800, 200):
        found, expected = level(cloud, count, pixel=0.2), decimate(by_hand, count)
        np.testing.assert_array_equal(found.ids, expected.ids)
        for name in ("positions", "scales", "rotations", "opacities", "sh"):
            np.testing.assert_allclose(
                getattr(found, name), getattr(expected, name), rtol=1e-3, atol=1e-4, err_msg=name
            )


def test_decimation_at_a_pixel_removes_its_low_pass() -> None:
    """Oracle: the level for this pixel, whose merged splats have 0.3 pixel^2 more along every axis;
    splats that were not merged are as they were. Nothing here becomes opaque."""
    cloud = named(800)
    cloud.opacities[:] = 0.02 * cloud.opacities + 0.004
    found, wide = decimate(cloud, 500, pixel=0.2), level(cloud, 500, pixel=0.2)
    again = widened(found, 0.3 * 0.2**2)
    np.testing.assert_allclose(
        np.sort(again.scales, axis=1), np.sort(wide.scales, axis=1), rtol=1e-4
    )
    for name in ("positions", "opacities", "sh", "ids"):
        np.testing.assert_array_equal(getattr(found, name), getattr(wide, name))
    kept = edit.take(cloud, np.array(rows_of(cloud, found)))
    same = (found.positions == kept.positions).all(axis=1)
    assert same.sum() > 100
    assert_same(edit.take(found, same), edit.take(kept, same))


def test_a_level_may_have_opacities_above_1() -> None:
    """Oracle: closed form: none is above the peak, some are above 1 if that is allowed."""
    cloud = named(2000)
    for peak in (0.999, 2.0):
        most = level(cloud, 100, peak=peak).opacities.max()
        assert most <= np.float32(peak) and (most > 1) == (peak > 1)


def test_the_pixel_of_a_picture_that_frames_a_capture() -> None:
    """Oracle: closed form: splats on a sphere, of which a picture of 100 lines shows 2 radii; of
    small ones, it shows 1080."""
    random = np.random.default_rng(0)
    cloud = named(500, degree=0)
    directions = random.normal(size=(500, 3))
    directions = np.concatenate([directions[:250], -directions[:250]])  # their mean is 0
    positions = 3 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    scales = np.tile(np.float32([0.01, 0.1, 0.2]), (500, 1))
    cloud = replace(cloud, positions=positions.astype(np.float32), scales=scales)
    cloud.opacities[:] = 0.5
    assert framing_pixel(cloud, 100) == pytest.approx(0.06, rel=0.02)  # the middle is a splat
    cloud.scales[:] *= np.float32(0.01)
    assert framing_pixel(cloud, 100) == pytest.approx(0.0108, rel=1e-5)
    cloud.positions[::2] = np.nan
    assert framing_pixel(cloud, 100) == pytest.approx(0.0108, rel=1e-5)
    assert framing_pixel(edit.take(cloud, np.arange(0))) == 0
    cloud.opacities[:] = 0
    assert framing_pixel(cloud) == 0


def test_splats_far_away_do_not_change_the_pixel() -> None:
    """Oracle: the pixel without them."""
    cloud = random_cloud(4000, 0)
    cloud.scales[:], cloud.opacities[:] = 0.1, 0.5
    near = framing_pixel(cloud)
    cloud.positions[:3] = 1e30
    assert framing_pixel(cloud) == pytest.approx(near, rel=0.02)


def test_it_says_how_far_it_is() -> None:
    """Oracle: closed form: from none to all, never back."""
    listener = Listener()
    decimate(named(1000), 100, progress=listener)
    done = [each[1] for each in listener.told]
    assert done[0] == 0 and done[-1] == 900 and done == sorted(done)
    assert {(label, total) for label, _, total in listener.told} == {("merging splats", 900)}


def test_ever_so_many_at_one_place_take_few_rounds() -> None:
    """Oracle: a person's expectation; a search among them all would not end."""
    cloud = named(100_000, degree=0)
    cloud.positions[100:] = cloud.positions[0]
    listener = Listener()
    assert len(decimate(cloud, 200, progress=listener)) == 200
    assert len(listener.told) < 60


EXTREMES = {
    "points": {"scales": 0},
    "needles": {"scales": np.array([1, 0, 0], np.float32)},
    "as large as can be": {"scales": np.float32(1e38)},
    "no distances": {"positions": np.float32(1e37)},
    "denormal": {"positions": np.float32(1e-38), "scales": np.float32(1e-38)},
    "no rotation": {"rotations": 0},
    "clear": {"opacities": 0},
    "bright": {"sh": np.float32(1e30)},
    "on a line": {"positions": np.array([1, 0, 0], np.float32)},
}


@pytest.mark.parametrize("name", EXTREMES)
def test_extreme_numbers_neither_hang_nor_spread(name) -> None:
    """Oracle: a person's expectation: so many are left, finite; a round takes a good part away."""
    cloud = named(2000, degree=1)
    for array, factor in EXTREMES[name].items():
        getattr(cloud, array)[:] *= factor
    listener = Listener()
    found = decimate(cloud, 20, progress=listener)
    assert len(found) == 20 and len(listener.told) < 80
    for field in fields(found):
        assert np.isfinite(getattr(found, field.name)).all(), field.name


def test_a_quarter_looks_like_all(data) -> None:
    """Oracle: the undecimated capture's picture through two reference cameras; a random quarter is
    at least 5 dB worse (benchmarks.decimation: 6.8 and more on the larger captures)."""
    cloud = formats.read(data / "splats" / "playbot_lod4.sog").cloud
    renderer = Renderer(open_device())
    count = len(cloud) // 4
    some, any_ = decimate(cloud, count), at_random(cloud, count)
    for view in views("playbot_lod2.sog"):
        whole = picture(renderer, cloud, view)
        ours, chance = (psnr(picture(renderer, each, view), whole) for each in (some, any_))
        assert ours >= 26 and ours >= chance + 5, (ours, chance)


def test_thin_splats_are_merged_as_classic_pictures_show_them(data) -> None:
    """Oracle: the undecimated capture's picture through two reference cameras; merged without the
    low-pass, which makes up most of what pictures show of thin splats, they are 1.5 dB worse."""
    cloud = thinner(formats.read(data / "splats" / "playbot_lod2.sog").cloud)
    renderer = Renderer(open_device())
    count = len(cloud) // 4
    some, plain = decimate(cloud, count, pixel=framing_pixel(cloud)), decimate(cloud, count)
    for view in views("playbot_lod2.sog"):
        whole = picture(renderer, cloud, view)
        ours, without = (psnr(picture(renderer, each, view), whole) for each in (some, plain))
        assert ours >= without + 1.5, (ours, without)


@pytest.mark.parametrize("distance", [4, 8])
def test_levels_look_from_afar_like_the_mean_of_what_is_seen_close(data, distance) -> None:
    """Oracle: the mean of the classic picture at so many times the resolution, of which a level
    with a quarter of the splats is at least 3 dB nearer than the whole capture and a plain quarter,
    and 26 dB near (benchmarks.minification has larger captures)."""
    cloud = formats.read(data / "splats" / "playbot_lod3.sog").cloud
    where, renderer, count = (
        minification.Framing.of(cloud),
        Renderer(open_device()),
        len(cloud) // 4,
    )

    def noise(some, mode, scale):
        drawn = minification.pictures(renderer, some, where, distance, mode, scale)
        return min(map(minification.psnr, drawn, truth))

    truth = minification.pictures(renderer, cloud, where, distance, "classic", distance)
    plain = decimate(cloud, count)
    coarse = level(cloud, count, pixel=framing_pixel(cloud, FAR_LINES))
    peers = [noise(each, mode, 1) for each in (cloud, plain) for mode in ("classic", "antialiased")]
    ours = noise(coarse, "antialiased", 4)
    assert ours >= max(peers) + 3 and ours >= 26, (ours, peers)
