"""Tests of shadows in a still light while the camera moves."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.render.lights.light_scenes import UP, add_splats, light_at
from tests.render.lights.test_shadows import SUN, WHITE, quad
from tests.render.lod.test_nodes import tree_scene
from tests.render.lod.trees import made
from tests.render.rendering import OPENCV, random_cloud, settings_of
from tests.render.surface_scenes import add
from usdsplat.kernels.devices import open_device
from usdsplat.render.renderer import Renderer
from usdsplat.render.scene import RenderScene
from usdsplat.render.screen import Screen
from usdsplat.render.specs import CameraSpec, Framing, InstanceSpec, View

SETTINGS = {"light_samples": 4, "shadow_resolution": 512}


def orbit(part, distance):
    """A camera that looks at the origin from an angle above the ground, at a part of the orbit."""
    angle = 2 * math.pi * part
    back = np.array([0.8 * math.cos(angle), 0.8 * math.sin(angle), 0.6])
    right = np.cross(UP, back) / 0.8
    matrix = np.eye(4)
    matrix[:3, :3] = [right, np.cross(back, right), back]
    matrix[2, 3] = -distance
    camera = CameraSpec(
        world_to_camera=tuple(matrix.ravel()), window=(-0.3, -0.2, 0.3, 0.2),
        clipping_range=(0.01, 100.0),
    )  # fmt: skip
    framing = Framing(resolution=(48, 32))
    return View(camera=camera, framing=framing, catchers=(("/ground", True),))


def seen_points(view, level):
    """Where the rays of all pixels meet the plane z = level, shape (n, 3), by hand."""
    screen = Screen.of(view)
    (width, height), (fx, fy), (cx, cy) = screen.size, screen.focal, screen.center
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    rays = np.stack([(x - cx) / fx, (y - cy) / fy, np.ones(x.shape)], axis=2)
    to_world = np.linalg.inv(OPENCV @ np.reshape(view.camera.world_to_camera, (4, 4)))
    rays, eye = rays @ to_world[:3, :3].T, to_world[:3, 3]
    return (eye + rays * ((level - eye[2]) / rays[..., 2:])).reshape(-1, 3)


@pytest.mark.parametrize("frames", [6, pytest.param(240, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", ["field", "tree"])
def test_shadows_at_points_of_the_world_do_not_change_in_an_orbit(kind, frames):
    """Oracle: one evaluation at the points of the ground that the pixels show, without a camera;
    1/255. The camera comes near and goes away, so that other levels of the tree are drawn."""
    cloud = replace(random_cloud(4, 300, 0), opacities=np.full(300, 0.9, np.float32))
    cloud = replace(cloud, scales=2 * cloud.scales)
    raised = np.eye(4)
    raised[2, 3] = 2.0
    still = add_splats(RenderScene(), "/splats", cloud, raised)
    scene = still
    if kind == "tree":
        place = InstanceSpec(path="/splats", transform=tuple(raised.ravel()))
        tree = made(4, n=300, degree=0, leaf=30)
        still = add_splats(RenderScene(), "/splats", tree.leaves(), raised)
        scene = tree_scene(tree, place)
    light = replace(SUN, angle=math.radians(4))
    for each in {id(one): one for one in (still, scene)}.values():
        add(each, "/ground", quad(0.0, (-9, -9), (9, 9), materials=WHITE))
        add(each, "/roof", quad(3.0, (-1, -1), (0, 0), materials=WHITE))
        each.set_light("/sun", light)
    renderer, darkest = Renderer(open_device()), 1.0
    for frame in range(frames):
        view = orbit(frame / frames, 6.0 + 3.0 * math.sin(4 * math.pi * frame / frames))
        bands = renderer.render(scene, view, settings_of(**SETTINGS), ("shadow",))
        found = np.concatenate([band.arrays["shadow"][..., 0].copy() for band in bands])
        points, above = seen_points(view, 0.0), seen_points(view, 3.0)
        sums = light_at(still, light, points, UP, samples=4, resolution=512)
        expected = (sums[:, 0] + 0.2 * sums[:, 3]) / (1.2 * sums[:, 3])
        is_open = (np.abs(above[:, :2] + 0.5) > 0.6).any(axis=1)  # not behind the roof
        assert is_open.sum() > 1000
        assert np.abs(found.ravel() - expected)[is_open].max() <= 1 / 255
        darkest = min(darkest, float(expected.min()))
    assert darkest < 0.4
