"""Tests of the display modes: dots, ellipses and normals instead of splats."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.render.rendering import lens, picture, random_cloud, scene_of, settings_of, view_of
from usdsplat.core.cloud import SplatCloud
from usdsplat.kernels.devices import open_device
from usdsplat.render.renderer import Renderer
from usdsplat.render.specs import CameraSpec, Framing, View

MODES = ("points", "ellipses", "normals")
SIZE, FOCAL, DEPTH = 200, 200.0, 4.0
CENTER = SIZE // 2


def head_on(scale: float = 1.0) -> View:
    """Pixel (CENTER, CENTER) sees along -z from DEPTH in front of the origin."""
    shift = 0.5 / SIZE
    camera = CameraSpec(
        world_to_camera=(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, -DEPTH, 0, 0, 0, 1),
        window=(-0.5 - shift, -0.5 + shift, 0.5 - shift, 0.5 + shift),
        clipping_range=(0.1, 100.0),
    )
    return View(camera=camera, framing=Framing(resolution=(SIZE, SIZE), pixel_scale=scale))


def splats(positions, *, scales=(0.4, 0.2, 0.01), opacity=0.8, colors=((0.9, 0.5, 0.1),)):
    """Splats with the same axes, of constant colours."""
    n = len(positions)
    sh = (np.array(colors, np.float32) - 0.5) / 0.28209479177387814
    return SplatCloud(
        positions=np.array(positions, np.float32),
        scales=np.tile(np.array(scales, np.float32), (n, 1)),
        rotations=np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        opacities=np.full(n, opacity, np.float32),
        sh=np.broadcast_to(sh.reshape(-1, 1, 3), (n, 1, 3)).astype(np.float32),
    )


def drawn(cloud, view=None, aovs=("color",), **options):
    return picture(scene_of((cloud, np.eye(4))), view or head_on(), aovs=aovs, **options)


@pytest.mark.parametrize("opacity", [1.0, 0.02])
@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_a_point_is_an_opaque_dot_of_three_pixels(opacity, scale):
    """Oracle: the disc: half is covered at its radius, and as much in all as its area, whatever the
    splat's size and opacity."""
    radius = 1.5 / scale
    cloud = splats([(0, 0, 0)], scales=(0.5, 0.001, 0.1), opacity=opacity)
    off = splats([(radius * DEPTH / FOCAL, 0, 0)], opacity=opacity)
    color = drawn(cloud, head_on(scale), display_mode="points")["color"]
    np.testing.assert_allclose(color[CENTER, CENTER, :3], (0.9, 0.5, 0.1), rtol=2e-3)
    beside = drawn(off, head_on(scale), display_mode="points")["color"]
    assert beside[CENTER, CENTER, 3] == pytest.approx(0.5, abs=0.01)
    assert color[..., 3].sum() == pytest.approx(np.pi * radius**2, rel=0.35)
    assert np.count_nonzero(color[..., 3]) < 45


@pytest.mark.parametrize("opacity", [0.8, 0.6])
def test_an_ellipse_is_where_its_splat_covers_a_fifth(opacity):
    """Oracle: the Gaussian's level set, in closed form, along both axes of the picture; the rim is
    outside of 84 % of it."""
    cloud = splats([(0, 0, 0)], scales=(0.8, 0.5, 0.01), opacity=opacity)
    color = drawn(cloud, display_mode="ellipses")["color"]
    reach = np.sqrt(2 * np.log(opacity / 0.2))
    for axis, row in ((0.8, color[CENTER]), (0.5, color[:, CENTER])):
        edge = reach * np.sqrt((FOCAL * axis / DEPTH) ** 2 + 0.3)
        away = np.abs(np.arange(SIZE) - CENTER)
        assert (row[away < edge - 1, 3] > 0.95).all()
        assert (row[away > edge + 4, 3] == 0).all()
        assert np.count_nonzero(row[:, 3] > 0.5) == pytest.approx(2 * edge, abs=2)
        inner, rim = away < 0.84 * edge - 2, (away > 0.84 * edge + 3) & (away < edge - 1)
        np.testing.assert_allclose(row[inner, 0], 0.9, rtol=2e-2)
        np.testing.assert_allclose(row[rim, 0], 0.3 * 0.9, rtol=0.1)
        assert rim.any()


def test_what_never_covers_a_fifth_has_no_ellipse():
    """Oracle: the threshold."""
    color = drawn(splats([(0, 0, 0)], opacity=0.19), display_mode="ellipses")["color"]
    assert not color.any()


def test_splats_are_counted_once_with_their_rims():
    """Oracle: three splats, of which one is too faint for an ellipse."""
    cloud = splats([(0, 0, 0), (0.3, 0, 0), (0, 0.3, 0)])
    cloud = replace(cloud, opacities=np.array([0.8, 0.1, 0.8], np.float32))
    renderer, scene = Renderer(open_device()), scene_of((cloud, np.eye(4)))
    for mode, count in (("splats", 3), ("points", 3), ("ellipses", 2)):
        for _ in renderer.render(scene, head_on(), settings_of(display_mode=mode), ("color",)):
            pass
        assert (renderer.stats.visible, renderer.stats.total) == (count, 3)


def test_normals_are_those_of_the_aov():
    """Oracle: the AOV Naxis, which averages the same normals, of splats that do not overlap."""
    rng = np.random.default_rng(0)
    grid = [(0.5 * x, 0.5 * y, 0.0) for x in (-2, 0, 2) for y in (-2, 0, 2)]
    turns = rng.normal(size=(9, 4)).astype(np.float32)
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    cloud = replace(splats(grid, scales=(0.08, 0.06, 0.02)), rotations=turns)
    found = drawn(cloud, aovs=("color", "Naxis"), display_mode="normals")
    color, normal = found["color"], found["Naxis"]
    there = color[..., 3] > 0
    straight = color[there, :3] / color[there, 3:]
    np.testing.assert_allclose(straight, 0.5 * normal[there] + 0.5, atol=1e-5)
    plain = drawn(cloud, aovs=("color", "Naxis"))
    np.testing.assert_array_equal(plain["color"][..., 3], color[..., 3])
    np.testing.assert_array_equal(plain["Naxis"], normal)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("sorting", ["zDepth", "rayHitDistance"])
def test_depth_decides_what_is_seen(mode, sorting):
    """Oracle: two splats at known depths in a line of sight, and what holds out between them."""
    cloud = splats(
        [(0, 0, -1), (0, 0, 1)], scales=(0.2, 0.2, 0.2), opacity=0.99,
        colors=((1, 0, 0), (0, 1, 0)),
    )  # fmt: skip
    aovs = ("color", "depth", "elementId")
    found = drawn(cloud, aovs=aovs, display_mode=mode, sorting=sorting)
    assert found["depth"][CENTER, CENTER] == pytest.approx(DEPTH - 1, abs=1e-4)
    assert found["elementId"][CENTER, CENTER] == 1

    def wall(x0, y0, x1, y1):
        return np.full((y1 - y0, x1 - x0), 2.0, np.float32)

    hidden = drawn(cloud, aovs=aovs, display_mode=mode, sorting=sorting, holdout=wall)
    assert not hidden["color"].any() and (hidden["elementId"] == -1).all()


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("sorting", ["zDepth", "rayHitDistance"])
def test_aovs_are_of_what_is_drawn(mode, sorting):
    """Oracle: coverage: ids, depths and mattes are where something is, and rows exist."""
    cloud = random_cloud(3)
    found = drawn(cloud, view_of(lens()), display_mode=mode, sorting=sorting, aovs=(
        "color", "depth", "elementId", "Neye", "albedo", "depthExpected", "cryptoObject",
    ))  # fmt: skip
    there = found["color"][..., 3] > 0
    assert 0.01 < there.mean() < 1
    np.testing.assert_array_equal(found["elementId"] >= 0, there)
    assert found["elementId"].max() < len(cloud)
    assert np.isfinite(found["depth"][there]).all() and np.isinf(found["depth"][~there]).all()
    np.testing.assert_allclose(np.linalg.norm(found["Neye"][there], axis=-1), 1, atol=1e-5)
    weights = found["cryptoObject"][..., 1]
    np.testing.assert_allclose(weights, found["color"][..., 3], atol=2e-3)


@pytest.mark.parametrize("mode", MODES)
def test_a_crop_is_a_part_of_the_whole(mode):
    """Oracle: the whole picture, bit for bit, also of dots whose splats are smaller than they."""
    cloud = random_cloud(4, n=3000)
    cloud = replace(cloud, scales=0.1 * cloud.scales, opacities=0.3 * cloud.opacities)
    view = view_of(lens())
    whole = drawn(cloud, view, display_mode=mode)["color"]
    part = drawn(cloud, view_of(lens(), (21, 18, 90, 77)), display_mode=mode)["color"]
    np.testing.assert_array_equal(part, whole[18:77, 21:90])
