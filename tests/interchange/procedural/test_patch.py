"""Tests of splats on surfaces and along curves."""

from __future__ import annotations

import math

import numpy as np
import pytest

from usdsplat.interchange.procedural.materials import EARTH
from usdsplat.interchange.procedural.patch import mix, noise, strands, sweep, turned

ARC = np.linspace(-math.pi / 2, math.pi / 2, 200)
SPHERE = np.stack([np.cos(ARC), np.sin(ARC)], axis=1)


@pytest.mark.parametrize("spacing", [0.05, 0.1])
def test_a_sphere_is_covered_evenly_with_its_own_normals(spacing: float) -> None:
    """Oracle: normals are positions, 4 pi / spacing^2 points, steps of one spacing each way."""
    found = sweep(turned(SPHERE), spacing)
    assert len(found.s) == pytest.approx(4 * math.pi / spacing**2, rel=0.05)
    np.testing.assert_allclose(np.linalg.norm(found.positions, axis=1), 1, atol=1e-3)
    aligned = np.einsum("ni,ni->n", found.axes[:, :, 2], found.positions)
    assert np.quantile(aligned, 0.02) > 0.99
    middle = np.abs(found.positions[:, 1]) < 0.7
    np.testing.assert_allclose(found.sigmas[middle, :2], 0.70 * spacing, rtol=0.1)
    assert (found.sigmas[:, 2] < 0.2 * found.sigmas[:, :2].min(axis=1)).all()


def test_frames_are_rotations() -> None:
    """Oracle: orthonormal columns, determinant +1."""
    axes = sweep(turned(SPHERE), 0.2).axes
    np.testing.assert_allclose(
        axes.transpose(0, 2, 1) @ axes, np.tile(np.eye(3), (len(axes), 1, 1)), atol=1e-9
    )
    np.testing.assert_allclose(np.linalg.det(axes), 1, atol=1e-9)


def test_spacing_may_vary_along_the_surface() -> None:
    """Oracle: a cylinder, twice as fine at its top: four times as dense there."""
    cylinder = turned(np.array([(1.0, 0.0), (1.0, 4.0)]))
    found = sweep(cylinder, lambda s: np.where(s < 0.5, 0.1, 0.05))
    top = (found.positions[:, 1] > 2).sum()
    assert top / (len(found.s) - top) == pytest.approx(4, rel=0.05)


def test_a_lathe_ripples_its_radius_and_lifts_its_base() -> None:
    """Oracle: r = 1 + 0.1 cos 2a at height 5."""
    surface = turned(
        np.array([(1.0, 0.0), (1.0, 1.0)]), lambda r, y, a: r + 0.1 * np.cos(2 * a), base=5
    )
    p = surface(np.zeros(2), np.array([0.0, 0.25]))
    np.testing.assert_allclose(p, [[1.1, 5, 0], [0, 5, -0.9]], atol=1e-12)


def test_strands_lie_along_their_links() -> None:
    """Oracle: a polyline with corners: middles, directions and lengths by hand."""
    curve = np.array([[[0, 0, 0], [2, 0, 0], [2, 0, 1.0]]])
    patch = strands(curve, 0.1, (1, 0, 0), EARTH, lay=0.5)
    np.testing.assert_allclose(patch.positions, [[1, 0, 0], [2, 0, 0.5]])
    np.testing.assert_allclose(patch.axes[:, :, 0], [[1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(patch.sigmas, [[1, 0.05, 0.05], [0.5, 0.05, 0.05]])
    np.testing.assert_allclose(np.linalg.det(patch.axes), 1)
    assert patch.is_strand and patch.albedo.tolist() == [[1, 0, 0]] * 2


def test_patches_move_and_thin_out_with_everything_on_them() -> None:
    """Oracle: a quarter turn about y: x goes to -z, and normals with it."""
    film = np.arange(4.0)
    found = sweep(turned(np.array([(1.0, 0.0), (1.0, 1.0)])), 2.0)
    patch = found.paint(
        np.random.default_rng(1).random((len(found.s), 3)),
        EARTH,
        film=np.arange(float(len(found.s))),
    )
    quarter = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0.0]])
    moved = patch.moved(quarter, (0, 3, 0))
    np.testing.assert_allclose(moved.positions[:, 2], -patch.positions[:, 0])
    np.testing.assert_allclose(moved.positions[:, 1], patch.positions[:, 1] + 3)
    np.testing.assert_allclose(moved.normals[:, 2], -patch.normals[:, 0])
    chosen = patch.where(np.arange(len(patch)) < len(film))
    np.testing.assert_array_equal(chosen.film, film)
    np.testing.assert_array_equal(chosen.albedo, patch.albedo[:4])


def test_noise_is_smooth_centred_and_seeded() -> None:
    """Oracle: statistics of many points, and the difference over a thousandth of its scale."""
    points = np.random.default_rng(0).uniform(-5, 5, (4000, 3))
    values = noise(points, scale=0.5, seed=1)
    assert abs(values.mean()) < 0.05 and 0.3 < values.std() < 1
    assert np.abs(noise(points + 0.0005, scale=0.5, seed=1) - values).max() < 0.1
    assert not np.allclose(noise(points, scale=0.5, seed=2), values)


def test_mixing_is_linear_and_clamped() -> None:
    """Oracle: by hand."""
    found = mix((0, 0, 0), (1, 2, 4), np.array([-1, 0.5, 9]))
    np.testing.assert_allclose(found, [[0, 0, 0], [0.5, 1, 2], [1, 2, 4]])
