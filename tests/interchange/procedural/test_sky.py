"""Tests of sun and sky with occluders."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.interchange.procedural import sky

CENTRE, RADIUS = np.array([0.0, 0.35, 0.0]), 0.15


@pytest.fixture(scope="module")
def ball() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A ball over a floor: positions, normals and sizes of splats on both, floor first."""
    x, z = (g.ravel() for g in np.meshgrid(np.arange(-1, 1, 0.006), np.arange(-1, 1, 0.006)))
    floor = np.stack([x, np.zeros_like(x), z], axis=1)
    normals = np.concatenate([np.tile([0, 1.0, 0], (len(floor), 1)), sky.spread(12_000)])
    positions = np.concatenate([floor, CENTRE + RADIUS * sky.spread(12_000)])
    sizes = np.full(len(positions), 0.004)
    return positions.astype(np.float32), normals.astype(np.float32), sizes.astype(np.float32)


def test_the_ball_throws_its_shadow_where_geometry_says(ball) -> None:
    """Oracle: in shadow is whose ray to the sun passes the centre nearer than the radius."""
    positions, normals, sizes = ball
    share = sky.sun_share(positions, normals, sizes)
    toward = CENTRE - positions
    missed = np.linalg.norm(toward - (toward @ sky.SUN)[:, None] * sky.SUN, axis=1)
    floor = positions[:, 1] == 0
    assert (share[floor & (missed < RADIUS - 0.03)] == 0).all()
    assert (share[floor & (missed > RADIUS + 0.03)] == 1).all()
    facing = normals @ sky.SUN
    assert (share[~floor & (facing > 0.3)] > 0.99).all()
    assert (share[~floor & (facing < -0.5)] == 0).all()  # the edge is soft


def test_the_floor_under_the_ball_sees_less_sky(ball) -> None:
    """Oracle: form factor: a sphere over a point hides (R / h)^2 of its cosine-weighted sky."""
    positions, normals, sizes = ball
    light, openness = sky.sky_light(positions, normals, sizes, np.zeros(len(positions), bool))
    x, y, z = positions.T
    below = (y == 0) & (np.hypot(x, z) < 0.03)
    expected = 1 - (RADIUS / CENTRE[1]) ** 2
    assert openness[below].mean() == pytest.approx(expected, abs=0.12)
    far = (y == 0) & (np.hypot(x, z) > 0.9)
    assert openness[far].mean() > 0.93
    assert (light[below].mean(axis=0) < 0.95 * light[far].mean(axis=0)).all()


def test_surroundings_are_bright_at_the_horizon_blue_above_and_dark_below() -> None:
    """Oracle: the named colours at their directions."""
    found = sky.environment(np.array([[0, 1, 0], [1, 1e-9, 0], [0, -1, 0.0]]))
    np.testing.assert_allclose(found, [sky.ZENITH, sky.HORIZON, sky.GROUND], rtol=1e-3)


def test_spread_directions_are_even() -> None:
    """Oracle: second moments of a uniform sphere, 1/3 each, and no preferred side."""
    d = sky.spread(50)
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1)
    np.testing.assert_allclose(d.T @ d / 50, np.eye(3) / 3, atol=0.01)
    np.testing.assert_allclose(d.mean(axis=0), 0, atol=0.01)
