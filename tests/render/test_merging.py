"""Tests of splats between surfaces and holdouts: which hide which, per splat and per pixel."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from tests.render.rendering import (
    lens,
    picture,
    random_cloud,
    random_transform,
    scene_of,
    view_of,
)
from tests.render.surface_scenes import add, mesh, sphere
from usdsplat.images.exr import ExrWriter
from usdsplat.images.holdout import open_holdout
from usdsplat.images.holdout_nodes import nodes_of
from usdsplat.images.layout import ImageLayout
from usdsplat.kernels import reference, reference_rays

OIIOTOOL = str(Path(sys.executable).with_name("oiiotool"))
SIZE = (72, 52)
SLOPE = (0.3, -0.2)
"""Of the plane z = 4 + 0.3 x - 0.2 y, in the lens' camera space."""
CENTER, RADIUS = np.array([0.1, 0.05, 4.0]), 0.9
LINEAR = {"blend_space": "linear", "color_mode": "scene"}
COLORS = np.float32([0.6, 0.3, 0.1])


def small(model="perspective"):
    """A smaller picture than the usual, as all is compared with everything at all pixels."""
    focal = (10.0, 11.0) if model == "orthographic" else (58.0, 62.0)
    return replace(lens(model), size=SIZE, focal=focal, center=(34.0, 28.0))


def cloud(seed):
    return random_cloud(seed, n=120, degree=1)


def mesh_of(kind):
    """A plane or a ball amid the cloud; the world is the lens' camera space, 4 nearer."""
    if kind == "plane":
        x, y = np.array([-7.0, 7, 7, -7]), np.array([-7.0, -7, 7, 7])
        points, triangles = np.stack([x, y, SLOPE[0] * x + SLOPE[1] * y], 1), [[0, 1, 2], [0, 2, 3]]
    else:
        points, triangles = sphere(512, 256)
        points = RADIUS * points + CENTER - (0, 0, 4)
    made = mesh(points, triangles)
    return replace(made, colors=np.broadcast_to(COLORS, (len(made.triangles), 3, 3)).copy())


def depth_of(kind, eye):
    """Where each pixel's ray meets it, +inf where it does not, in closed form."""
    u = (np.arange(SIZE[0]) + 0.5 - eye.center[0]) / eye.focal[0]
    v = (np.arange(SIZE[1]) + 0.5 - eye.center[1]) / eye.focal[1]
    u, v = np.meshgrid(u, v)
    parallel = eye.model == "orthographic"
    if kind == "plane":
        rise = SLOPE[0] * u + SLOPE[1] * v
        return 4.0 + rise if parallel else 4.0 / (1.0 - rise)
    if parallel:
        square = RADIUS**2 - (u - CENTER[0]) ** 2 - (v - CENTER[1]) ** 2
        return np.where(square > 0, CENTER[2] - np.sqrt(np.maximum(square, 0)), np.inf)
    ray = np.stack([u, v, np.ones_like(u)], axis=-1)
    a, b = (ray * ray).sum(-1), ray @ CENTER
    square = b * b - a * (CENTER @ CENTER - RADIUS**2)
    return np.where(square > 0, (b - np.sqrt(np.maximum(square, 0))) / a, np.inf)


def psnr(found, expected):
    return -10.0 * np.log10(np.mean((found - expected) ** 2) + 1e-30)


def decided(seen, eye, stops):
    """Pixels where no ray hit lies within float32's reach of the surface, nor an outline
    passes: elsewhere either answer is right."""
    ray_hits, alphas = reference_rays.ray_hit_depths(seen, eye), reference_rays.alphas(seen, eye)
    close = ((np.abs(ray_hits - stops) < 2e-4) & (alphas > 0)).any(axis=0)
    hit = np.isfinite(stops)
    outline = np.zeros_like(hit)
    for axis in (0, 1):
        for step in (-1, 1):
            outline |= hit != np.roll(hit, step, axis)
    return ~(close | outline)


@pytest.mark.parametrize("sorting", ["zDepth", "rayHitDistance"])
@pytest.mark.parametrize("model", ["perspective", "tangential", "orthographic"])
@pytest.mark.parametrize("kind", ["plane", "ball"])
def test_splats_are_hidden_where_they_peak_behind_a_surface(kind, model, sorting) -> None:
    """One by one, at each pixel's own ray, and what is left goes over the surface. Oracle: the
    float64 reference with the surface's depth in closed form, >= 60 dB."""
    eye = small(model)
    parts = [(cloud(1), np.eye(4)), (cloud(2), random_transform(3))]
    mode = "tangential" if model == "tangential" else "perspective"
    scene = add(scene_of(*parts, projection_mode=mode), "/mesh", mesh_of(kind))
    bare = picture(add(scene_of(), "/mesh", mesh_of(kind)), view_of(eye), aovs=("color",))
    found = picture(scene, view_of(eye), sorting=sorting, aovs=("color", "depth"))
    seen, stops = reference.footprints(parts, eye), depth_of(kind, eye)
    rays = reference_rays.trace(
        seen, eye, sort_by_ray_hit=sorting == "rayHitDistance", occluder_depth=stops
    )
    expected = rays.color + rays.through[..., None] * bare["color"]
    sure = decided(seen, eye, stops)
    assert sure.mean() > 0.8
    assert psnr(found["color"][sure], expected[sure]) > 60
    through = reference_rays.trace(seen, eye, sort_by_ray_hit=sorting == "rayHitDistance")
    assert psnr(found["color"][sure], through.color[sure]) < 40  # it matters here
    assert (found["depth"] <= stops * (1 + 1e-4))[sure].all()
    assert (found["depth"] >= eye.near).all()


def test_matte_things_hide_and_are_not_there() -> None:
    """Oracle: the float64 reference, with weights of 0 for what holds out, >= 60 dB."""
    eye = small()
    parts = [(cloud(1), np.eye(4)), (cloud(2), random_transform(3))]
    scene = add(scene_of(*parts), "/mesh", mesh_of("ball"))
    view = replace(view_of(eye), matte=(("/mesh", True), ("/field1", True)))
    seen, stops = reference.footprints(parts, eye), depth_of("ball", eye)
    keeps = (seen.row < len(parts[0][0])).astype(np.float64)
    sure = decided(seen, eye, stops)
    for sorting in ("zDepth", "rayHitDistance"):
        found = picture(scene, view, sorting=sorting, aovs=("color",))["color"]
        by_ray_hit = sorting == "rayHitDistance"
        rays = reference_rays.trace(
            seen, eye, sort_by_ray_hit=by_ray_hit, occluder_depth=stops, keeps=keeps
        )
        assert psnr(found[sure], rays.color[sure]) > 60


def write(path, pixels, name="color"):
    layout = ImageLayout(resolution=SIZE, aovs=(name,), pixel_type="float")
    with ExrWriter(path, layout) as writer:
        writer.write_band(0, {name: pixels})


def read(path):
    image = oiio.ImageBuf(str(path))
    return image.get_pixels(oiio.FLOAT)


def oiiotool(*arguments) -> None:
    run = subprocess.run([OIIOTOOL, *map(str, arguments)], capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr


@pytest.mark.parametrize("sorting", ["zDepth", "rayHitDistance"])
def test_what_was_rendered_apart_merges_to_the_whole(tmp_path, sorting) -> None:
    """The matte render over the object alone, or plus the object held out by the splats, is the
    picture of both. Oracle: oiiotool's --over and --add on our EXRs, to 1e-3."""
    scene = add(scene_of((cloud(1), np.eye(4))), "/mesh", mesh_of("ball"))
    view = view_of(small())

    def shot(name, *matte, hide=()):
        for path in ("/field0", "/mesh"):
            scene.set_visible(path, path not in hide)
        held = replace(view, matte=tuple((path, True) for path in matte))
        pixels = picture(scene, held, aovs=("color",), sorting=sorting, **LINEAR)["color"]
        write(tmp_path / f"{name}.exr", pixels)
        return pixels

    both = shot("both")
    shot("splats", "/mesh")
    shot("object", hide=("/field0",))
    shot("held", "/field0")
    paths = {name: tmp_path / f"{name}.exr" for name in ("splats", "object", "held")}
    oiiotool(paths["splats"], paths["object"], "--over", "-o", tmp_path / "over.exr")
    oiiotool(paths["splats"], paths["held"], "--add", "-o", tmp_path / "add.exr")
    assert np.abs(read(tmp_path / "over.exr") - both).max() < 1e-3
    assert np.abs(read(tmp_path / "add.exr") - both).max() < 1e-3


@pytest.mark.parametrize("sorting", ["zDepth", "cameraDistance", "rayHitDistance"])
def test_two_captures_that_hold_each_other_out_add_to_both(sorting) -> None:
    """Oracle: addition: every contribution is in exactly one of the two pictures."""
    parts = [(cloud(1), np.eye(4)), (cloud(2), np.eye(4))]
    scene, view = scene_of(*parts), view_of(small())

    def shot(*matte):
        held = replace(view, matte=tuple((path, True) for path in matte))
        return picture(scene, held, aovs=("color",), sorting=sorting, **LINEAR)["color"]

    np.testing.assert_allclose(shot("/field0") + shot("/field1"), shot(), atol=1e-5)


def test_a_flat_holdout_is_a_matte_mesh(tmp_path) -> None:
    """Through an EXR of its depth. Oracle: the same mesh in the scene, matte."""
    view, aovs = view_of(small()), ("color", "depth", "elementId", "cryptoObject", "Neye")
    alone = picture(add(scene_of(), "/mesh", mesh_of("ball")), view, aovs=("depth",))["depth"]
    write(tmp_path / "z.exr", alone, "Z")
    holdout = open_holdout(tmp_path / "z.exr", resolution=SIZE)
    parts = [(cloud(1), np.eye(4))]
    for sorting in ("zDepth", "rayHitDistance"):
        options = {"aovs": aovs, "sorting": sorting}
        held = picture(
            scene_of(*parts), view, holdout=holdout.rows, band_pixels=SIZE[0] * 32, **options
        )
        scene = add(scene_of(*parts), "/mesh", mesh_of("ball"))
        matte = picture(scene, replace(view, matte=(("/mesh", True),)), **options)
        for name in aovs:
            np.testing.assert_allclose(held[name], matte[name], atol=1e-6, err_msg=name)


def deep_samples(seed, extent):
    """Random deep samples, of which two thirds have an extent: pixel, front, back, alpha."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 4, SIZE[::-1])
    pixel = np.repeat(np.arange(counts.size), counts.ravel())
    front = rng.uniform(2.5, 5.5, len(pixel)).astype(np.float32)
    back = front + np.float32(extent) * (np.arange(len(pixel)) % 3 > 0).astype(np.float32)
    return pixel, front, back, rng.uniform(0.1, 1, len(pixel)).astype(np.float32)


@pytest.mark.parametrize("sorting", ["zDepth", "rayHitDistance"])
@pytest.mark.parametrize("extent", [0, 1.5])
def test_a_deep_holdout_dims_what_is_behind_or_within_a_sample(sorting, extent) -> None:
    """Splats and surfaces alike. Oracle: products over all samples, in NumPy, >= 60 dB."""
    eye, parts = small(), [(cloud(1), np.eye(4))]
    pixel, front, back, alpha = deep_samples(4, extent)
    offsets = np.searchsorted(pixel, np.arange(SIZE[0] * SIZE[1] + 1))
    rows = nodes_of(offsets, front, back, alpha)
    scene = add(scene_of(*parts), "/mesh", mesh_of("ball"))

    def holdout(x0, y0, x1, y1):
        assert (x0, y0, x1, y1) == (0, 0, *SIZE)
        return rows

    found = picture(scene, view_of(eye), holdout=holdout, sorting=sorting, aovs=("color",))["color"]
    bare = picture(add(scene_of(), "/mesh", mesh_of("ball")), view_of(eye), aovs=("color",))
    seen, stops = reference.footprints(parts, eye), depth_of("ball", eye)
    rays = reference_rays.trace(
        seen, eye, sort_by_ray_hit=sorting == "rayHitDistance", occluder_depth=stops
    )

    def held(at):
        """What the samples let through in front of `at`, shape (..., h, w)."""
        flat = at.reshape(*at.shape[:-2], -1)
        part = np.ones(flat.shape)
        for p in range(flat.shape[-1]):
            own = [v[offsets[p] : offsets[p + 1]].astype(np.float64) for v in (front, back, alpha)]
            part[..., p] = reference_rays.held_through(*own, flat[..., p])
        return part.reshape(at.shape)

    at = np.minimum(rays.depth, stops)
    weight = rays.weight * held(at)
    by_pixel = at.reshape(len(at), -1)[:, pixel]
    close = (np.abs(by_pixel - front) < 2e-4) & (back == front)
    doubtful = np.zeros(SIZE[0] * SIZE[1], bool)
    doubtful[pixel[(close & (rays.weight.reshape(len(at), -1)[:, pixel] > 0)).any(axis=0)]] = True
    sure = decided(seen, eye, stops) & ~doubtful.reshape(SIZE[::-1])
    rgb = np.einsum("nhw,nhwc->hwc", weight, seen.color[rays.splat])
    expected = np.concatenate([rgb, weight.sum(0)[..., None]], -1)
    expected += (rays.through * held(stops))[..., None] * bare["color"]
    assert psnr(found[sure], expected[sure]) > 60
