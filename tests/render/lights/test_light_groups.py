"""Tests of the AOVs of light: irradiance, and the parts of colours by light groups."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.render import everything
from tests.render.lights.light_scenes import add_splats, cloud_of
from tests.render.lights.test_shadows import SUN, WHITE, dimmed_scene, quad, view_from_above
from tests.render.rendering import lens, picture, random_cloud, settings_of, view_of
from tests.render.surface_scenes import add
from usdsplat.images.aovs import CAPTURED
from usdsplat.images.color import convert
from usdsplat.kernels.devices import open_device
from usdsplat.render.lights.dome import split
from usdsplat.render.lights.specs import LightSpec
from usdsplat.render.renderer import Renderer
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import SurfaceSpec

PARTS = ("light_key", "light_fill", CAPTURED)
NAMES = ("color", *PARTS, "irradiance")
SLANTED = (math.sin(0.5), 0.0, -math.cos(0.5))
KEY = replace(SUN, direction=SLANTED, irradiance=(2.0, 1.6, 1.2), group="light_key")
LAMP = np.eye(4)
LAMP[:3, 3] = 0.8, 0.4, 4.0
FILL = LightSpec(
    kind="sphere", to_world=tuple(LAMP.ravel()), size=(0.3, 0.0), radiance=(20.0, 30.0, 60.0),
    group="light_fill",
)  # fmt: skip
OPTIONS = {"light_samples": 3, "shadow_resolution": 64}
LINEAR = {"blend_space": "linear", "color_mode": "scene"}


def lit_scene(*lights, ground=True):
    """Splats in two layers over a mesh."""
    scene = dimmed_scene(lights=lights)
    if ground:
        add(scene, "/ground", quad(-0.5, (-3, -3), (3, 3), materials=WHITE))
    return scene


def total(found):
    """The sum of all parts."""
    return sum(found[name] for name in PARTS)


@pytest.mark.parametrize("lighting", ["captured", "shadowed", "relit"])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"sorting": "rayHitDistance"},
        {"samples": 2},
        {"self_shadows": True, "working_space": "lin_ap1_scene"},
        {"ambient": 0.0},
    ],
    ids=["plain", "rays", "samples", "ap1", "no ambient"],
)
def test_the_parts_add_up_to_the_colour(lighting, options):
    """Oracle: the beauty of the same picture, to 1e-5."""
    scene = lit_scene(KEY, FILL)
    found = picture(scene, view_from_above(), aovs=NAMES, lighting=lighting, **OPTIONS, **options)
    assert found["light_key"].max() > 0.1 and found["light_fill"].max() > 0.01
    np.testing.assert_allclose(total(found), found["color"][..., :3], atol=1e-5)


@pytest.mark.parametrize("lighting", ["captured", "shadowed", "relit"])
def test_the_colour_is_that_of_a_linear_picture_without_parts(lighting):
    """Oracle: the picture that is blended linearly, without AOVs of light. Light of several samples
    is summed in another order."""
    scene = lit_scene(KEY, FILL)
    options = {"lighting": lighting, **OPTIONS}
    parts = picture(scene, view_from_above(), aovs=NAMES, **options)
    alone = picture(scene, view_from_above(), aovs=("color",), **options, **LINEAR)
    np.testing.assert_allclose(parts["color"], alone["color"], atol=1e-6)


def test_a_picture_of_splats_that_keep_their_light_is_all_captured():
    """Oracle: the beauty, exactly; no light has a part of it."""
    scene = lit_scene(KEY, FILL, ground=False)
    found = picture(scene, view_from_above(), aovs=NAMES, **OPTIONS)
    np.testing.assert_array_equal(found[CAPTURED], found["color"][..., :3])
    assert not found["light_key"].any() and not found["light_fill"].any()


def test_without_lights_everything_is_captured_and_nothing_arrives():
    """Oracle: the beauty, in which the lamp at the eye lights surfaces."""
    found = picture(lit_scene(), view_from_above(), aovs=NAMES)
    np.testing.assert_array_equal(found[CAPTURED], found["color"][..., :3])
    assert found["color"][..., :3].any()
    assert not any(found[name].any() for name in ("light_key", "light_fill", "irradiance"))


def test_the_part_of_a_light_on_a_mesh_is_lamberts_law():
    """Oracle: albedo times E cos, for a light without shadows and another from above."""
    scene = add(RenderScene(), "/ground", quad(0.0, (-3, -3), (3, 3), materials=WHITE))
    scene.set_light("/key", KEY)
    scene.set_light("/top", replace(SUN, group="light_fill"))
    found = picture(scene, view_from_above(), aovs=NAMES)
    expected = math.cos(0.5) * np.array(KEY.irradiance)
    np.testing.assert_allclose(
        found["light_key"], np.broadcast_to(expected, (40, 60, 3)), rtol=1e-5
    )
    np.testing.assert_allclose(found["light_fill"], 1.0, rtol=1e-5)
    np.testing.assert_allclose(found[CAPTURED], 0.0, atol=1e-6)
    np.testing.assert_allclose(found["irradiance"][20, 30], 1 + expected, rtol=1e-5)


def test_the_parts_of_splats_are_those_of_the_formula():
    """Oracle: L E V / (E + A) and L A / (E + A) in NumPy, for splats that face up."""
    away = replace(KEY, direction=(-SLANTED[0], 0.0, SLANTED[2]), group="light_fill")
    scene = dimmed_scene(lights=(replace(SUN, group="light_key"), away))
    below = view_from_above(height=1.0)
    found = picture(scene, below, aovs=NAMES, lighting="shadowed", ambient=0.5)
    one, two = np.ones(3), math.cos(0.5) * np.array(KEY.irradiance)
    whole = one + two
    # the right half is not shadowed; A is a part of the mean, which one splat more hardly changes
    at = 20, 45
    mean = 0.5 * whole
    left = found["color"][at][3]
    color = left * convert(np.full(3, 0.8), "srgb_rec709_scene", "lin_rec709_scene")
    np.testing.assert_allclose(found["light_key"][at], color * one / (whole + mean), rtol=5e-3)
    np.testing.assert_allclose(found["light_fill"][at], color * two / (whole + mean), rtol=5e-3)
    np.testing.assert_allclose(found[CAPTURED][at], color * mean / (whole + mean), rtol=5e-3)


def test_a_light_twice_as_bright_has_twice_the_part():
    """Oracle: linearity of relit colours and of meshes; other parts do not change."""
    bright = replace(FILL, radiance=tuple(2 * each for each in FILL.radiance))
    options = {"aovs": NAMES, "lighting": "relit", "ambient": 0.0, **OPTIONS}
    dim = picture(lit_scene(KEY, FILL), view_from_above(), **options)
    lit = picture(lit_scene(KEY, bright), view_from_above(), **options)
    np.testing.assert_allclose(lit["light_fill"], 2 * dim["light_fill"], rtol=2e-5, atol=1e-6)
    np.testing.assert_allclose(lit["light_key"], dim["light_key"], rtol=2e-5, atol=1e-6)
    np.testing.assert_allclose(
        lit["color"][..., :3], dim["color"][..., :3] + dim["light_fill"], atol=1e-5
    )


def test_a_muted_light_takes_its_part_away():
    """Oracle: the beauty without its AOV; its own AOV is then black."""
    options = {"aovs": NAMES, "lighting": "relit", "ambient": 0.0, **OPTIONS}
    both = picture(lit_scene(KEY, FILL), view_from_above(), **options)
    alone = picture(lit_scene(KEY, replace(FILL, is_on=False)), view_from_above(), **options)
    expected = both["color"][..., :3] - both["light_fill"]
    np.testing.assert_allclose(alone["color"][..., :3], expected, atol=1e-5)
    assert not alone["light_fill"].any()


def test_lights_of_one_group_share_a_part():
    """Oracle: the sum of the parts that they have alone."""
    options = {"lighting": "shadowed", **OPTIONS}
    two = picture(lit_scene(KEY, FILL), view_from_above(), aovs=NAMES, **options)
    same = replace(FILL, group="light_key")
    one = picture(lit_scene(KEY, same), view_from_above(), aovs=("color", "light_key"), **options)
    np.testing.assert_allclose(one["light_key"], two["light_key"] + two["light_fill"], atol=1e-6)


def test_a_part_does_not_depend_on_which_others_are_drawn():
    """Oracle: the same picture with all parts, bit for bit."""
    options = {"lighting": "shadowed", **OPTIONS}
    every = picture(lit_scene(KEY, FILL), view_from_above(), aovs=NAMES, **options)
    for name in PARTS:
        one = picture(lit_scene(KEY, FILL), view_from_above(), aovs=(name,), **options)
        np.testing.assert_array_equal(one[name], every[name])


def test_irradiance_is_the_light_on_what_the_pixel_shows():
    """Oracle: E V of splats that face up, under a splat and not, in each mode of lighting."""
    scene, view = dimmed_scene(), view_from_above(height=1.0)
    expected = picture(scene, view, aovs=("shadow",), ambient=0.0)["shadow"]
    assert 0.1 < expected[20, 12, 0] < 0.8 and expected[20, 45, 0] > 0.999
    for lighting in ("captured", "shadowed", "relit"):
        both = picture(scene, view, aovs=("color", "irradiance"), lighting=lighting)
        found, shown = both["irradiance"], both["color"][20, :, 3:] > 0
        # the field faces up, so that E is 1
        np.testing.assert_allclose(found[20], expected[20] * shown, atol=1e-5)
        assert found[20, 12].min() > 0


def test_irradiance_is_in_the_working_space():
    """Oracle: conversion of the picture in Rec.709."""
    scene = lit_scene(KEY)
    found = picture(scene, view_from_above(), aovs=("irradiance",))["irradiance"]
    other = picture(scene, view_from_above(), aovs=("irradiance",), working_space="lin_ap1_scene")[
        "irradiance"
    ]
    expected = convert(found, "lin_rec709_scene", "lin_ap1_scene")
    np.testing.assert_allclose(other, expected, atol=1e-5)


def test_bands_threads_and_crops_do_not_change_aovs_of_light():
    """Oracle: the whole picture, bit for bit."""
    scene = lit_scene(KEY, FILL)
    options = {"aovs": NAMES, "lighting": "shadowed", **OPTIONS}
    whole = picture(scene, view_from_above(), **options)
    bands = picture(scene, view_from_above(), band_pixels=960, **options)
    one = picture(scene, view_from_above(), threads=1, **options)
    crop = picture(scene, view_from_above(window=(13, 5, 47, 33)), **options)
    for name in NAMES:
        np.testing.assert_array_equal(bands[name], whole[name])
        np.testing.assert_array_equal(one[name], whole[name])
        np.testing.assert_array_equal(crop[name], whole[name][5:33, 13:47])


def test_a_sky_a_matte_and_a_holdout_keep_the_sum():
    """Oracle: the beauty of the same picture."""
    rng = np.random.default_rng(2)
    sky = LightSpec(
        kind="dome", to_world=tuple(np.eye(4).ravel()), radiance=(1.0, 1.0, 1.0),
        sky=split(rng.uniform(0, 1, (16, 32, 3)).astype(np.float32))[0], group="light_fill",
    )  # fmt: skip
    scene = lit_scene(KEY, sky)
    view = replace(view_from_above(), matte=(("/above", True),), catchers=(("/ground", True),))
    options = {"lighting": "shadowed", "dome_samples": 4, **OPTIONS}
    found = picture(
        scene, view, aovs=NAMES, **options,
        holdout=lambda x0, y0, x1, y1: np.float32(
            np.where(np.arange(x0, x1) < 20, 3.0, np.inf) * np.ones((y1 - y0, 1))
        ),
    )  # fmt: skip
    np.testing.assert_allclose(total(found), found["color"][..., :3], atol=1e-5)
    assert found["light_fill"].any()


def test_turned_primaries_and_instances_keep_the_sum():
    """Oracle: the beauty; a field with two instances, harmonics and new light in ACEScg."""
    scene = RenderScene()
    cloud = random_cloud(3)
    normals = np.tile(np.float32([0, 0, 1]), (len(cloud), 1))
    add_splats(scene, "/one", cloud, surface=SurfaceSpec(normals=normals))
    add_splats(scene, "/two", random_cloud(4), lighting="relit")
    scene.set_light("/key", KEY)
    scene.set_light("/fill", FILL)
    found = picture(
        scene, view_of(lens()), aovs=NAMES, lighting="shadowed", working_space="lin_ap1_scene",
        splat_budget=300, **OPTIONS,
    )  # fmt: skip
    np.testing.assert_allclose(total(found), found["color"][..., :3], atol=1e-5)


def test_light_is_kept_between_pictures_and_an_edit_is_seen():
    """Oracle: a fresh renderer, bit for bit."""
    scene, options = lit_scene(KEY, FILL), settings_of(lighting="shadowed", **OPTIONS)
    renderer = Renderer(open_device())

    def drawn(by):
        (band,) = by.render(scene, view_from_above(), options, NAMES)
        return {name: array.copy() for name, array in band.arrays.items()}

    first, second = drawn(renderer), drawn(renderer)
    scene.set_light("/light0", replace(KEY, irradiance=(0.5, 0.5, 2.0)))
    edited, fresh = drawn(renderer), drawn(Renderer(open_device()))
    for name in NAMES:
        np.testing.assert_array_equal(first[name], second[name])
        np.testing.assert_array_equal(edited[name], fresh[name])
    assert not np.array_equal(first["light_key"], edited["light_key"])


def test_a_single_splat_without_confidence_has_the_mean_over_directions():
    """Oracle: a quarter of the light, MEAN_COSINE, as irradiance."""
    up = np.float32([[0, 0, 1]])
    surface = SurfaceSpec(normals=up, confidence=np.zeros(1, np.float32))
    scene = add_splats(RenderScene(), "/one", cloud_of([[0, 0, 0]], 0.4, 0.9), surface=surface)
    scene.set_light("/sun", SUN)
    found = picture(scene, view_from_above(), aovs=("irradiance",))["irradiance"]
    np.testing.assert_allclose(found[20, 30], 0.25, rtol=1e-5)
    assert not found[0, 0].any()


def test_a_field_that_keeps_its_light_is_captured_beside_a_lit_one():
    """Oracle: the beauty, and the captured part of the picture in which nothing else is drawn."""
    scene = dimmed_scene(lights=(KEY,))
    kept = cloud_of([[0.8, 0.0, 0.5]], (0.3, 0.3, 0.3), 0.999, grey=0.6)
    add_splats(scene, "/kept", kept, lighting="captured")
    view = view_from_above(height=1.0)
    found = picture(scene, view, aovs=NAMES, lighting="shadowed", **OPTIONS)
    np.testing.assert_allclose(total(found), found["color"][..., :3], atol=1e-5)
    alone = picture(add_splats(RenderScene(), "/kept", kept), view, aovs=("color",), **LINEAR)
    at = 20, 40
    assert alone["color"][at][3] > 0.99
    np.testing.assert_allclose(found[CAPTURED][at], alone["color"][at][:3], atol=5e-3)
    assert found["light_key"][at].max() < 5e-3 < found["light_key"].max()


@pytest.mark.parametrize("name", ["light groups", "light groups and samples"])
def test_parts_of_trees_blur_and_textures_add_up(name):
    """Oracle: the beauty of the scene with every feature, a splat tree among them."""
    case = everything.CASES[name]
    found = everything.drawn(open_device(), case, size=(64, 48), splats=120)
    parts = [found[each] for each in case.aovs if each.startswith("light_")]
    assert len(parts) == 3 and all(each.any() for each in parts)
    np.testing.assert_allclose(sum(parts), found["color"][..., :3], atol=2e-5)
