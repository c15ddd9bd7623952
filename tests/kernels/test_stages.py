"""Tests of sorting, binning, blending and the median, each with an independent oracle."""

from __future__ import annotations

import numpy as np
import pytest

from tests.devices import device_of
from usdsplat.kernels import bins, blend, median, project, ray_hit, sort
from usdsplat.kernels.device import CpuDevice, cores

rng = np.random.default_rng(11)


@pytest.fixture(autouse=True)
def same_numbers():
    """The same for each test, whichever came before."""
    global rng
    rng = np.random.default_rng(11)


@pytest.fixture(params=["one thread", "two threads", "cuda"])
def device(request):
    """One thread and two: the results may not differ; and a GPU."""
    if request.param == "cuda":
        return device_of("cuda")
    return CpuDevice(threads=min(1 + (request.param == "two threads"), cores()))


def records_of(centers, covariances, opacities, colors, depths):
    """Projected splats, computed in float64 by NumPy alone."""
    inverse = np.linalg.inv(covariances)
    reach = 2 * np.log(255 * np.asarray(opacities, np.float64))
    out = np.zeros((len(centers), project.RECORD), np.float32)
    out[:, :2] = centers
    out[:, project.A] = -0.5 * inverse[:, 0, 0]
    out[:, project.B] = -inverse[:, 0, 1]
    out[:, project.C] = -0.5 * inverse[:, 1, 1]
    out[:, project.LOG_OPACITY] = np.log(opacities)
    out[:, project.HALF_WIDTH] = np.sqrt(reach * covariances[:, 0, 0])
    out[:, project.HALF_HEIGHT] = np.sqrt(reach * covariances[:, 1, 1])
    out[:, project.RED : project.BLUE + 1] = colors
    out[:, project.DEPTH] = depths
    return out


def some_records(n, size, *, needles=False):
    """Random ellipses, long thin ones among them."""
    axes = 10 ** rng.uniform(-0.3, 2.5 if needles else 1.0, (n, 2))
    if needles:
        axes[:, 1] = 0.55
    angle = rng.uniform(0, np.pi, n)
    turn = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], 1).reshape(
        n, 2, 2
    )
    covariances = turn @ (axes[:, :, None] ** 2 * np.eye(2)) @ turn.transpose(0, 2, 1)
    return records_of(
        rng.uniform(-20, size + 20, (n, 2)), covariances, rng.uniform(0.005, 1, n),
        rng.uniform(0, 1, (n, 3)), np.sort(rng.uniform(1, 9, n)),
    )  # fmt: skip


ROUNDING = 2 * 2.0**-24
"""Of each term of an exponent: difference, products and coefficient err by half an ulp each, and
not all of them the same way."""
NOTHING_BEHIND = (np.empty((0, ray_hit.RAY_HIT), np.float32), np.empty((0, 0), np.float32))
"""Ray hits and depths of surfaces where there are no surfaces."""


def lists_of(device, records, window, chunks=3):
    """Tile lists of a window: (grid, starts, lists)."""
    grid = bins.grid_of(*window)
    starts, lists, pairs = device.run(
        bins.tile_lists, records, grid, bins.tiles_in(grid), chunks,
        lambda _, shape, dtype: device.resident(shape, dtype),
    )  # fmt: skip
    assert pairs == lists.shape[0]
    return grid, device.fetch(starts), device.fetch(lists)


def alphas(records, xs, ys):
    """Contribution of each splat at each pixel, float64, shape (n, h, w)."""
    r = records.astype(np.float64)
    dx = xs[None, None, :] - r[:, 0, None, None]
    dy = ys[None, :, None] - r[:, 1, None, None]
    a, b, c, log_opacity = (r[:, k, None, None] for k in (project.A, project.B, project.C, 5))
    alpha = np.exp(a * dx * dx + b * dx * dy + c * dy * dy + log_opacity)
    return np.where(alpha < 1 / 255, 0.0, np.minimum(alpha, 0.999))


def exponents(records, xs, ys):
    """Sum of the terms of each exponent, each without its sign, float64, shape (n, h, w)."""
    r = np.abs(records.astype(np.float64))
    dx = xs[None, None, :] - records[:, 0, None, None].astype(np.float64)
    dy = ys[None, :, None] - records[:, 1, None, None].astype(np.float64)
    a, b, c = (r[:, k, None, None] for k in (project.A, project.B, project.C))
    return a * dx * dx + b * np.abs(dx * dy) + c * dy * dy


def blend_all(device, records, window):
    grid, starts, lists = lists_of(device, records, window)
    x0, y0, x1, y1 = window
    image = np.full((y1 - y0, x1 - x0, 4), np.nan, np.float32)
    device.run(
        blend.blend,
        records,
        records,
        project.RED,
        starts,
        lists,
        grid,
        *NOTHING_BEHIND,
        False,
        image.reshape(len(image), -1),
        np.zeros(len(starts) - 1, np.int64),
    )
    ranks = np.zeros(image.shape[:2], np.int32)
    device.run(
        median.median, records, starts, lists, grid, *NOTHING_BEHIND, False, image,
        np.empty((0, 0), np.uint8), np.float32(0.5), ranks,
    )  # fmt: skip
    return image, ranks


def test_sort_is_numpys_stable_argsort(device):
    """Oracle: np.argsort(kind="stable"), with many equal keys, both signs and both zeros."""
    n = 5000
    keys = np.float32(rng.integers(-100, 100, n)) * np.float32(0.37)
    keys[::7] = -0.0
    visible = np.flatnonzero(rng.random(n) < 0.7).astype(np.int32)
    count = len(visible)
    work = (np.zeros((2, count), np.uint32), np.zeros((2, count), np.int32))
    half = device.run(
        sort.depth_order, visible, count, keys, 7, work, np.zeros((7, sort.DIGITS), np.int64)
    )
    expected = visible[np.argsort(keys[visible], kind="stable")]
    np.testing.assert_array_equal(work[1][half], expected)


def test_visible_slots_skips_the_unused_ends_of_blocks(device):
    """Oracle: written down by hand."""
    visible = np.zeros(8, np.int32)
    found, starts = np.int32([2, 0, 1]), np.int64([0, 4, 8])
    assert device.run(sort.visible_slots, found, starts, 3, visible) == 3
    assert visible[:3].tolist() == [0, 1, 8]


@pytest.mark.parametrize("window", [(0, 0, 100, 70), (-21, -5, 43, 38), (37, 18, 90, 64)])
@pytest.mark.parametrize("needles", [False, True])
def test_tile_lists_hold_every_splat_that_counts_and_few_others(device, window, needles):
    """Oracle: the contribution evaluated at every pixel of every tile in float64."""
    records = some_records(400, 100, needles=needles)
    grid, starts, lists = lists_of(device, records, window)
    x0, y0, x1, y1 = window
    touched = alphas(records, np.arange(x0, x1), np.arange(y0, y1)) > 0
    needed = 0
    columns = int(grid["columns"][0])
    for tile in range(len(starts) - 1):
        top = int(grid["top"][0]) + tile // columns * bins.TILE - y0
        left = int(grid["left"][0]) + tile % columns * bins.TILE - x0
        box = touched[:, max(0, top) : top + bins.TILE, max(0, left) : left + bins.TILE]
        expected = np.flatnonzero(box.any(axis=(1, 2)))
        have = lists[starts[tile] : starts[tile + 1]]
        assert np.all(np.diff(have) > 0), "in depth order, once each"
        assert set(expected) <= set(have)
        needed += len(expected)
    assert len(lists) <= 1.15 * needed + 20


@pytest.mark.parametrize("window", [(0, 0, 100, 70), (-21, -5, 43, 38)])
@pytest.mark.parametrize("needles", [False, True])
def test_blending_is_front_to_back_over_the_rules(device, window, needles):
    """Oracle: the specification's sum in float64 NumPy, over all splats and pixels."""
    records = some_records(300, 100, needles=needles)
    image, ranks = blend_all(device, records, window)
    x0, y0, x1, y1 = window
    xs, ys = np.arange(x0, x1), np.arange(y0, y1)
    left = np.ones((y1 - y0, x1 - x0))
    ended = np.zeros(left.shape, bool)
    color = np.zeros((*left.shape, 3))
    rounding = np.zeros(left.shape)
    history = []
    for alpha, terms, record in zip(
        alphas(records, xs, ys), exponents(records, xs, ys), records, strict=True
    ):
        ended |= left * (1 - alpha) < 1e-4
        alpha = np.where(ended, 0.0, alpha)
        color += (left * alpha)[..., None] * record[project.RED : project.BLUE + 1]
        rounding += left * alpha * terms
        left = left * (1 - alpha)
        history.append(left)
    error = np.abs(image - np.concatenate([color, 1 - left[..., None]], axis=2)).max(axis=2)
    # a needle's exponent is a small difference of three large terms, each rounded a few times
    assert np.mean(error > 2e-5 + ROUNDING * rounding) < 0.01
    assert error.max() < 0.02, "a contribution that float32 put on the other side of 1/255"
    passed = np.stack(history) <= 1 - 0.5 * (1 - left)
    expected = np.where(left < 1, passed.argmax(axis=0), -1)
    assert np.mean(ranks != expected) < 0.01


def test_no_tile_has_a_cap(device):
    """Oracle: closed form: 20,000 equal splats over one tile leave (1 - a)^20000, and cover."""
    n, opacity = 20_000, 0.0045
    records = records_of(
        np.full((n, 2), 8.0), np.tile(1e8 * np.eye(2), (n, 1, 1)), np.full(n, opacity),
        np.ones((n, 3)), np.arange(n) + 1.0,
    )  # fmt: skip
    records[:1000, project.RED : project.BLUE + 1] = 0
    image, _ = blend_all(device, records, (0, 0, 16, 16))
    seen = int(np.ceil(np.log(1e-4) / np.log(1 - opacity))) - 1
    np.testing.assert_allclose(image[..., 3], 1 - (1 - opacity) ** seen, atol=2e-5)
    np.testing.assert_allclose(
        image[..., 0], (1 - opacity) ** 1000 - (1 - opacity) ** seen, atol=2e-5
    )


def test_a_pixel_ends_before_the_splat_that_would_close_it(device):
    """Oracle: closed form: after 0.999 another 0.999 would leave 1e-6, so it is not taken."""
    records = records_of(
        np.full((3, 2), 8.0), np.tile(1e9 * np.eye(2), (3, 1, 1)), np.ones(3), np.eye(3), [1, 2, 3]
    )
    image, ranks = blend_all(device, records, (0, 0, 16, 16))
    np.testing.assert_allclose(image[8, 8], [0.999, 0, 0, 0.999], rtol=1e-6)
    assert np.all(ranks == 0)


def test_exponential_is_good_to_two_millionths():
    """Oracle: np.exp in float64, over all contributions that count."""
    z = np.linspace(blend.LEAST, 0, 10_001, dtype=np.float32)
    ours = np.array([blend.exponential(v) for v in z])
    np.testing.assert_allclose(ours, np.exp(8 * z.astype(np.float64)), rtol=2.5e-6)


def test_nothing_makes_an_empty_picture(device):
    """Oracle: a picture of nothing is transparent black, and no pixel has a median."""
    image, ranks = blend_all(device, np.zeros((0, project.RECORD), np.float32), (3, 5, 40, 30))
    assert not image.any()
    assert np.all(ranks == -1)
