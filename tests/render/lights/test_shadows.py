"""Tests of shadows: closed forms at points, and pictures."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.render.lights.light_scenes import UP, add_splats, cloud_of, light_at
from tests.render.rendering import picture, random_cloud, settings_of
from tests.render.surface_scenes import add, mesh
from usdsplat.images.color import convert
from usdsplat.kernels.devices import open_device
from usdsplat.render.lights.specs import LightSpec
from usdsplat.render.renderer import Renderer
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import (
    CameraSpec,
    CropSpec,
    Framing,
    InstanceSpec,
    MaterialSpec,
    SurfaceSpec,
    View,
)

SUN = LightSpec(direction=(0.0, 0.0, -1.0), irradiance=(1.0, 1.0, 1.0))
AOVS = ("color", "shadow", "depth")
WHITE = (MaterialSpec(diffuse=(1.0, 1.0, 1.0)),)


def quad(z, low, high, **options):
    """A horizontal rectangle that faces up."""
    (x0, y0), (x1, y1) = low, high
    points = [[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]]
    return mesh(points, [[0, 1, 2], [0, 2, 3]], **options)


def view_from_above(size=(60, 40), *, half=1.5, height=10.0, window=None):
    """An orthographic camera that looks down; x is right and y up in its pictures."""
    matrix = np.eye(4)
    matrix[2, 3] = -height
    x = half * size[0] / size[1]
    camera = CameraSpec(
        world_to_camera=tuple(matrix.ravel()), orthographic=True, window=(-x, -half, x, half),
        clipping_range=(0.01, 100.0),
    )  # fmt: skip
    return View(camera=camera, framing=Framing(resolution=size, data_window=window))


def crossing(x, y, level):
    """The first place where a rising curve reaches a level."""
    i = int(np.argmax(y >= level))
    return np.interp(level, y[i - 1 : i + 1], x[i - 1 : i + 1])


def seen_of_half_plane(distance):
    """Visible part of a disc of radius 1 behind an edge at a distance from its centre."""
    d = np.clip(distance, -1, 1)
    return (np.arccos(-d) + d * np.sqrt(1 - d * d)) / math.pi


@pytest.mark.parametrize("degrees", [0.5, 2.0, 10.0])
def test_the_penumbra_of_a_box_has_the_width_of_the_closed_form(degrees):
    """Oracle: the visible part of a disc behind a straight edge; 10 to 90 %, within 2 %, with 64
    pixels across the penumbra."""
    height, radius = 1.0, math.tan(math.radians(degrees / 2))
    scene = add(RenderScene(), "/ground", quad(0.0, (-0.4, -0.2), (0.4, 0.2)))
    add(scene, "/roof", quad(height, (-0.4, -0.2), (0.0, 0.2)))
    light = replace(SUN, angle=math.radians(degrees))
    x = np.linspace(-1.5 * radius, 1.5 * radius, 601)
    points = np.stack([x, 0 * x, 0 * x], axis=1)
    resolution = int(64 * 0.8 / (2 * radius)) + 1
    found = light_at(scene, light, points, UP, samples=256, resolution=max(256, resolution))
    seen = found[:, 0] / found[:, 3]
    expected = seen_of_half_plane(x / radius)
    widths = [crossing(x, each, 0.9) - crossing(x, each, 0.1) for each in (seen, expected)]
    assert widths[0] == pytest.approx(widths[1], rel=0.02)
    assert np.abs(seen - expected).mean() < 0.01


@pytest.mark.parametrize("degrees", [1.0, 10.0])
def test_the_penumbra_of_a_splat_over_a_plane_is_its_footprint_convolved_with_the_sun(degrees):
    """Oracle: the mean of 1 - opacity · Gaussian over the disc of the light, in NumPy."""
    height, sigma = 2.0, 0.05
    cloud = cloud_of([[0, 0, height]], (sigma, sigma, 1e-4), 0.9)
    scene = add_splats(RenderScene(), "/one", cloud)
    add(scene, "/ground", quad(0.0, (-1, -1), (1, 1)))
    radius = height * math.tan(math.radians(degrees / 2))
    x = np.linspace(-0.5, 0.5, 101)
    points = np.stack([x, 0 * x, 0 * x], axis=1)
    light = replace(SUN, angle=math.radians(degrees))
    found = light_at(scene, light, points, UP, samples=256)
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 201)] * 2), axis=-1).reshape(-1, 2)
    disc = radius * grid[(grid**2).sum(axis=1) <= 1]
    square = (x[:, None] - disc[None, :, 0]) ** 2 + disc[None, :, 1] ** 2
    alpha = 0.9 * np.exp(-0.5 * square / sigma**2)
    alpha[alpha < 1 / 255] = 0
    expected = 1 - alpha.mean(axis=1)
    np.testing.assert_allclose(found[:, 0] / found[:, 3], expected, atol=6e-3)


@pytest.mark.parametrize("kind", ["distant", "point"])
def test_a_plane_does_not_shadow_itself(kind):
    """Oracle: 1, exactly, at any slope that the light can see."""
    matrix = np.eye(4)
    matrix[2, 3] = 3.0
    point = LightSpec(
        kind="sphere", is_point=True, to_world=tuple(matrix.ravel()), size=(0.1, 0.0),
        radiance=(1.0, 1.0, 1.0),
    )  # fmt: skip
    points = np.random.default_rng(0).uniform(-0.9, 0.9, (500, 3)) * [1, 1, 0]
    for tilt in (0.0, 0.7, 1.4, 1.52):
        turn = np.eye(4)
        turn[:3, :3] = [
            [math.cos(tilt), 0, math.sin(tilt)], [0, 1, 0], [-math.sin(tilt), 0, math.cos(tilt)],
        ]  # fmt: skip
        scene = add(RenderScene(), "/plane", quad(0.0, (-1, -1), (1, 1)), turn)
        light = SUN if kind == "distant" else point
        places, normal = points @ turn[:3, :3].T, turn[:3, :3] @ UP
        found = light_at(scene, light, places, normal, resolution=300)
        lit = found[:, 3] > 0
        assert lit.sum() > 100
        np.testing.assert_allclose(found[lit, 0] / found[lit, 3], 1.0, atol=1e-6)


def test_a_closed_sphere_of_splats_is_lit_by_lamberts_law_in_front_and_not_at_all_behind():
    """Oracle: max(0, n · l); the contract's 1 % where no terminator is near."""
    n = 6000
    i = np.arange(n)
    z = 1 - (2 * i + 1) / n
    angle = i * math.pi * (3 - math.sqrt(5))
    normals = np.stack([*(np.sqrt(1 - z * z) * [np.cos(angle), np.sin(angle)]), z], axis=1)
    # the rotation from z to the normal: half way between them
    quaternions = np.stack([1 + z, -normals[:, 1], normals[:, 0], 0 * z], axis=1)
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    spacing = math.sqrt(4 * math.pi / n)
    cloud = cloud_of(normals, (spacing, spacing, 0.1 * spacing), 0.9, rotations=quaternions)
    scene = add_splats(RenderScene(), "/ball", cloud)
    size = spacing * np.sqrt(np.clip(1 - z * z + 0.01 * z * z, 0, 1))
    shapes = np.zeros((n, 6))
    shapes[:, 5] = size**2
    # without the cosine, to see the transmittance of splats that face away
    found = light_at(scene, SUN, normals, UP, shapes=shapes)
    seen = found[:, 0] / found[:, 3]
    front, behind = z > 0.15, z < -0.15
    error = np.abs(seen[front] * z[front] - z[front])
    assert error.max() < 0.01 and seen[behind].max() < 0.01


# --- pictures ------------------------------------------------------------------------------


def dimmed_scene(*, lights=(SUN,)):
    """A field that faces up, under a smaller one above its left half."""
    side = (np.arange(24) + 0.5) / 8 - 1.5
    places = np.stack([*(each.ravel() for each in np.meshgrid(side, side)), np.zeros(576)], axis=1)
    flat = cloud_of(places, (0.1, 0.1, 1e-3), 0.9, grey=0.8)
    up = SurfaceSpec(normals=np.tile(np.float32([0, 0, 1]), (576, 1)))
    scene = add_splats(RenderScene(), "/flat", flat, surface=up)
    above = cloud_of([[-2.0, 0, 3.0]], (0.6, 0.6, 1e-3), 0.999)
    add_splats(scene, "/above", above)
    for k, light in enumerate(lights):
        scene.set_light(f"/light{k}", light)
    return scene


def test_splats_are_dimmed_by_the_formula_in_linear_light():
    """Oracle: L · (E V + A) / (E + A) with A = 0.2 E; the captured picture, decoded, and the AOV of
    the ratio."""
    scene, view = dimmed_scene(), view_from_above(height=1.0)
    plain = picture(scene, view, aovs=AOVS)
    lit = picture(scene, view, aovs=AOVS, lighting="shadowed")
    # one soft caster dims all channels, so neighbours of a pixel have nearly the same ratio
    plain["color"][..., 3] = np.maximum(plain["color"][..., 3], 1e-6)
    lit["color"][..., 3] = np.maximum(lit["color"][..., 3], 1e-6)
    before, after = (
        convert(each["color"][..., :3] / each["color"][..., 3:], "srgb_rec709_scene",
                "lin_rec709_scene")
        for each in (plain, lit)
    )  # fmt: skip
    ratio, full = lit["shadow"], plain["color"][..., 3] > 0.5
    np.testing.assert_allclose(after[full] / before[full], ratio[full], atol=0.01)
    np.testing.assert_array_equal(plain["shadow"], ratio)
    assert ratio[20, 40].min() > 0.99
    # at the field's left edge, 0.56 from the middle of the caster
    seen = 1 - 0.999 * math.exp(-0.5 * (0.5625 / 0.6) ** 2)
    assert ratio[full].min() == pytest.approx((seen + 0.2) / 1.2, abs=0.03)


def test_without_lights_or_in_captured_mode_pictures_of_splats_are_those_of_before():
    """Oracle: the picture of a scene without lights, bit for bit."""
    view = view_from_above(height=9.0)
    rect = LightSpec(
        kind="rect", size=(1.0, 1.0), to_world=tuple(np.eye(4).ravel()), radiance=(9.0,) * 3
    )
    before = picture(dimmed_scene(lights=()), view, aovs=("color",))
    for lights, mode in (((), "shadowed"), ((SUN, rect), "captured")):
        found = picture(dimmed_scene(lights=lights), view, aovs=("color",), lighting=mode)
        np.testing.assert_array_equal(found["color"], before["color"])


def whole_scene():
    """Splats and meshes under a sun and a lamp."""
    scene = dimmed_scene(lights=(replace(SUN, direction=(0.6, 0.0, -0.8), angle=0.1),))
    add_splats(scene, "/more", random_cloud(3, n=200), np.diag([0.5, 0.5, 0.5, 1.0]))
    add(scene, "/ground", quad(-0.4, (-2, -1.2), (2, 1.2), materials=WHITE))
    add(scene, "/roof", quad(0.8, (0.2, -0.5), (0.9, 0.6), materials=WHITE))
    matrix = np.eye(4)
    matrix[:3, 3] = 0.5, 0.3, 2.0
    lamp = LightSpec(
        kind="disk", size=(0.3, 0.0), to_world=tuple(matrix.ravel()), radiance=(9.0, 6.0, 3.0)
    )
    scene.set_light("/lamp", lamp)
    return scene


OPTIONS = {"lighting": "shadowed", "light_samples": 4, "shadow_resolution": 256}


def test_bands_crops_and_threads_show_the_same_shadows():
    """Oracle: the whole picture, bit for bit."""
    scene = whole_scene()
    whole = picture(scene, view_from_above(), aovs=AOVS, **OPTIONS)
    bands = picture(scene, view_from_above(), aovs=AOVS, band_pixels=960, **OPTIONS)
    one = picture(scene, view_from_above(), aovs=AOVS, threads=1, **OPTIONS)
    window = (13, 5, 47, 33)
    crop = picture(scene, view_from_above(window=window), aovs=AOVS, **OPTIONS)
    for name in AOVS:
        np.testing.assert_array_equal(bands[name], whole[name], err_msg=name)
        np.testing.assert_array_equal(one[name], whole[name], err_msg=name)
        np.testing.assert_array_equal(crop[name], whole[name][5:33, 13:47], err_msg=name)
    assert whole["shadow"].min() < 0.4


def test_what_is_kept_between_pictures_changes_nothing():
    """Oracle: a new renderer's picture after each edit, bit for bit."""
    scene, renderer = whole_scene(), Renderer(open_device())
    settings = settings_of(**OPTIONS)

    def drawn(by):
        bands = by.render(scene, view_from_above(), settings, AOVS)
        return [{name: array.copy() for name, array in band.arrays.items()} for band in bands]

    matrix = np.eye(4)
    matrix[0, 3] = 0.4

    def move(path):
        scene.set_instances(path, (InstanceSpec(path=path, transform=tuple(matrix.ravel())),))

    edits = [
        lambda: None,
        lambda: move("/above"),
        lambda: move("/roof"),
        lambda: move("/flat"),
        lambda: scene.set_light("/light0", replace(SUN, irradiance=(0.1, 0.2, 0.3))),
        lambda: scene.set_light("/lamp", None),
        lambda: scene.set_visible("/above", False),
        lambda: scene.set_crops("/more", (box_crop(),)),
        lambda: scene.set_light("/light0", None),
    ]
    before = None
    for k, edit in enumerate(edits):
        edit()
        found, fresh = drawn(renderer), drawn(Renderer(open_device()))
        for a, b in zip(found, fresh, strict=True):
            for name in AOVS:
                np.testing.assert_array_equal(a[name], b[name], err_msg=f"{k} {name}")
        if before is not None:
            pairs = zip(found, before, strict=True)
            assert any(not np.array_equal(a["color"], b["color"]) for a, b in pairs)
        before = found if k else None


def box_crop():
    """A volume that removes half of a field."""
    matrix = np.eye(4)
    matrix[0, 3] = -1.0
    return CropSpec(shape="cube", world_to_shape=tuple(matrix.ravel()), keeps=False)


def test_surfaces_are_lit_by_all_kinds_of_lights_and_shadowed_like_splats():
    """Oracle: a white plane under a rect: E / π of the light's samples, and A = 0.2 E in its
    umbra."""
    matrix = np.eye(4)
    matrix[2, 3] = 3.0
    light = LightSpec(
        kind="rect", size=(0.4, 0.4), to_world=tuple(matrix.ravel()), radiance=(3.0, 2.0, 1.0)
    )
    scene = add(RenderScene(), "/ground", quad(0.0, (-3, -3), (3, 3), materials=WHITE))
    scene.set_light("/lamp", light)
    view = view_from_above(height=2.0)
    options = {"color_mode": "scene", "aovs": ("color", "P")}
    lit = picture(scene, view, lighting="captured", **options)
    points = lit["P"].reshape(-1, 3)
    expected = light_at(scene, light, points, UP)[:, 3:].reshape(lit["P"].shape)
    np.testing.assert_allclose(lit["color"][..., :3], expected, rtol=2e-3)
    add(scene, "/roof", quad(2.5, (-0.5, -0.5), (0.5, 0.5), materials=WHITE))
    dark = picture(scene, view, lighting="shadowed", **options)
    np.testing.assert_allclose(dark["color"][20, 30, :3], lit["color"][20, 30, :3] / 6, rtol=2e-3)


# --- who casts, who receives ----------------------------------------------------------------


def test_a_field_does_not_shadow_itself_unless_asked():
    """Oracle: 1 without, less with the knob."""
    places = np.array([[0, 0, 0.0], [0, 0, 1.0]])
    cloud = cloud_of(places, (0.5, 0.5, 1e-3), 0.9)
    up = SurfaceSpec(normals=np.tile(np.float32([0, 0, 1]), (2, 1)))
    scene = add_splats(RenderScene(), "/both", cloud, surface=up)
    scene.set_light("/sun", SUN)
    view = view_from_above(height=0.5)
    found = picture(scene, view, aovs=("shadow",))
    np.testing.assert_allclose(found["shadow"], 1.0, atol=1e-5)
    found = picture(scene, view, aovs=("shadow",), self_shadows=True)
    assert found["shadow"][20, 30, 0] == pytest.approx((0.1 + 0.2) / 1.2, abs=0.01)


def test_links_say_what_a_light_reaches_and_what_casts():
    """Oracle: the same picture without the light, or without the caster."""
    view = view_from_above(height=1.0)

    def ratio(**options):
        scene = dimmed_scene(lights=(replace(SUN, **options),))
        return picture(scene, view, aovs=("shadow",))["shadow"]

    assert ratio().min() < 0.5
    np.testing.assert_allclose(ratio(linked=(("/", True), ("/flat", False))), 1.0, atol=1e-5)
    np.testing.assert_allclose(ratio(casters=(("/flat", True),)), 1.0, atol=1e-5)
    np.testing.assert_array_equal(ratio(casters=(("/above", True),)), ratio())


def test_the_mode_of_a_field_overrides_that_of_the_picture():
    """Oracle: the pictures of both modes."""
    view = view_from_above(height=1.0)
    plain = picture(dimmed_scene(), view, aovs=("color",))["color"]
    lit = picture(dimmed_scene(), view, aovs=("color",), lighting="shadowed")["color"]
    assert not np.array_equal(plain, lit)
    for own, asked, expected in (("captured", "shadowed", plain), ("shadowed", "captured", lit)):
        scene = dimmed_scene()
        flat = next(field for path, field, _ in scene.drawn() if path == "/flat")
        scene.set_field("/flat", replace(flat.spec, lighting=own))
        found = picture(scene, view, aovs=("color",), lighting=asked)["color"]
        np.testing.assert_array_equal(found, expected)


def test_rules_of_the_picture_choose_the_mode_of_prims():
    """Oracle: the pictures of both modes; the first rules that hold the prim decide, and its own
    mode comes before them."""
    view = view_from_above(height=1.0)
    plain = picture(dimmed_scene(), view, aovs=("color",))["color"]
    lit = picture(dimmed_scene(), view, aovs=("color",), lighting="shadowed")["color"]
    captured, shadowed = ("captured", (("/flat", True),)), ("shadowed", (("/", True),))
    for rules, own, expected in (
        ((shadowed,), "auto", lit),
        ((captured, shadowed), "auto", plain),
        ((shadowed, captured), "auto", lit),
        ((shadowed,), "captured", plain),
        ((captured,), "shadowed", lit),
        ((("shadowed", (("/", True), ("/flat", False))),), "auto", plain),
    ):
        scene = dimmed_scene()
        flat = next(field for path, field, _ in scene.drawn() if path == "/flat")
        scene.set_field("/flat", replace(flat.spec, lighting=own))
        ruled = replace(view, light_rules=rules)
        np.testing.assert_array_equal(picture(scene, ruled, aovs=("color",))["color"], expected)


@pytest.mark.parametrize("kind", ["mesh", "field"])
@pytest.mark.parametrize("by", ["view", "prim"])
def test_a_catcher_is_not_in_the_picture_and_its_shadow_is(kind, by):
    """Oracle: alpha 0, and the ratio that it has when it is drawn."""
    scene = RenderScene()
    is_own = by == "prim"
    if kind == "mesh":
        add(scene, "/flat", quad(0.0, (-3, -3), (3, 3), materials=WHITE, is_catcher=is_own))
    else:
        flat = dimmed_scene().visible_fields()[0].spec
        add_splats(scene, "/flat", flat.cloud, surface=flat.surface, is_catcher=is_own)
    above = cloud_of([[-0.8, 0, 3.0]], (0.4, 0.4, 1e-3), 0.999)
    add_splats(scene, "/above", above)
    scene.set_light("/sun", SUN)
    view = view_from_above(height=1.0)
    if by == "view":
        view = replace(view, catchers=(("/flat", True),))
    found = picture(scene, view, aovs=("color", "shadow"), lighting="shadowed")
    assert not found["color"].any()
    assert found["shadow"].min() == pytest.approx(0.2 / 1.2, abs=0.06)
    assert found["shadow"][20, 55].min() > 0.999
    # seen through a half transparent object, the plate has the same shadow
    add_splats(scene, "/glass", cloud_of([[-0.8, 0, 0.5]], (3.0, 3.0, 1e-3), 0.5))
    through = picture(scene, view, aovs=("color", "shadow"), lighting="shadowed")
    assert 0.4 < through["color"][20, 15, 3] < 0.6
    assert through["shadow"][20, 20].max() < 0.4
