"""Tests of the transmittance of splats to a light."""

from __future__ import annotations

import numpy as np
import pytest

from tests.render.lights.light_scenes import (
    UP,
    add_splats,
    cloud_of,
    covariances,
    light_at,
    transmittance,
)
from tests.render.rendering import random_cloud, random_transform
from usdsplat.render.lights import cameras
from usdsplat.render.lights.specs import LightSpec, Shadow
from usdsplat.render.scene import RenderScene

SUN = LightSpec(direction=(0.0, 0.0, -1.0), irradiance=(1.0, 1.0, 1.0))


def sun_along(direction):
    direction = np.asarray(direction, np.float64)
    unit = direction / np.linalg.norm(direction)
    return LightSpec(direction=tuple(unit.tolist()), irradiance=(1.0, 1.0, 1.0))


def seen(found):
    """The visible part of the light, of receivers that it reaches."""
    return found[:, 0] / found[:, 3]


@pytest.mark.parametrize("direction", [(0, 0, -1), (0.3, -0.8, 0.4)])
def test_transmittance_along_rays_is_that_of_float64_rays(direction):
    """Oracle: the maximum of each Gaussian along 10,000 rays in NumPy; the contract's 2e-3."""
    cloud = random_cloud(5, n=300, degree=0)
    scene = add_splats(RenderScene(), "/cloud", cloud)
    light = sun_along(direction)
    towards = -np.array(light.direction)
    points = np.random.default_rng(1).uniform(-2, 2, (10_000, 3)) - 1.5 * towards
    found = seen(light_at(scene, light, points, towards))
    expected = transmittance(cloud, points, np.broadcast_to(towards, points.shape))
    np.testing.assert_allclose(found, expected, atol=2e-3)
    assert np.quantile(expected, 0.3) < 0.9


@pytest.mark.parametrize("place", [(0.05, 0.02, -0.03), (0.0, 9.0, 1.0)])
def test_transmittance_of_a_point_light_is_that_of_float64_rays(place):
    """Oracle: the same, for small splats, whose footprints are nearly affine maps; through six
    faces of a light in the middle, and one camera from outside."""
    rng = np.random.default_rng(2)
    far = rng.normal(size=(600, 3))
    far = far[np.linalg.norm(far, axis=1) > 0.8]
    made = random_cloud(6, n=len(far), degree=0)
    cloud = cloud_of(1.5 * far, 0.3 * made.scales, 0.9, rotations=made.rotations)
    scene = add_splats(RenderScene(), "/cloud", cloud)
    matrix = np.eye(4)
    matrix[:3, 3] = place
    light = LightSpec(
        kind="sphere", to_world=tuple(matrix.ravel()), is_point=True, size=(0.01, 0.0),
        radiance=(1e6, 1e6, 1e6),
    )  # fmt: skip
    points = 3.0 * rng.normal(size=(4000, 3))
    towards = np.array(place) - points
    distance = np.linalg.norm(towards, axis=1)
    towards /= distance[:, None]
    found = seen(light_at(scene, light, points, towards))
    expected = transmittance(cloud, points, towards, distance)
    error = np.abs(found - expected)
    assert (expected < 0.5).sum() > 30
    assert np.quantile(error, 0.99) < 0.02 and error.mean() < 1e-3


def test_layers_multiply():
    """Oracle: the product of 1 - opacity of flat sheets in front."""
    heights, opacities = np.array([0.5, 1.0, 1.5, 2.0]), np.array([0.2, 0.5, 0.1, 0.7])
    places = np.stack([0 * heights, 0 * heights, heights], axis=1)
    cloud = cloud_of(places, (5.0, 5.0, 0.01), opacities)
    scene = add_splats(RenderScene(), "/sheets", cloud)
    depths = np.array([0.0, 0.75, 1.25, 1.75, 2.5])
    points = np.stack([0 * depths, 0 * depths, depths], axis=1)
    found = seen(light_at(scene, SUN, points, UP))
    in_front = heights[None] > depths[:, None]
    expected = np.where(in_front, 1 - opacities, 1).prod(axis=1)
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_a_caster_ramps_in_over_the_extents_of_both():
    """Oracle: clamp((gap - s) / 2 s) with s the sum of the standard deviations along the light."""
    own, other = 0.05, 0.1
    scene = add_splats(RenderScene(), "/one", cloud_of([[0, 0, 0]], (1.0, 1.0, other), 0.8))
    gaps = np.linspace(-0.2, 0.7, 40)
    points = np.stack([0 * gaps, 0 * gaps, -gaps], axis=1)
    shape = np.tile([0.3, 0, 0, 0.3, 0, own**2], (40, 1))
    found = seen(light_at(scene, SUN, points, UP, shapes=shape))
    ramp = np.clip((gaps - own - other) / (2 * (own + other)), 0, 1)
    np.testing.assert_allclose(found, 1 - 0.8 * ramp, atol=1e-4)


def test_a_turned_sheared_mirrored_field_casts_what_its_splats_in_the_world_cast():
    """Oracle: the covariances in the world, in NumPy."""
    cloud, matrix = random_cloud(8, n=60, degree=0), random_transform(4)
    scene = add_splats(RenderScene(), "/cloud", cloud, matrix)
    rng = np.random.default_rng(3)
    low, high = scene.bounds()
    points = rng.uniform(low, high, (3000, 3)) - [0, 0, 30.0]
    found = seen(light_at(scene, SUN, points, UP))
    world = matrix[:3, :3] @ covariances(cloud) @ matrix[:3, :3].T
    centers = cloud.positions @ matrix[:3, :3].T + matrix[:3, 3]
    offset = points[:, None, :2] - centers[None, :, :2]
    power = np.einsum("nki,kij,nkj->nk", offset, np.linalg.inv(world[:, :2, :2]), offset)
    alpha = cloud.opacities * np.exp(-0.5 * power)
    alpha = np.where(alpha < 1 / 255, 0, np.minimum(alpha, 0.999))
    np.testing.assert_allclose(found, np.prod(1 - alpha, axis=1), atol=2e-3)


def test_the_shadow_of_splats_does_not_depend_on_tiles_or_threads(monkeypatch):
    """Oracle: the other results; footprints are evaluated at receivers, not at pixels."""
    cloud = random_cloud(9, n=200, degree=0)
    scene = add_splats(RenderScene(), "/cloud", cloud)
    points = np.random.default_rng(4).uniform(-2, 2, (3000, 3)) - [0, 0, 3]
    fine, one = (light_at(scene, SUN, points, UP, threads=threads) for threads in (None, 1))
    monkeypatch.setattr(cameras, "SPLAT_PIXELS", 300)
    coarse = light_at(scene, SUN, points, UP)
    np.testing.assert_allclose(coarse, fine, atol=2e-3)
    np.testing.assert_array_equal(fine, one)


def test_shadows_end_at_their_distance_and_have_their_colour():
    """Oracle: UsdLuxShadowAPI's documentation: no shadow beyond the distance, a fade of length
    `falloff` before it, and its colour in the umbra."""
    shadow = Shadow(color=(0.1, 0.2, 0.3), distance=2.0, falloff=1.0, gamma=2.0)
    light = LightSpec(direction=(0.0, 0.0, -1.0), irradiance=(1.0,) * 3, shadow=shadow)
    scene = add_splats(RenderScene(), "/one", cloud_of([[0, 0, 0]], (1.0, 1.0, 1e-3), 0.999))
    gaps = np.array([0.5, 1.25, 1.5, 1.75, 2.5])
    points = np.stack([0 * gaps, 0 * gaps, -gaps], axis=1)
    found = light_at(scene, light, points, UP)
    left = np.where(gaps < 1, 1, np.clip(2 - gaps, 0, 1) ** 2)
    hidden = 0.999 * left[:, None]
    np.testing.assert_allclose(found[:, :3], 1 - hidden * (1 - np.array(shadow.color)), atol=2e-3)
    dark = LightSpec(direction=(0, 0, -1), irradiance=(1,) * 3, shadow=Shadow(enable=False))
    np.testing.assert_array_equal(light_at(scene, dark, points, UP), np.ones((5, 6)))
