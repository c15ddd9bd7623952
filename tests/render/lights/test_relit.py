"""Tests of relit captures: new light over that of the photographs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.render.lights.light_scenes import add_splats, cloud_of
from tests.render.lights.test_domes import dome, spread_normals, sun_and_sky
from tests.render.lights.test_shadows import SUN, WHITE, quad, view_from_above
from tests.render.rendering import picture, settings_of
from tests.render.surface_scenes import add
from usdsplat.core.sh import C0, basis
from usdsplat.images.color import decode, encode, encode_light
from usdsplat.kernels.devices import open_device
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.lights.captured import GREY, estimate
from usdsplat.render.lights.dome import split
from usdsplat.render.lights.memory import lighting_bytes
from usdsplat.render.lights.relighting import field_gains, fit_colors
from usdsplat.render.renderer import Renderer
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import SurfaceSpec
from usdsplat.render.splat_normals import SurfaceValues

SPACE = "srgb_rec709_scene"


def ball(colors=None, count=400):
    """A closed sphere of splats with its normals, and colours that are linear light."""
    normals = spread_normals(count).astype(np.float32)
    cloud = cloud_of(normals, (0.12, 0.12, 0.12), 0.95, grey=0.6)
    if colors is not None:
        sh = ((encode(colors, SPACE) - 0.5) / C0).astype(np.float32)[:, None]
        cloud = replace(cloud, sh=sh)
    return cloud, SurfaceSpec(normals=normals)


def ball_scene(colors=None, **options):
    cloud, surface = ball(colors)
    return add_splats(RenderScene(), "/ball", cloud, surface=surface, **options)


def colors_of(scene, **settings):
    """Linear colours of a picture where it is opaque."""
    settings = {"lighting": "relit", "dome_samples": 8, "light_samples": 2, **settings}
    found = picture(scene, view_from_above(height=4.0), aovs=("color",), **settings)["color"]
    return found


def gains_of(scene):
    """Gains of the fields of a relit scene."""
    device = open_device()
    buffers = FrameBuffers(device.resident)
    return field_gains(device, scene, settings_of(lighting="relit"), buffers)


@pytest.mark.parametrize("self_shadows", [False, True])
def test_the_same_light_in_and_out_changes_nothing(self_shadows):
    """Oracle: the captured picture, to 1e-5; the lights are named, visible or hidden."""
    sky = dome(split(sun_and_sky()[0])[0])
    for named, hidden in ((("/sun", "/sky"), False), (("/photographed", "/sun"), True)):
        scene = ball_scene(captured_lights=named)
        scene.set_light("/sun", SUN)
        scene.set_light("/sky", sky)
        if hidden:
            scene.set_light("/photographed", replace(sky, is_on=False))
        plain = colors_of(scene, lighting="captured")
        lit = colors_of(scene, self_shadows=self_shadows)
        np.testing.assert_allclose(lit, plain, atol=1e-5)


def test_twice_the_light_is_twice_the_linear_colour_and_a_hidden_light_adds_none():
    """Oracle: the product, in linear light."""
    options = {"blend_space": "linear", "color_mode": "scene"}
    plain = colors_of(ball_scene(), lighting="captured", **options)
    scene = ball_scene(captured_lights=("/photographed",))
    scene.set_light("/photographed", replace(dome(), is_on=False))
    assert scene.lights == ()
    scene.set_light("/new", dome(radiance=(2.0, 1.0, 0.5)))
    lit = colors_of(scene, **options)
    full = plain[..., 3] > 0.5
    ratio = lit[full][:, :3] / plain[full][:, :3]
    assert full.sum() > 100
    np.testing.assert_allclose(ratio, np.tile([2.0, 1.0, 0.5], (len(ratio), 1)), rtol=1e-4)


def test_the_ratio_follows_the_normal_of_each_splat():
    """Oracle: (max(0, n · l) + A) / (1 + A') with A a part of the means, by hand."""
    scene = ball_scene(captured_lights=("/photographed",))
    scene.set_light("/photographed", replace(dome(), is_on=False))
    scene.set_light("/sun", SUN)
    gains = gains_of(scene)["/ball"]
    facing = np.maximum(0, spread_normals(400)[:, 2])
    expected = (facing + 0.2 * facing.mean()) / 1.2
    np.testing.assert_allclose(gains, np.tile(expected[:, None], (1, 3)), atol=5e-4)


def test_meshes_shadow_relit_splats():
    """Oracle: the ratio under an opaque roof is that of A alone."""
    scene = ball_scene(captured_lights=("/sun",))
    scene.set_light("/sun", SUN)
    add(scene, "/roof", quad(2.0, (-3, -3), (3, 3), materials=WHITE))
    gains = gains_of(scene)["/ball"]
    facing = np.maximum(0, spread_normals(400)[:, 2])
    ambient = 0.2 * facing.mean()
    np.testing.assert_allclose(gains[:, 0], ambient / (facing + ambient), atol=1e-5)


def test_the_estimate_finds_the_light_of_a_grey_capture():
    """Oracle: an irradiance of degree 2, times an albedo of 0.4; a tenth of the splats are paint
    of other albedos."""
    normals = spread_normals(3000)
    x, y, z = normals.T
    light = (1.0 + 0.5 * y + 0.2 * x * z)[:, None] * [1.0, 0.9, 0.7]
    colors = GREY * light
    colors[::10] *= 0.2
    cloud, _ = ball(colors, 3000)
    facts = np.stack([np.ones(3000), np.zeros(3000)], axis=1).astype(np.float32)
    surface = SurfaceValues(normals.astype(np.float32), facts)
    found = estimate(cloud, SPACE, surface)
    error = np.abs(found.on(surface) - light) / light
    assert error.max() < 0.03 and 0.1 < found.residual < 0.9
    clean, _ = ball(GREY * light, 3000)
    exact = estimate(clean, SPACE, surface)
    assert np.abs(exact.on(surface) - light).max() < 2e-3 and exact.residual < 0.01


@pytest.mark.parametrize("confidence", [0.0, 1.0])
@pytest.mark.parametrize("count", [1, 3, 50])
def test_any_capture_has_an_estimate(count, confidence):
    """Oracle: finite, positive light; without confidence it is the same on all splats."""
    normals = spread_normals(count)
    facts = np.full((count, 2), confidence, np.float32)
    cloud = cloud_of(normals, (0.1, 0.1, 0.1), 0.5, grey=0.5)
    surface = SurfaceValues(normals.astype(np.float32), facts)
    found = estimate(cloud, SPACE, surface)
    assert np.isfinite(found.on(surface)).all() and (found.on(surface) > 0).all()
    assert math.isfinite(found.residual)
    if not confidence:
        assert np.ptp(found.on(surface), axis=0).max() < 1e-6


@pytest.mark.parametrize("degree", [0, 1, 3])
def test_gains_in_a_linear_space_scale_colours_and_fitted_ones_are_near(degree):
    """Oracle: the product of the colour in each direction; a gain of 1 keeps all bits."""
    rng = np.random.default_rng(degree)
    count = (degree + 1) ** 2
    sh = (0.05 * rng.normal(size=(50, count, 3))).astype(np.float32)
    gains = rng.uniform(0.2, 3.0, (50, 3)).astype(np.float32)
    gains[7] = 1.0
    rows = basis(spread_normals(100), degree)
    for space, most in (("lin_rec709_scene", 1e-5), (SPACE, 0.05)):
        found = fit_colors(sh, gains, space)
        colors, after = (np.einsum("mk,nkc->nmc", rows, each) + 0.5 for each in (sh, found.sh))
        expected = encode(decode(colors, space) * gains[:, None], space)
        assert np.abs(after - expected).max() < most
        assert found.error <= found.worst < most
        np.testing.assert_array_equal(found.sh[7], sh[7])
    if degree == 0:
        assert found.worst < 1e-6


def test_edits_of_the_light_of_photographs_are_drawn():
    """Oracle: a new renderer's picture after each edit, bit for bit."""
    scene, renderer = ball_scene(captured_lights=("/photographed",)), Renderer(open_device())
    scene.set_light("/sun", SUN)
    settings = settings_of(lighting="relit", dome_samples=4)
    field = scene.visible_fields()[0]

    def drawn(by):
        bands = by.render(scene, view_from_above(), settings, ("color",))
        return [band.arrays["color"].copy() for band in bands]

    edits = [
        lambda: None,
        lambda: scene.set_light("/photographed", replace(dome(), is_on=False)),
        lambda: scene.set_light("/photographed", replace(SUN, is_on=False)),
        lambda: scene.set_field("/ball", replace(field.spec, captured_lights=())),
        lambda: scene.set_field(
            "/ball", replace(field.spec, cloud=ball(np.full((400, 3), 0.1))[0])
        ),
    ]
    before = None
    for edit in edits:
        edit()
        found, fresh = drawn(renderer), drawn(Renderer(open_device()))
        for a, b in zip(found, fresh, strict=True):
            np.testing.assert_array_equal(a, b)
        if before is not None and edit is not edits[3]:
            assert any(not np.array_equal(a, b) for a, b in zip(found, before, strict=True))
        before = found


@pytest.mark.parametrize("space", ["lin_ap1_scene", "srgb_p3d65_scene"])
def test_light_multiplies_rec709_whatever_the_primaries_of_a_capture(space):
    """Oracle: the product in linear Rec.709, by OpenUSD's own matrices."""
    from pxr import Gf

    def rec709(colors):
        gf = Gf.ColorSpace("lin_rec709_scene")
        rows = colors.reshape(-1, 3).tolist()
        found = [gf.Convert(Gf.ColorSpace(space), Gf.Vec3f(*row)).GetRGB() for row in rows]
        return np.array(found).reshape(colors.shape)

    factors = np.array([2.0, 1.0, 0.5])
    own = np.random.default_rng(3).uniform(0.3, 0.7, (20, 3)).astype(np.float32)
    sh = ((own - 0.5) / C0).astype(np.float32)[:, None]
    fitted = fit_colors(sh, np.tile(factors, (20, 1)), space).sh[:, 0] * C0 + 0.5
    np.testing.assert_allclose(rec709(fitted), rec709(own) * factors, atol=2e-3)
    scene = ball_scene(color_space=space, captured_lights=("/photographed",))
    field = scene.visible_fields()[0]
    cloud = replace(field.spec.cloud, sh=np.tile(np.float32([0.3, -0.2, 0.1]), (400, 1, 1)))
    scene.set_field("/ball", replace(field.spec, cloud=cloud))
    scene.set_light("/photographed", replace(dome(), is_on=False))
    for options in ({}, {"blend_space": "linear"}):
        options = {"color_mode": "scene", **options}
        plain = colors_of(scene, lighting="captured", **options)
        scene.set_light("/new", dome(radiance=tuple(factors)))
        lit = colors_of(scene, **options)
        scene.set_light("/new", None)
        full = plain[..., 3] > 0.99
        assert full.sum() > 100
        np.testing.assert_allclose(
            lit[full][:, :3], plain[full][:, :3] * factors, rtol=0.02, atol=5e-3
        )


def test_the_estimate_of_a_capture_does_not_depend_on_its_primaries():
    """Oracle: the same colours in Rec.709."""
    normals = spread_normals(500)
    light = (1.0 + 0.5 * normals[:, 1:2]) * [1.0, 0.8, 0.6]
    facts = np.stack([np.ones(500), np.zeros(500)], axis=1).astype(np.float32)
    surface = SurfaceValues(normals.astype(np.float32), facts)
    found = []
    for space in ("lin_rec709_scene", "lin_ap1_scene"):
        colors = encode_light(GREY * light, space)
        sh = ((colors - 0.5) / C0).astype(np.float32)[:, None]
        cloud = replace(cloud_of(normals, (0.12, 0.12, 0.12), 0.95), sh=sh)
        found.append(estimate(cloud, space, surface).on(surface))
    np.testing.assert_allclose(found[1], found[0], rtol=1e-4)
    np.testing.assert_allclose(found[1], light, rtol=5e-3)


@pytest.mark.parametrize("named", [(), ("/set",), ("/set", "/lamp")])
def test_the_memory_of_relit_splats_counts_the_light_of_photographs(named):
    """Oracle: the sums and estimates that a renderer keeps after a picture; they are more than the
    same splats take in shadows."""
    scene = ball_scene(captured_lights=named)
    scene.set_light("/sun", SUN)
    scene.set_light("/set", replace(dome(), is_on=False))
    scene.set_light("/lamp", replace(SUN, is_on=False))
    found = {}
    for mode in ("shadowed", "relit"):
        settings = settings_of(lighting=mode, self_shadows=True, dome_samples=4)
        renderer = Renderer(open_device())
        list(renderer.render(scene, view_from_above(), settings, ("color",)))
        store = renderer._idle[0].lights
        kept = [each[1] for each in (*store.sums.values(), *store.estimates.values())]
        bytes_kept = sum(int(np.prod(each.shape)) * 4 for each in kept)
        found[mode] = bytes_kept, lighting_bytes(scene, view_from_above(), settings, {"color"})
    more_kept = found["relit"][0] - found["shadowed"][0]
    assert more_kept >= 400 * 4 * 6
    assert found["relit"][1][0] - found["shadowed"][1][0] >= more_kept
    assert found["relit"][1][1] > found["shadowed"][1][1] or not named
