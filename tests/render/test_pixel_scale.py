"""Tests of coarse pictures, as a preview draws them while the view moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.render.rendering import picture, random_cloud, scene_of
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import UsageError
from usdsplat.render.specs import CameraSpec, Framing, View

FULL = (120, 96)


def view_at(scale: int, pixel_scale: float) -> View:
    """FULL divided by `scale`."""
    camera = CameraSpec(
        world_to_camera=(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, -6, 0, 0, 0, 1),
        window=(-0.5, -0.4, 0.5, 0.4),
        clipping_range=(0.1, 100.0),
    )
    width, height = FULL[0] // scale, FULL[1] // scale
    return View(camera=camera, framing=Framing(resolution=(width, height), pixel_scale=pixel_scale))


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0, 3.0])
def test_the_low_pass_filter_is_that_of_the_full_picture(scale):
    """Oracle: the closed form: a ball's variance on the screen is that of its own and 0.3 square
    pixels of the picture that this one stands for."""
    sigma, opacity, depth = 0.04, 0.8, 6.0
    cloud = SplatCloud(
        positions=np.array([[0.025, 0.025, 0.0]], np.float32),  # the middle of a pixel
        scales=np.full((1, 3), sigma, np.float32),
        rotations=np.array([[1, 0, 0, 0]], np.float32),
        opacities=np.full(1, opacity, np.float32),
        sh=np.zeros((1, 1, 3), np.float32),
    )
    scene = scene_of((cloud, np.eye(4)))
    alpha = picture(scene, view_at(1, scale), aovs=("color",))["color"][..., 3]
    focal = FULL[0]
    middle = FULL[0] // 2 + 0.025 * focal / depth - 0.5
    assert middle == pytest.approx(60.0)
    variance = (focal * sigma / depth) ** 2 + 0.3 / scale**2
    expected = opacity * np.exp(-0.5 * np.arange(3) ** 2 / variance)
    expected[expected < 1 / 255] = 0
    np.testing.assert_allclose(alpha[47, 60:63], expected, rtol=2e-3)


@pytest.mark.parametrize("scale", [2, 3])
def test_a_coarse_picture_that_knows_what_it_stands_for_looks_like_it(scale):
    """Oracle: the mean over blocks of the full picture's pixels."""
    scene = scene_of((random_cloud(3, n=2000), 0.8 * np.eye(4)))
    full = picture(scene, view_at(1, 1.0), aovs=("color",))["color"]
    height, width = FULL[1] // scale, FULL[0] // scale
    mean = full.reshape(height, scale, width, scale, 4).mean(axis=(1, 3))
    blind, knowing = (
        np.mean((picture(scene, view_at(scale, side), aovs=("color",))["color"] - mean) ** 2)
        for side in (1.0, scale)
    )
    assert knowing < 0.1 * blind  # 10 dB


@pytest.mark.parametrize("scale", [0.0, -1.0, np.inf, np.nan])
def test_a_pixel_without_a_size_is_refused(scale):
    """Oracle: the error's class and sentence."""
    view = view_at(1, 1.0)
    broken = replace(view, framing=replace(view.framing, pixel_scale=scale))
    with pytest.raises(UsageError, match=r"pixel scale: found .*, expected a positive number"):
        picture(scene_of((random_cloud(0), np.eye(4))), broken, aovs=("color",))
