"""Tests of the shadow of a solid capture, against that of a mesh of the same shape."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.render.lights.light_scenes import UP, add_splats, cloud_of, light_at
from tests.render.lights.test_domes import spread_normals
from tests.render.lights.test_shadows import SUN, crossing, quad
from tests.render.surface_scenes import add, mesh
from usdsplat.render.scene import RenderScene

HEIGHT = 2.0
"""Of the middle of the solid above the ground."""


def turns(normals):
    """Quaternions that turn z to normals: half way between both."""
    x, y, z = normals.T
    found = np.stack([1 + z, -y, x, 0 * z], axis=1)
    found[z < -0.999999] = [0, 1, 0, 0]
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def ball():
    """Discs on the unit sphere, and the sphere as triangles."""
    normals = spread_normals(8000)
    size = math.sqrt(4 * math.pi / len(normals))
    cloud = cloud_of(normals, (size, size, 0.05 * size), 0.95, rotations=turns(normals))
    u, v = np.meshgrid(np.linspace(0, 2 * math.pi, 97), np.linspace(0, math.pi, 49))
    points = np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], axis=2)
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    triangles = np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 3)
    return cloud, mesh(triangles)


def box():
    """Discs on the faces of a cube of edge 2, and the cube as triangles."""
    size = 2 / 80
    steps = (np.arange(80) + 0.5) * size - 1
    x, y = (each.ravel() for each in np.meshgrid(steps, steps))
    places, normals, corners = [], [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            face = np.roll(np.stack([x, y, np.full_like(x, side)], axis=1), axis + 1, axis=1)
            places.append(face)
            normals.append(np.broadcast_to(side * np.eye(3)[axis], face.shape))
            square = np.array([[-1, -1, side], [1, -1, side], [1, 1, side], [-1, 1, side]])
            square = np.roll(square, axis + 1, axis=1)
            corners.append(square[[0, 1, 2, 0, 2, 3]])
    flat = np.concatenate(normals)
    cloud = cloud_of(np.concatenate(places), (size, size, 0.05 * size), 0.95, rotations=turns(flat))
    return cloud, mesh(np.concatenate(corners))


@pytest.mark.parametrize("degrees", [10.0, 20.0])
@pytest.mark.parametrize("solid", [ball, box])
def test_a_solid_capture_casts_the_shadow_of_a_mesh_of_the_same_shape(solid, degrees):
    """Oracle: the mesh. Density in the umbra and mean over the ground, and the width of the
    penumbra from 10 to 90 %, within 5 %; splats are a fifth of it or less."""
    cloud, shape = solid()
    raised = np.eye(4)
    raised[2, 3] = HEIGHT
    x = np.linspace(0, 2.5, 401)
    points = np.stack([x, 0.07 + 0 * x, 0 * x], axis=1)
    light = replace(SUN, angle=math.radians(degrees))
    dark = []
    for scene in (
        add_splats(RenderScene(), "/solid", cloud, raised),
        add(RenderScene(), "/solid", shape, raised),
    ):
        add(scene, "/ground", quad(0.0, (-4, -4), (4, 4)))
        found = light_at(scene, light, points, UP, samples=64)
        dark.append(1 - found[:, 0] / found[:, 3])
    splats, surface = dark
    assert splats[:60].min() == pytest.approx(surface[:60].min(), rel=0.05)
    assert splats.mean() == pytest.approx(surface.mean(), rel=0.05)
    lit = [1 - each for each in dark]
    widths = [crossing(x, each, 0.9) - crossing(x, each, 0.1) for each in lit]
    assert widths[0] == pytest.approx(widths[1], rel=0.05)
