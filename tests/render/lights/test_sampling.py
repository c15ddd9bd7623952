"""Tests of the samples of lights. Oracles: closed forms of irradiance, and UsdLux's formulas."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.render.lights.light_scenes import UP, light_at
from usdsplat.render.lights.sampling import area, samples_of
from usdsplat.render.lights.specs import LightSpec, Shaping
from usdsplat.render.scene import RenderScene

MANY = 256


def at(kind, size, place, *, turn=None, **options):
    """A light of radiance 1 that looks down, from a place."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.eye(3) if turn is None else turn
    matrix[:3, 3] = place
    return LightSpec(
        kind=kind, size=size, to_world=tuple(matrix.ravel()), radiance=(1.0, 1.0, 1.0), **options
    )


def lit(light, points, normals=UP, samples=MANY):
    """Irradiance divided by π."""
    points = np.atleast_2d(points)
    normals = np.broadcast_to(normals, points.shape)
    return light_at(RenderScene(), light, points, normals, samples=samples)[:, 3]


def polygon(corners, point, normal):
    """Irradiance / π of a polygon of radiance 1, Lambert's formula."""
    total = np.zeros(3)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        a, b = (a - point) / np.linalg.norm(a - point), (b - point) / np.linalg.norm(b - point)
        axis = np.cross(a, b)
        total += math.acos(np.clip(a @ b, -1, 1)) * axis / np.linalg.norm(axis)
    return abs(total @ normal) / (2 * math.pi)


@pytest.mark.parametrize("x", [0.0, 0.7, 2.0])
def test_a_rect_gives_lamberts_polygon_formula(x):
    """Oracle: Lambert 1760, the integral over a polygon; within 1 %."""
    width, height, z = 1.2, 0.7, 1.0
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [width / 2, height / 2]
    corners = np.concatenate([corners, np.full((4, 1), z)], axis=1)
    expected = polygon(corners, np.array([x, 0, 0]), UP)
    assert lit(at("rect", (width, height), (0, 0, z)), [x, 0, 0])[0] == pytest.approx(
        expected, rel=0.01
    )


@pytest.mark.parametrize("z", [0.6, 1.0, 3.0])
def test_a_disk_gives_the_form_factor_of_a_disk(z):
    """Oracle: E = π L r² / (r² + z²) on the axis."""
    found = lit(at("disk", (0.5, 0.0), (0, 0, z)), [0, 0, 0])[0]
    assert found == pytest.approx(0.25 / (0.25 + z * z), rel=0.01)


@pytest.mark.parametrize("tilt", [0.0, 0.5, 1.0])
def test_a_sphere_gives_its_closed_form_above_the_horizon(tilt):
    """Oracle: E = π L r² / d² cos θ."""
    place = 2.0 * np.array([math.sin(tilt), 0, math.cos(tilt)])
    found = lit(at("sphere", (0.3, 0.0), place), [0, 0, 0])[0]
    assert found == pytest.approx(0.09 / 4.0 * math.cos(tilt), rel=0.01)


def test_a_far_cylinder_gives_its_cross_section():
    """Oracle: E = L · 2 r l / d² at right angles to the axis, far away."""
    found = lit(at("cylinder", (0.1, 1.0), (0, 0, 50)), [0, 0, 0])[0]
    assert found == pytest.approx(0.2 / 2500 / math.pi, rel=0.01)


@pytest.mark.parametrize("angle", [0.5, 10.0, 60.0])
def test_a_distant_light_with_an_angle_keeps_its_irradiance(angle):
    """Oracle: the irradiance of the spec on a facing surface; on a tilted one, its cosine."""
    sun = LightSpec(irradiance=(2.0, 1.0, 0.5), angle=math.radians(angle))
    assert lit(sun, [0, 0, 0])[0] == pytest.approx(2.0, rel=1e-6)
    tilted = np.array([math.sin(0.5), 0, math.cos(0.5)])
    assert lit(sun, [0, 0, 0], tilted)[0] == pytest.approx(2 * math.cos(0.5), rel=2e-3)


def test_samples_of_a_distant_light_fill_its_cone():
    """Oracle: the angle; the mean of cos is that of equal solid angles."""
    sun = LightSpec(irradiance=(1.0, 1.0, 1.0), angle=math.radians(20))
    found = samples_of(sun, 1000)
    cosines = found["z"]
    low = math.cos(math.radians(10))
    assert cosines.min() == pytest.approx(low, abs=1e-4) and cosines.max() < 1
    assert cosines.mean() == pytest.approx((1 + low) / 2, abs=1e-6)
    assert len(samples_of(LightSpec(irradiance=(1.0, 1.0, 1.0)), 1000)) == 1


def test_the_back_of_a_flat_light_is_dark_and_a_point_shines_everywhere():
    """Oracle: UsdLux: rects and disks radiate along −z; a small sphere of power Φ gives
    L π r² / d²."""
    below, above = [0, 0, 0], [0, 0, 2.0]
    assert lit(at("rect", (1, 1), (0, 0, 1)), below)[0] > 0
    assert lit(at("rect", (1, 1), (0, 0, 1)), above, -UP)[0] == 0
    point = at("sphere", (0.1, 0.0), (0, 0, 1), is_point=True)
    assert lit(point, [below, above], [UP, -UP]) == pytest.approx([0.01, 0.01], rel=1e-5)


def test_a_point_without_a_size_has_the_intensity_of_a_normalized_small_sphere():
    """Oracle: a normalized sphere of radius 0.01, whose radiance is I / 4 π r²."""
    small = replace(at("sphere", (0.01, 0.0), (0, 0, 2)), radiance=(3 / (4 * math.pi * 1e-4),) * 3)
    point = replace(at("sphere", (0.0, 0.0), (0, 0, 2)), radiance=(3.0,) * 3)
    assert lit(point, [0, 0, 0])[0] == pytest.approx(lit(small, [0, 0, 0])[0], rel=0.01)


@pytest.mark.parametrize(
    ("kind", "size", "scales", "expected"),
    [
        ("rect", (2.0, 3.0), (2, 1, 5), 12.0),
        ("disk", (2.0, 0.0), (1, 3, 9), 12 * math.pi),
        ("sphere", (2.0, 0.0), (2, 2, 2), 64 * math.pi),
        ("cylinder", (0.5, 3.0), (2, 3, 3), 2 * math.pi * 1.5 * 6),
    ],
)
def test_areas_are_those_in_the_world(kind, size, scales, expected):
    """Oracle: school geometry."""
    assert area(kind, size, np.diag(scales).astype(float)) == pytest.approx(expected)


def test_shaping_follows_usdlux():
    """Oracle: UsdLux: times cos^focus; nothing beyond the cone, a smooth step within its soft
    part."""
    point = at("sphere", (0.1, 0.0), (0, 0, 0), is_point=True)
    angles = np.radians([0, 20, 35, 45])
    spots = np.stack([np.sin(angles), 0 * angles, -np.cos(angles)], axis=1)
    plain = lit(point, spots, -spots)
    focused = lit(replace(point, shaping=Shaping(focus=4.0)), spots, -spots)
    np.testing.assert_allclose(focused / plain, np.cos(angles) ** 4, rtol=1e-4)
    cone = Shaping(angle=math.radians(40), softness=0.5)
    found = lit(replace(point, shaping=cone), spots, -spots) / plain
    t = np.clip((angles - math.radians(20)) / math.radians(20), 0, 1)
    np.testing.assert_allclose(found, 1 - t * t * (3 - 2 * t), atol=1e-4)


def test_samples_are_turned_with_the_light():
    """Oracle: the same light and receiver, both turned."""
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    flat = at("rect", (1.0, 0.4), (0.3, 0.1, 1.0))
    turned = at("rect", (1.0, 0.4), turn @ [0.3, 0.1, 1.0], turn=turn)
    expected = lit(flat, [0.1, 0, 0])
    assert lit(turned, turn @ [0.1, 0, 0], turn @ UP) == pytest.approx(expected, rel=1e-5)


def test_the_lights_of_a_scene_are_found_once(monkeypatch):
    """Oracle: the number of times that the visible lights are gathered; the order of their
    paths."""
    scene, gathered = RenderScene(), []
    whole = RenderScene.named_lights.fget

    def counted(self):
        gathered.append(1)
        return whole(self)

    monkeypatch.setattr(RenderScene, "named_lights", property(counted))
    for path, angle in (("/b", 2.0), ("/a", 1.0), ("/c", 3.0)):
        scene.set_light(path, LightSpec(angle=angle))
    assert [light.angle for light in scene.lights] == [1.0, 2.0, 3.0]
    assert len(gathered) == 1
