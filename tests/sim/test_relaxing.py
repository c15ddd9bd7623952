"""Tests of redistribution."""

from __future__ import annotations

import numpy as np
import pytest

from tests.sim.clouds import sphere, unevenness
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.points.nearest import nearest
from usdsplat.sim.parameters import Parameters
from usdsplat.sim.relaxing import relax

N = 20_000


def onto_sphere(points):
    """The nearest points of the unit sphere, and its normals."""
    normals = (points / np.linalg.norm(points, axis=1)[:, None]).astype(np.float32)
    return normals, normals


def test_noise_on_a_sphere_becomes_even() -> None:
    """Oracle: closed form: nearest distances vary by .52 of their mean before, (4 / pi - 1)^(1/2);
    after 20 sweeps by at most .08. Radii hold the target and what the splat itself would count."""
    device = open_device()
    before = sphere(N)
    after, support = relax(device, before, None, Parameters(), 20, onto_sphere)
    assert unevenness(device, before) == pytest.approx((4 / np.pi - 1) ** 0.5, abs=0.02)
    assert unevenness(device, after) <= 0.08
    np.testing.assert_allclose(np.linalg.norm(after, axis=1), 1, atol=1e-6)
    spacing = np.sqrt(4 * np.pi / N)
    assert np.median(support) == pytest.approx(spacing * np.sqrt((16 + 4) / np.pi), rel=0.02)


def test_planes_of_neighbours_keep_splats_on_their_surface() -> None:
    """Oracle: closed form: the sphere they were on, to a hundredth of the spacing on average and a
    twentieth at worst; it does not shrink."""
    device = open_device()
    after, _ = relax(device, sphere(N), None, Parameters(), 20)
    assert unevenness(device, after) <= 0.08
    spacing = np.sqrt(4 * np.pi / N)
    height = np.linalg.norm(after.astype(np.float64), axis=1) - 1
    assert abs(height.mean()) <= 0.01 * spacing
    assert np.abs(height).max() <= 0.05 * spacing


def test_planes_of_neighbours_draw_splats_back() -> None:
    """Oracle: closed form: noise about a plane shrinks, by half at each sweep as far as it is not
    shared by neighbours."""
    random = np.random.default_rng(3)
    points = random.uniform(0, 1, (5000, 3)).astype(np.float32)
    points[:, 2] = random.normal(0, 0.002, 5000)
    after, _ = relax(open_device(), points, None, Parameters(), 10)
    inner = (np.abs(points[:, :2] - 0.5) < 0.4).all(axis=1)
    assert after[inner, 2].std() < points[inner, 2].std() / 3


def test_borders_of_open_surfaces_stay() -> None:
    """Oracle: closed form: the square that the noise was in, to one and a half spacings, with even
    distances up to its border."""
    device = open_device()
    points = np.random.default_rng(5).uniform(0, 1, (5000, 3)).astype(np.float32)
    points[:, 2] = 0
    after, _ = relax(device, points, None, Parameters(), 20)
    spacing = 5000**-0.5
    assert after[:, :2].min() > -1.5 * spacing
    assert after[:, :2].max() < 1 + 1.5 * spacing
    assert not after[:, 2].any()
    assert unevenness(device, after) < 0.12


def test_volumes_become_even_in_all_directions() -> None:
    """Oracle: statistics of white noise, whose nearest distances vary by .36 of their mean; the
    walls of the box stop those that are pushed out, and are left out."""
    device = open_device()
    points = np.random.default_rng(4).uniform(0, 1, (5000, 3)).astype(np.float32)
    after, _ = relax(
        device,
        points,
        None,
        Parameters(),
        20,
        lambda q: (q.clip(0, 1), np.zeros_like(q)),
        dimension=3,
    )
    inner = (np.abs(after - 0.5) < 0.35).all(axis=1)
    distance = nearest(device, after, after, 2)[1][inner, 1]
    assert unevenness(device, points) == pytest.approx(0.363, abs=0.03)
    assert distance.std() / distance.mean() < 0.12


def test_coincident_and_broken_points_do_no_harm() -> None:
    """Oracle: closed form: the former part, the latter stay, and the rest becomes even."""
    device = open_device()
    points = sphere(3000)
    points[10:14] = points[3]
    points[20] = np.nan
    after, _ = relax(device, points, None, Parameters(), 20)
    sound = np.delete(after, 20, axis=0)
    assert np.isnan(after[20]).all()
    assert np.isfinite(sound).all()
    assert unevenness(device, sound) < 0.12


@pytest.mark.parametrize("n", [0, 1, 2])
def test_few_points(n) -> None:
    """Oracle: closed form: each is there, a lone one where it was."""
    points = np.arange(3 * n, dtype=np.float32).reshape(n, 3)
    after, support = relax(open_device(), points, None, Parameters(), 2)
    assert np.isfinite(after).all()
    assert len(support) == n
    if n == 1:
        np.testing.assert_array_equal(after, points)


def test_one_thread_and_several_give_the_same() -> None:
    """Oracle: a single thread."""
    a, b = (relax(open_device(threads=t), sphere(3000), None, Parameters(), 3) for t in (1, None))
    np.testing.assert_array_equal(a[0], b[0])
    np.testing.assert_array_equal(a[1], b[1])
