"""Tests of dome lights: their light, their axes, and what hides the sky."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.render.lights.light_scenes import UP, add_splats, cloud_of, light_at
from tests.render.lights.test_shadows import WHITE, quad, view_from_above
from tests.render.rendering import picture, settings_of
from tests.render.surface_scenes import add
from usdsplat.core.sh import basis
from usdsplat.kernels.devices import open_device
from usdsplat.render.lights import light_maps
from usdsplat.render.lights.depth_map import draw_depth_map
from usdsplat.render.lights.dome import peak_lights, plain_sky, smooth_light, split
from usdsplat.render.lights.sampling import samples_of
from usdsplat.render.lights.specs import LightSpec
from usdsplat.render.patience import Patience
from usdsplat.render.renderer import Renderer
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import SurfaceSpec

EYE = tuple(np.eye(4).ravel())


def dome(sky=None, *, radiance=(1.0, 1.0, 1.0), matrix=None):
    to_world = EYE if matrix is None else tuple(np.asarray(matrix, float).ravel())
    return LightSpec(kind="dome", sky=sky or plain_sky(), radiance=radiance, to_world=to_world)


def directions(height, width):
    """Directions of the pixels of a latlong picture and their solid angles, by Storm's formula:
    u = (atan2(z, x) + π/2) / 2π, v = acos(y) / π."""
    v, u = (np.arange(height) + 0.5) / height, (np.arange(width) + 0.5) / width
    theta, turn = math.pi * v[:, None], 2 * math.pi * u - math.pi / 2
    parts = np.sin(theta) * np.cos(turn), np.cos(theta) + 0 * turn, np.sin(theta) * np.sin(turn)
    areas = np.sin(theta) * (math.pi / height) * (2 * math.pi / width) + 0 * turn
    return np.stack(parts, axis=-1), areas


def integrated(pixels, normals):
    """Irradiance over π by brute force, shape (n, 3)."""
    towards, areas = directions(*pixels.shape[:2])
    flat = pixels.reshape(-1, 3).astype(np.float64) * areas.reshape(-1, 1) / math.pi
    return np.maximum(0, normals @ towards.reshape(-1, 3).T) @ flat


def light_of(light, normals):
    """Light without shadows on white surfaces, shape (n, 3)."""
    mean, ratios = smooth_light(light)
    found = mean * np.maximum(0, 0.5 + basis(normals, 4) @ ratios)
    for peak in peak_lights(light):
        for one in samples_of(peak, 64):
            facing = np.maximum(0, normals @ [one["x"], one["y"], one["z"]])
            found = found + facing[:, None] * [one["red"], one["green"], one["blue"]]
    return found


def spread_normals(count=200):
    normals = np.random.default_rng(1).normal(size=(count, 3))
    return normals / np.linalg.norm(normals, axis=1)[:, None]


def sun_and_sky(height=64):
    """A blue sky over a brown ground, with a small sun."""
    towards, _ = directions(height, 2 * height)
    up = towards[..., 1:2]
    pixels = np.where(up > 0, [0.3, 0.5, 0.9], [0.25, 0.2, 0.1]) * (0.7 + 0.3 * up)
    sun = np.array([0.6, 0.64, 0.48])
    pixels[towards @ sun > math.cos(math.radians(4))] = [900.0, 800.0, 600.0]
    return pixels.astype(np.float32), sun


@pytest.mark.parametrize("source", ["real", "made"])
def test_the_light_of_a_sky_is_its_integral_at_every_normal(source, request):
    """Oracle: sums over all pixels of the picture, to 1 % of their mean."""
    if source == "made":
        pixels, _ = sun_and_sky()
    else:
        from usdsplat.images.texture import read_texture

        data = request.getfixturevalue("data")
        pixels = read_texture(data / "usd/hdri/StinsonBeach.hdr")
    normals = spread_normals(60)
    expected = integrated(pixels, normals)
    found = light_of(dome(split(pixels)[0]), normals)
    assert np.abs(found - expected).max() < 0.015 * expected.mean()


def test_irradiance_of_degree_two_is_that_of_ramamoorthi_and_hanrahan():
    """Oracle: their nine numbers by sums over the picture, and their matrix M of equation 12, for
    a sky without higher degrees."""
    towards, areas = directions(128, 256)
    x, y, z = np.moveaxis(towards, -1, 0)
    pixels = (1.2 + 0.5 * x - 0.3 * y * z + 0.4 * (x * x - y * y))[..., None] * [1.0, 0.5, 0.2]
    shapes = [
        0.282095 + 0 * x, 0.488603 * y, 0.488603 * z, 0.488603 * x, 1.092548 * x * y,
        1.092548 * y * z, 0.315392 * (3 * z * z - 1), 1.092548 * x * z, 0.546274 * (x * x - y * y),
    ]  # fmt: skip
    a = [(pixels[..., 0] * shape * areas).sum() for shape in shapes]
    c1, c2, c3, c4, c5 = 0.429043, 0.511664, 0.743125, 0.886227, 0.247708
    matrix = np.array([
        [c1 * a[8], c1 * a[4], c1 * a[7], c2 * a[3]],
        [c1 * a[4], -c1 * a[8], c1 * a[5], c2 * a[1]],
        [c1 * a[7], c1 * a[5], c3 * a[6], c2 * a[2]],
        [c2 * a[3], c2 * a[1], c2 * a[2], c4 * a[0] - c5 * a[6]],
    ])  # fmt: skip
    normals = spread_normals()
    n = np.concatenate([normals, np.ones((len(normals), 1))], axis=1)
    expected = np.einsum("ni,ij,nj->n", n, matrix, n) / math.pi
    found = light_of(dome(split(pixels.astype(np.float32))[0]), normals)[:, 0]
    np.testing.assert_allclose(found, expected, rtol=2e-3)


def test_a_sun_in_the_picture_is_a_distant_light_of_its_own():
    """Oracle: its direction, irradiance and angle; the rest has no bright spot."""
    pixels, sun = sun_and_sky(256)
    sky, wrong = split(pixels)
    (peak,) = sky.peaks
    assert wrong == 0
    assert math.degrees(math.acos(np.dot(peak.direction, sun))) < 0.1
    # a disc of 4 degrees facing the sun: L sin² 4°
    assert peak.irradiance[0] == pytest.approx(900 * math.sin(math.radians(4)) ** 2, rel=0.04)
    assert math.degrees(peak.angle) == pytest.approx(8.0, rel=0.05)
    assert np.frombuffer(sky.grid, np.float32).max() < 60


@pytest.mark.parametrize(
    ("u", "v", "direction"),
    [
        (0.5, 0.5, (0, 0, 1)),
        (0.75, 0.5, (-1, 0, 0)),
        (0.25, 0.5, (1, 0, 0)),
        (0.3, 0.001, (0, 1, 0)),
    ],
)
def test_pictures_have_the_axes_of_usd(u, v, direction):
    """Oracle: OpenEXR's latlong: +z in the middle, −x right of it, +y at the top; a rotation turns
    them."""
    pixels = np.full((64, 128, 3), 1e-3, np.float32)
    pixels[int(v * 64), int(u * 128)] = 1000.0
    sky, _ = split(pixels)
    (light,) = peak_lights(dome(sky))
    assert np.dot(light.direction, direction) < -math.cos(math.radians(4))
    # a scale has no effect, and a quarter turn about y takes z to x
    turn = 3.0 * np.array([[0, 0, 1.0], [0, 1, 0], [-1, 0, 0]])
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    (turned,) = peak_lights(dome(sky, matrix=matrix))
    np.testing.assert_allclose(turned.direction, turn / 3 @ light.direction, atol=1e-12)


def test_samples_of_a_sky_share_its_light():
    """Oracle: the integral of the picture; the same directions for another sky."""
    pixels, _ = sun_and_sky()
    light = dome(split(pixels)[0])
    found = samples_of(light, 100)
    whole = np.frombuffer(light.sky.grid, np.float32).reshape(64, 128, 3)
    _, areas = directions(64, 128)
    expected = (whole * areas[..., None]).sum(axis=(0, 1)) / math.pi
    for name, total in zip(("red", "green", "blue"), expected, strict=True):
        assert found[name].sum() == pytest.approx(total, rel=1e-3)
    other = samples_of(dome(), 100)
    np.testing.assert_array_equal(found[["x", "y", "z"]], other[["x", "y", "z"]])
    top = np.zeros((8, 16, 3), np.float32)
    top[:2] = 1.0
    dark = samples_of(dome(split(top)[0]), 100)
    np.testing.assert_array_equal(found[["x", "y", "z"]], dark[["x", "y", "z"]])


def test_a_white_furnace_shows_nothing():
    """Oracle: 1, to 1e-3, on a white mesh at every slope; a shell of splats keeps its colour."""
    scene = RenderScene()
    for k, tilt in enumerate((0.0, 0.6, 1.2)):
        turn = np.eye(4)
        turn[0, 0] = turn[2, 2] = math.cos(tilt)
        turn[0, 2], turn[2, 0] = math.sin(tilt), -math.sin(tilt)
        turn[:3, 3] = 0.0, 0.6 * k - 0.6, 0.0
        add(scene, f"/part{k}", quad(0.0, (-0.2, -0.2), (0.2, 0.2), materials=WHITE), turn)
    scene.set_light("/sky", dome())
    view = view_from_above(height=1.0)
    for mode in ("captured", "shadowed"):
        options = {"color_mode": "scene", "aovs": ("color",), "lighting": mode}
        color = picture(scene, view, **options)["color"]
        drawn = color[..., 3] == 1
        assert drawn.sum() > 50
        # above the planes nothing but the sky; the horizon of a tilted one crosses others
        np.testing.assert_allclose(np.median(color[drawn][:, :3]), 1.0, atol=1e-3)
        if mode == "captured":
            np.testing.assert_allclose(color[drawn][:, :3], 1.0, atol=1e-3)
    normals = spread_normals(300)
    shell = cloud_of(normals, (0.05, 0.05, 0.05), 0.9, grey=0.6)
    scene = add_splats(RenderScene(), "/ball", shell, surface=SurfaceSpec(normals=normals))
    plain = picture(scene, view, aovs=("color",))["color"]
    scene.set_light("/sky", dome())
    lit = picture(scene, view, aovs=("color",), lighting="shadowed", dome_samples=16)["color"]
    np.testing.assert_allclose(lit, plain, atol=1e-5)


@pytest.mark.parametrize("kind", ["mesh", "splat"])
def test_a_disc_overhead_hides_the_part_of_the_sky_that_it_covers(kind):
    """Oracle: the form factor of a disc, R² / (R² + h²), for a receiver that faces it."""
    height, radius = 1.0, 0.8
    turn = np.linspace(0, 2 * math.pi, 65)[:-1]
    rim = np.stack([radius * np.cos(turn), radius * np.sin(turn), height + 0 * turn], axis=1)
    scene = RenderScene()
    if kind == "mesh":
        from tests.render.surface_scenes import mesh

        fan = [[0, 1 + k, 1 + (k + 1) % 64] for k in range(64)]
        add(scene, "/disc", mesh(np.concatenate([[[0, 0, height]], rim]), fan))
    else:
        side = np.linspace(-radius, radius, 40)
        spots = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
        spots = spots[(spots**2).sum(axis=1) < (radius - 0.01) ** 2]
        places = np.concatenate([spots, np.full((len(spots), 1), height)], axis=1)
        add_splats(scene, "/disc", cloud_of(places, (0.03, 0.03, 1e-4), 0.99))
    found = light_at(scene, dome(), np.zeros((1, 3)), UP, samples=400, resolution=128)[0]
    expected = 1 - radius**2 / (radius**2 + height**2)
    assert found[0] / found[3] == pytest.approx(expected, abs=0.02)


def skied_scene():
    """Splats and meshes below others, under a sky with a sun."""
    side = (np.arange(12) + 0.5) / 4 - 1.5
    places = np.stack([*(each.ravel() for each in np.meshgrid(side, side)), np.zeros(144)], axis=1)
    up = SurfaceSpec(
        normals=np.tile(np.float32([0, 0, 1]), (144, 1)),
        confidence=np.linspace(0, 1, 144, dtype=np.float32),
    )
    flat = cloud_of(places, (0.2, 0.2, 1e-3), 0.9, grey=0.8)
    scene = add_splats(RenderScene(), "/flat", flat, surface=up)
    add_splats(scene, "/above", cloud_of([[-0.5, 0, 0.8]], (0.4, 0.4, 1e-3), 0.99))
    add(scene, "/ground", quad(-0.4, (-2, -1.2), (2, 1.2), materials=WHITE))
    add(scene, "/roof", quad(0.8, (0.2, -0.5), (0.9, 0.6), materials=WHITE))
    standing = np.eye(4)
    standing[1:3, 1:3] = [[0, -1], [1, 0]]
    scene.set_light("/sky", dome(split(sun_and_sky()[0])[0], matrix=standing))
    return scene


OPTIONS = {
    "lighting": "shadowed", "light_samples": 2, "dome_samples": 24, "shadow_resolution": 64,
}  # fmt: skip
AOVS = ("color", "shadow")


def test_bands_crops_and_threads_show_the_same_sky():
    """Oracle: the whole picture, bit for bit."""
    scene = skied_scene()
    whole = picture(scene, view_from_above(), aovs=AOVS, **OPTIONS)
    bands = picture(scene, view_from_above(), aovs=AOVS, band_pixels=960, **OPTIONS)
    one = picture(scene, view_from_above(), aovs=AOVS, threads=1, **OPTIONS)
    crop = picture(scene, view_from_above(window=(13, 5, 47, 33)), aovs=AOVS, **OPTIONS)
    for name in AOVS:
        np.testing.assert_array_equal(bands[name], whole[name], err_msg=name)
        np.testing.assert_array_equal(one[name], whole[name], err_msg=name)
        np.testing.assert_array_equal(crop[name], whole[name][5:33, 13:47], err_msg=name)
    assert whole["shadow"].min() < 0.6 < 0.99 < whole["shadow"].max()


def test_edits_of_a_dome_are_drawn_and_nothing_else_is_kept():
    """Oracle: a new renderer's picture after each edit, bit for bit."""
    scene, renderer = skied_scene(), Renderer(open_device())
    settings, sky = settings_of(**OPTIONS), scene.named_lights["/sky"]

    def drawn(by):
        bands = by.render(scene, view_from_above(), settings, AOVS)
        return [{name: array.copy() for name, array in band.arrays.items()} for band in bands]

    before = None
    for light in (
        sky, replace(sky, to_world=EYE), replace(sky, radiance=(2.0, 1.0, 0.5)), dome(), None,
    ):  # fmt: skip
        scene.set_light("/sky", light)
        found, fresh = drawn(renderer), drawn(Renderer(open_device()))
        for a, b in zip(found, fresh, strict=True):
            for name in AOVS:
                np.testing.assert_array_equal(a[name], b[name], err_msg=name)
        if before is not None:
            pairs = zip(found, before, strict=True)
            assert any(not np.array_equal(a["color"], b["color"]) for a, b in pairs)
        before = found


def test_an_edit_of_the_light_of_a_dome_draws_no_picture_of_its_casters_again(monkeypatch):
    """Oracle: the number of depth maps that are drawn; dark directions have none."""
    drawn = []

    def counted(rasterizer, camera, *others):
        drawn.append(camera)
        return draw_depth_map(rasterizer, camera, *others)

    monkeypatch.setattr(light_maps, "draw_depth_map", counted)
    scene, renderer = skied_scene(), Renderer(open_device())
    top = np.full((64, 128, 3), 0.0, np.float32)
    top[:32] = 1.0
    counts = []
    edge = np.diag([1.0, -1.0, -1.0, 1.0])
    for light in (
        dome(), dome(radiance=(2.0, 1.0, 0.5)), dome(split(top)[0]),
        dome(split(top)[0], matrix=edge),
    ):  # fmt: skip
        scene.set_light("/sky", light)
        list(renderer.render(scene, view_from_above(), settings_of(**OPTIONS), AOVS))
        counts.append(len(drawn))
    assert counts == [24] * 4
    renderer = Renderer(open_device())
    scene.set_light("/sky", dome(split(top)[0]))
    list(renderer.render(scene, view_from_above(), settings_of(**OPTIONS), AOVS))
    assert 12 <= len(drawn) - 24 < 20


def test_the_number_of_directions_does_not_change_the_light_of_open_surfaces():
    """Oracle: the picture with other directions."""
    scene = add(RenderScene(), "/ground", quad(0.0, (-3, -3), (3, 3), materials=WHITE))
    scene.set_light("/sky", dome(split(sun_and_sky()[0])[0]))
    options = {"color_mode": "scene", "aovs": ("color",), "lighting": "shadowed"}
    few, many = (
        picture(scene, view_from_above(height=1.0), dome_samples=count, **options)["color"]
        for count in (7, 64)
    )
    np.testing.assert_allclose(few, many, rtol=1e-5)
    assert few.max() > 0.1


@pytest.mark.parametrize("radiance", [0.0, 1e30])
def test_pictures_under_any_dome_are_finite(radiance):
    """Oracle: no NaN and no infinity."""
    scene = skied_scene()
    scene.set_light("/sky", dome(split(sun_and_sky()[0])[0], radiance=(radiance,) * 3))
    for array in picture(scene, view_from_above(), aovs=AOVS, **OPTIONS).values():
        assert np.isfinite(array).all()


def test_pixels_that_are_no_light_are_counted_and_black():
    """Oracle: the sky of a picture with zeros in their place."""
    pixels, _ = sun_and_sky()
    clean, broken = pixels.copy(), pixels.copy()
    clean[3:5, 7] = 0.0
    broken[3, 7], broken[4, 7] = np.nan, (-1.0, np.inf, -np.inf)
    assert split(broken) == (split(clean)[0], 2)


def test_pictures_that_do_not_wait_keep_the_maps_of_those_that_do():
    """Oracle: two pictures of a movement, which draws fewer splats, are equal bit for bit, and the
    maps are the same objects as before. The peak of the dome has no map without shadows."""
    pixels = np.full((32, 64, 3), 0.2, np.float32)
    pixels[4, 20] = 400.0
    sky = dome(split(pixels)[0])
    assert len(peak_lights(sky)) == 1
    scene = RenderScene()
    add_splats(scene, "/above", cloud_of([[0, 0, 1.0], [0.4, 0, 1.0]], (0.3, 0.3, 0.05), 0.9))
    add(scene, "/ground", quad(0.0, (-3, -3), (3, 3), materials=WHITE))
    scene.set_light("/key", LightSpec(direction=(0.3, 0.0, -1.0), irradiance=(1.0, 1.0, 1.0)))
    scene.set_light("/sky", sky)
    renderer = Renderer(open_device())
    options = {"lighting": "shadowed", "light_samples": 2, "dome_samples": 4}

    def drawn(light, **more):
        bands = renderer.render(
            scene, view_from_above(), settings_of(**options, **more), ("color",),
            patience=Patience(light=light),
        )  # fmt: skip
        return np.concatenate([band.arrays["color"].copy() for band in bands])

    drawn(True)
    maps = renderer._idle[0].lights.maps
    before = dict(maps)
    assert before
    first = drawn(False, splat_budget=1)
    second = drawn(False, splat_budget=1)
    np.testing.assert_array_equal(first, second)
    assert maps.keys() == before.keys()
    assert all(maps[key][1] is each for key, (_, each) in before.items())
