"""Tests of depth of field. Oracle: pinholes in another pattern over the lens."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.render.rendering import lens, random_cloud, scene_of, settings_of, view_of
from usdsplat.kernels.devices import open_device
from usdsplat.render.renderer import Renderer
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import View

RADIUS, FOCUS = 0.5, 4.0
SIDE = 64
"""The lens is a square of 64 x 64 points, of which those on the disc are equal in area."""


def disc() -> np.ndarray:
    """Points on the unit disc by Shirley and Chiu's concentric map of a grid, shape (4096, 2)."""
    at = (np.arange(SIDE) + 0.5) / SIDE * 2.0 - 1.0
    x, y = (plane.ravel() for plane in np.meshgrid(at, at))
    wide = np.abs(x) > np.abs(y)
    radius = np.where(wide, x, y)
    ratio = np.where(wide, y, x) / radius
    angle = np.pi / 4 * np.where(wide, ratio, 2.0 - ratio)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def through_pinhole(view: View, x: float, y: float) -> View:
    """A pinhole beside the middle of the lens whose window is sheared to meet the focus plane."""
    camera = view.camera
    shift = np.eye(4)
    shift[:2, 3] = -x, -y
    left, bottom, right, top = camera.window
    return replace(
        view,
        camera=replace(
            camera,
            world_to_camera=tuple((shift @ np.reshape(camera.world_to_camera, (4, 4))).ravel()),
            window=(left - x / FOCUS, bottom - y / FOCUS, right - x / FOCUS, top - y / FOCUS),
        ),
    )


def color(renderer: Renderer, scene: RenderScene, view: View, samples: int = 1) -> np.ndarray:
    """The picture of one band."""
    settings = settings_of(samples=samples, pixel_filter="box", filter_width=1e-6)
    (band,) = renderer.render(scene, view, settings, ("color",))
    return band.arrays["color"].astype(np.float64)


def test_64_samples_of_a_lens_are_its_integral() -> None:
    """Oracle: the mean of 4,096 pinhole pictures at the points of the concentric map, 40 dB."""
    eye = replace(lens(), size=(40, 32), focal=(40.0, 40.0), center=(20.0, 16.0))
    scene = scene_of((random_cloud(6, n=60, degree=0), np.eye(4)))
    view = view_of(eye)
    renderer = Renderer(open_device())
    total = np.zeros((32, 40, 4))
    for x, y in RADIUS * disc():
        total += color(renderer, scene, through_pinhole(view, x, y))
    expected = total / SIDE**2
    open_lens = replace(view.camera, lens_radius=RADIUS, focus_distance=FOCUS)
    found = color(renderer, scene, replace(view, camera=open_lens), samples=64)
    decibels = -10 * np.log10(np.mean((found - expected) ** 2))
    print(f"64 samples against 4,096 pinholes: {decibels:.1f} dB")
    assert decibels > 40
    sharp = color(renderer, scene, view)
    assert -10 * np.log10(np.mean((sharp - expected) ** 2)) < 35
