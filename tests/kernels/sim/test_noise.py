"""Tests of gradient noise and curl noise."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from usdsplat.kernels.sim.noise import change, curl_noise, gradient_noise


@njit
def sample(points, seed, out):
    """Value and gradient at each point, in the precision of `points`."""
    for i in range(len(points)):
        value, x, y, z = gradient_noise(points[i, 0], points[i, 1], points[i, 2], seed)
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = value, x, y, z


@njit
def sample_whirls(points, time, seed, out):
    """The whirls of `change` at a time, or one where time is NaN."""
    first, part, second, other = change(0.0 if time != time else time, seed)
    for i in range(len(points)):
        a, b, c = curl_noise(points[i, 0], points[i, 1], points[i, 2], first)
        x, y, z = curl_noise(points[i, 0], points[i, 1], points[i, 2], second)
        out[i, 0], out[i, 1], out[i, 2] = (
            part * a + other * x,
            part * b + other * y,
            part * c + other * z,
        )


def noise(points, seed=3):
    """(value, gradient)."""
    out = np.empty((len(points), 4), np.float32)
    sample(np.asarray(points, np.float32), seed, out)
    return out[:, 0], out[:, 1:]


def whirls(points, time=np.nan, seed=3):
    """Vectors, shape (n, 3); of `seed` itself where time is NaN."""
    out = np.empty((len(points), 3), np.float32)
    sample_whirls(np.asarray(points, np.float32), time, seed, out)
    return out


EDGES = [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]
EDGES = np.array([edge for edge in EDGES if np.abs(edge).sum() == 2], np.float32)


def test_corners_are_zero_and_slope_along_the_twelve_edges() -> None:
    """Oracle: the definition; each of the twelve directions is one twelfth of them."""
    grid = np.stack(np.meshgrid(*[np.arange(-12, 13)] * 3), -1).reshape(-1, 3)
    value, slope = noise(grid)
    assert np.all(value == 0)
    hits = (slope[:, None] == EDGES).all(-1)
    assert hits.any(1).all()
    share = hits.mean(0)
    assert np.abs(share - 1 / 12).max() < 4 * np.sqrt(1 / 12 / len(grid)) + 1 / 128 / 3


def test_it_is_the_mixture_of_its_corners() -> None:
    """Oracle: Perlin's definition in float64, with the directions that the corners show."""
    points = np.random.default_rng(0).uniform(-50, 50, (400, 3)).astype(np.float32)
    cell = np.floor(points)
    t = (points - cell).astype(float)
    expected = np.zeros(len(points))
    for corner in np.ndindex(2, 2, 2):
        _, edge = noise(cell + corner)
        fade = t**3 * (t * (t * 6 - 15) + 10)
        weight = np.where(corner, fade, 1 - fade).prod(-1)
        expected += weight * (edge * (t - corner)).sum(-1)
    value, _ = noise(points)
    assert np.abs(value - expected).max() < 2e-6
    assert np.abs(value).max() <= 1


@pytest.mark.parametrize("around", [0.0, 1e4])
def test_gradient_is_the_values_slope(around) -> None:
    """Oracle: central differences over steps that float32 holds exactly; a quintic's third
    derivative bounds their error."""
    rng = np.random.default_rng(1)
    points = (around + rng.integers(0, 4 * 256, (500, 3)) / 256).astype(np.float32)
    step = np.float32(1 / 256)
    _, slope = noise(points)
    for axis in range(3):
        off = np.zeros(3, np.float32)
        off[axis] = step
        high, low = noise(points + off)[0], noise(points - off)[0]
        measured = (high.astype(float) - low) / (2 * float(step))
        assert np.abs(measured - slope[:, axis]).max() < 60 * float(step) ** 2 + 1e-4


def test_slope_goes_on_across_the_faces_of_cells() -> None:
    """Oracle: continuity, of the value and of each derivative, at faces between cells."""
    rng = np.random.default_rng(2)
    at = rng.uniform(-5, 5, (1000, 3)).astype(np.float32)
    at[:, 0] = np.round(at[:, 0])
    value, slope = noise(at)
    below = at.copy()
    below[:, 0] = np.nextafter(at[:, 0], np.float32(-np.inf))
    before, slope_before = noise(below)
    assert np.abs(value - before).max() < 5e-6
    assert np.abs(slope - slope_before).max() < 1e-5


def test_whirls_have_no_divergence_and_length_one() -> None:
    """Oracle: central differences of the vectors sum to 0 where each does not; mean square 1."""
    rng = np.random.default_rng(3)
    points = (rng.integers(-8 * 256, 8 * 256, (4000, 3)) / 256).astype(np.float32)
    step = 1 / 256
    for time in (np.nan, 2.3):
        parts = []
        for axis in range(3):
            off = np.zeros(3)
            off[axis] = step
            high, low = whirls(points + off, time), whirls(points - off, time)
            parts.append((high[:, axis].astype(float) - low[:, axis]) / (2 * step))
        assert np.abs(np.sum(parts, 0)).max() < 0.02  # O(step²) where a cell's face is between
        assert np.abs(np.median(np.abs(np.sum(parts, 0)))) < 1e-3
        assert np.sqrt(np.mean(np.square(parts))) > 0.5
    length = [
        np.mean(np.square(whirls(rng.uniform(-500, 500, (60_000, 3)), time, seed)).sum(-1))
        for seed, time in enumerate((np.nan, 0.0, 0.5, 7.75))
    ]
    assert np.abs(np.sqrt(length) - 1).max() < 0.02


def test_seeds_are_independent_and_turbulence_meets_itself() -> None:
    """Oracle: no correlation between seeds; limits from both sides of a whole time."""
    points = np.random.default_rng(4).uniform(-300, 300, (20_000, 3))
    assert abs(np.corrcoef(noise(points, 1)[0], noise(points, 2)[0])[0, 1]) < 0.03
    assert abs(np.corrcoef(whirls(points, 1.0)[:, 0], whirls(points, 2.0)[:, 0])[0, 1]) < 0.03
    assert np.abs(whirls(points, 1.0) - whirls(points, 1 - 1e-6)).max() < 1e-5
    assert np.array_equal(whirls(points, 0.0), whirls(points))
