"""Tests of features that evaluate each pixel's ray. Oracle: the float64 reference."""

from __future__ import annotations

import numpy as np
import pytest

from tests.folded import folded
from tests.render.rendering import (
    lens,
    picture,
    random_cloud,
    random_transform,
    scene_of,
    view_of,
)
from usdsplat.core.cloud import SplatCloud
from usdsplat.kernels import reference, reference_rays

MODELS = ["perspective", "tangential", "orthographic"]


def difference(found: np.ndarray, expected: np.ndarray) -> float:
    """PSNR in dB, of values about 1."""
    return -10.0 * np.log10(np.mean((found - expected) ** 2))


@pytest.mark.parametrize("model", folded(MODELS))
def test_the_order_of_each_pixel_is_that_of_its_ray(model: str) -> None:
    """rayHitDistance sorts each pixel by itself, in sheared and mirrored fields too. Oracle: the
    float64 reference, which sorts all splats at all pixels."""
    eye = lens(model)
    parts = [(random_cloud(1), np.eye(4)), (random_cloud(2), random_transform(3))]
    mode = "tangential" if model == "tangential" else "perspective"
    scene = scene_of(*parts, projection_mode=mode)
    found = picture(scene, view_of(eye), sorting="rayHitDistance", aovs=("color", "depth"))
    seen = reference.footprints(parts, eye)
    rays = reference_rays.trace(seen, eye, sort_by_ray_hit=True)
    assert difference(found["color"], rays.color) > 60
    flat = reference.render(parts, eye)
    assert difference(found["color"], flat.color) < 50  # the order matters in this scene
    depth = reference_rays.median(rays, 0.5, rays.color[..., 3])
    close = np.isclose(found["depth"], depth, rtol=1e-4)
    assert close.mean() > 0.99


@pytest.mark.parametrize("count", [30, 120, 400])
def test_any_number_of_contributions_may_wait(count: int) -> None:
    """Needles along the rays, whose ray hits lie in any order: all of them wait for the last one.
    A GPU has windows of three sizes for that. Oracle: the float64 reference."""
    rng, eye = np.random.default_rng(5), lens()
    turns = np.concatenate([np.ones((count, 1)), rng.normal(0, 0.05, (count, 3))], axis=1)
    cloud = SplatCloud(
        positions=rng.normal(0, (0.02, 0.02, 0.3), (count, 3)).astype(np.float32),
        scales=np.full((count, 3), (0.04, 0.04, 0.7), np.float32),
        rotations=(turns / np.linalg.norm(turns, axis=1, keepdims=True)).astype(np.float32),
        opacities=np.full(count, 4 / (count + 20), np.float32),
        sh=rng.normal(0, 1, (count, 1, 3)).astype(np.float32),
    )
    parts = [(cloud, np.eye(4))]
    aovs = ("color", "depth", "depthFront")
    found = picture(scene_of(*parts), view_of(eye), sorting="rayHitDistance", aovs=aovs)
    rays = reference_rays.trace(reference.footprints(parts, eye), eye, sort_by_ray_hit=True)
    assert difference(found["color"], rays.color) > 80
    waiting = (rays.alpha > 0).sum(axis=0).max()
    assert waiting > 0.9 * count
    front = reference_rays.median(rays, 0.0, rays.color[..., 3])
    assert np.isclose(found["depthFront"], front, rtol=1e-4).mean() > 0.99
    middle = reference_rays.median(rays, 0.5, rays.color[..., 3])
    assert np.isclose(found["depth"], middle, rtol=1e-4).mean() > 0.99


@pytest.mark.parametrize("sorting", ["zDepth", "rayHitDistance"])
def test_first_and_expected_depth_are_those_of_the_contributions(sorting: str) -> None:
    """Zfront is the first contribution's depth, Zexp the mean by weight. Oracle: the float64
    reference."""
    eye, parts = lens(), [(random_cloud(1), np.eye(4))]
    aovs = ("color", "depthFront", "depthExpected")
    found = picture(scene_of(*parts), view_of(eye), aovs=aovs, sorting=sorting)
    seen = reference.footprints(parts, eye)
    rays = reference_rays.trace(seen, eye, sort_by_ray_hit=sorting == "rayHitDistance")
    whole = rays.color[..., 3]
    front = reference_rays.median(rays, 0.0, whole)
    assert np.isclose(found["depthFront"], front, rtol=1e-4).mean() > 0.995
    some = whole > 0.01
    expected = (rays.weight * rays.depth).sum(axis=0)[some] / whole[some]
    assert np.abs(found["depthExpected"][some] - expected).max() < 0.02
    assert np.isinf(found["depthExpected"][whole == 0]).all()
