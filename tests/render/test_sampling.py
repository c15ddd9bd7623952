"""Tests of the samples of shutter, lens and pixel filter, and of their average."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from tests.delegate.stages import add_camera
from tests.render.rendering import lens, picture, random_cloud, scene_of, settings_of, view_of
from tests.render.surface_scenes import add, mesh
from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.delegate.engine import Engine
from usdsplat.render import sampling
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CameraSpec

SMALL = (60, 44)
AT_CENTERS = {"filter_width": 1e-4}
"""A pixel filter so narrow that only shutter and lens count."""
CAMERA = CameraSpec(shutter=(-0.25, 0.5), lens_radius=0.3, focus_distance=4.0)


def eye_of(size=SMALL, focal=60.0):
    center = (size[0] / 2 - 1.0, size[1] / 2 + 2.0)
    return replace(lens(), size=size, focal=(focal, 1.1 * focal), center=center)


def view_with(eye, **camera):
    view = view_of(eye)
    return replace(view, camera=replace(view.camera, **camera))


def speck(position=(0.0, 0.0, 0.0), scale=0.03, opacity=0.999) -> SplatCloud:
    """One white ball."""
    return SplatCloud(
        positions=np.float32([position]),
        scales=np.full((1, 3), scale, np.float32),
        rotations=np.float32([[1, 0, 0, 0]]),
        opacities=np.float32([opacity]),
        sh=np.full((1, 1, 3), 0.5 / 0.28209479177387814, np.float32),
    )


def shifted(by) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = by
    return matrix


def psnr(found, expected) -> float:
    return -10.0 * math.log10(np.mean((found - expected) ** 2) + 1e-30)


# --- where samples lie -------------------------------------------------------------------


@pytest.mark.parametrize("n", [2, 16, 61, 256])
def test_each_dimension_has_one_sample_in_every_nth(n: int) -> None:
    """Oracle: the middles of n equal parts of the shutter and of the pixel, each once; points of a
    disc are as many as its area within every radius."""
    taken = sampling.samples(settings_of(samples=n), CAMERA)
    assert taken == sampling.samples(settings_of(samples=n), CAMERA)
    middles = (np.arange(n) + 0.5) / n
    np.testing.assert_allclose(sorted(s.time for s in taken), -0.25 + 0.75 * middles, atol=1e-12)
    for axis in (0, 1):
        offsets = sorted(s.offset[axis] for s in taken)
        np.testing.assert_allclose(offsets, middles - 0.5, atol=1e-12)
    radii = sorted(math.hypot(*s.lens) for s in taken)
    np.testing.assert_allclose(radii, 0.3 * np.sqrt(middles), atol=1e-12)


def test_dimensions_know_nothing_of_each_other() -> None:
    """Oracle: correlations of 256 samples, none of which is above 0.06."""
    taken = sampling.samples(settings_of(samples=256), CAMERA)
    columns = np.array([(s.time, *s.lens, *s.offset) for s in taken]).T
    assert np.abs(np.corrcoef(columns) - np.eye(5)).max() < 0.06


@pytest.mark.parametrize("width", [0.0, 1.7])
@pytest.mark.parametrize("name", ["box", "triangle", "gaussian", "blackmanHarris"])
def test_filters_have_their_own_spread(name: str, width: float) -> None:
    """Oracle: second sampler of the filters, integrated in closed form; their mean is 0."""
    settings = settings_of(samples=4096, pixel_filter=name, filter_width=width)
    offsets = np.array([s.offset for s in sampling.samples(settings, CAMERA)])
    half = 0.5 * (width or sampling.WIDTHS[name])
    density = math.exp(-4.5) / math.sqrt(2 * math.pi)
    a = sampling.BLACKMAN_HARRIS
    cosines = sum(a[k] * 4 * (-1) ** k / (k * math.pi) ** 2 for k in (1, 2, 3))
    moment = {
        "box": 1 / 3,
        "triangle": 1 / 6,
        "gaussian": (1 - 6 * density / math.erf(3 / math.sqrt(2))) / 9,
        "blackmanHarris": (2 * a[0] / 3 + cosines) / (2 * a[0]),
    }[name]
    assert np.abs(offsets.mean(axis=0)).max() < 1e-6
    np.testing.assert_allclose((offsets**2).mean(axis=0), half**2 * moment, rtol=2e-3)
    assert np.abs(offsets).max() <= half


# --- what they average to ----------------------------------------------------------------


def test_one_sample_is_sharp_and_still() -> None:
    """Oracle: the picture of a camera without shutter and lens, bit for bit."""
    scene, eye = scene_of((random_cloud(1, n=60), np.eye(4))), eye_of()
    wide = view_with(eye, shutter=(-0.5, 0.5), lens_radius=0.4, focus_distance=3.0)

    def sampler(time):
        assert time == 0.0
        return scene, wide

    aovs = ("color", "depth", "elementId")
    found = picture(scene, wide, aovs=aovs, sampler=sampler)
    expected = picture(scene, view_of(eye), aovs=aovs)
    for name in aovs:
        np.testing.assert_array_equal(found[name], expected[name])


def moving(eye, clouds, speed, **camera):
    """Scene, view and sampler of clouds that move through the shutter."""
    view = view_with(eye, **camera)

    def sampler(time):
        return scene_of(*((cloud, shifted(time * np.array(speed))) for cloud in clouds)), view

    return sampler(0.0)[0], view, sampler


def test_what_moves_is_spread_along_its_way() -> None:
    """A ball that goes 12 pixels to the right and 5 down while the shutter is open. Oracle: the
    mean of its footprint over 4,096 times in float64, to 2e-3 at 64 samples."""
    eye, scale = eye_of(), 0.1
    fx, fy = eye.focal
    speed = (12 * 4 / fx / 0.5, 5 * 4 / fy / 0.5, 0.0)
    scene, view, sampler = moving(eye, [speck(scale=scale)], speed, shutter=(-0.25, 0.25))
    found = picture(
        scene, view, sampler=sampler, samples=64, aovs=("color",), **AT_CENTERS
    )["color"]  # fmt: skip
    times = -0.25 + 0.5 * (np.arange(4096) + 0.5) / 4096
    x = np.arange(SMALL[0]) + 0.5 - eye.center[0]
    y = np.arange(SMALL[1]) + 0.5 - eye.center[1]
    sx, sy = (scale * fx / 4) ** 2 + 0.3, (scale * fy / 4) ** 2 + 0.3
    # the ball's own x/z slant adds under a thousandth of its width to these variances
    u, v = times[:, None] * speed[0] * fx / 4, times[:, None] * speed[1] * fy / 4
    across, down = np.exp(-0.5 * (x - u) ** 2 / sx), np.exp(-0.5 * (y - v) ** 2 / sy)
    total = np.zeros(SMALL[::-1])
    for a, b in zip(across, down, strict=True):
        alpha = 0.999 * np.outer(b, a)
        total += np.where(alpha < 1 / 255, 0, alpha)
    np.testing.assert_allclose(found[..., 3], total / 4096, atol=2e-3)
    still = picture(scene, view, aovs=("color",))["color"]
    assert np.abs(still - found).max() > 0.3


def usd_stage(kind: str) -> Usd.Stage:
    """Something that moves within a frame, each in its own way."""
    stage = Usd.Stage.CreateInMemory()
    stage.SetTimeCodesPerSecond(24)
    cloud = random_cloud(3, n=40, degree=0)
    camera = add_camera(stage, eye=(0.0, 0.0, 6.0))
    camera.CreateShutterOpenAttr(-0.25)
    camera.CreateShutterCloseAttr(0.25)
    if kind == "velocities":
        cloud = replace(cloud, velocities=np.full((40, 3), (24.0, 12.0, 0.0), np.float32))
    prim = schema.author(stage, "/Splats", cloud)
    if kind == "xform":
        op = UsdGeom.Xformable(prim).AddTranslateOp()
        op.Set(Gf.Vec3d(-1, 0, 0), 0)
        op.Set(Gf.Vec3d(1, 0.5, 0), 2)
    if kind == "camera":
        op = camera.GetOrderedXformOps()[0]
        op.Set(Gf.Vec3d(-1, 0, 6), 0)
        op.Set(Gf.Vec3d(1, 0, 7), 2)
    if kind == "samples":
        attribute = prim.GetAttribute("positions")
        points = np.array(attribute.Get())
        attribute.Set(points - np.float32([1, 0, 0]), 0)
        attribute.Set(points + np.float32([1, 0.5, 0]), 2)
    if kind == "velocities":
        attribute = prim.GetAttribute("positions")
        points = attribute.Get()
        attribute.Clear()
        attribute.Set(points, 1)
        speeds = prim.GetAttribute("velocities")
        values = speeds.Get()
        speeds.Clear()
        speeds.Set(values, 1)
    return stage


@pytest.mark.parametrize("kind", ["xform", "camera", "samples", "velocities"])
def test_everything_that_moves_on_a_stage_is_blurred(kind: str) -> None:
    """Oracle: the mean of still pictures, with the stage at each sample's own time."""
    n = 8
    settings = RenderSettings(samples=n, **AT_CENTERS)
    with Engine(usd_stage(kind), time=1.0) as engine:
        view = engine.view("/Camera", resolution=(80, 60))
        assert view.camera.shutter == (-0.25, 0.25)
        blurred = engine.picture(view, settings)["color"].copy()
        sharp = engine.picture(view)["color"].copy()
        assert engine.time == 1.0
        stills = []
        for sample in sampling.samples(settings, view.camera):
            engine.set_time(1.0 + sample.time)
            stills.append(
                engine.picture(engine.view("/Camera", resolution=(80, 60)))["color"].copy()
            )
    np.testing.assert_allclose(blurred, np.mean(stills, axis=0), atol=2e-3)
    assert np.abs(blurred - sharp).max() > 0.05


def test_what_is_out_of_focus_is_as_wide_as_the_lens_says() -> None:
    """Oracle: the thin lens: a point becomes a disc of radius f·R·|1/z − 1/focus| pixels, whose
    variance about each axis is a quarter of that radius squared; within 2 %."""
    eye = eye_of(size=(120, 110), focal=120.0)
    scene = scene_of((speck(opacity=0.3), np.eye(4)))
    for focus in (2.5, 9.0):
        view = view_with(eye, lens_radius=0.5, focus_distance=focus)
        spreads = []
        for samples in (1, 256):
            image = picture(scene, view, samples=samples, aovs=("color",), **AT_CENTERS)
            weight = image["color"][..., 3].astype(np.float64)
            mean, sampler = [], []
            for axis in (1, 0):
                at = np.arange(weight.shape[axis])
                line = weight.sum(axis=1 - axis) / weight.sum()
                mean.append((line * at).sum())
                sampler.append((line * (at - mean[-1]) ** 2).sum())
            spreads.append(sampler)
            np.testing.assert_allclose(mean, np.array(eye.center) - 0.5, atol=0.02)
        wider = np.subtract(spreads[1], spreads[0])
        radius = np.array(eye.focal) * 0.5 * abs(1 / 4 - 1 / focus)
        np.testing.assert_allclose(wider, radius**2 / 4, rtol=0.02)


def test_what_is_in_focus_stays_sharp() -> None:
    """Oracle: the picture through a pinhole, of splats that are all at the focus distance."""
    cloud = random_cloud(2, n=60, degree=0)
    flat = cloud.positions * np.float32([1, 1, 0])
    cloud = replace(cloud, positions=flat, scales=np.minimum(cloud.scales, np.float32(0.02)))
    scene, eye = scene_of((cloud, np.eye(4))), eye_of()
    view = view_with(eye, lens_radius=0.05, focus_distance=4.0)
    found = picture(scene, view, samples=16, aovs=("color",), **AT_CENTERS)["color"]
    assert psnr(found, picture(scene, view_of(eye), aovs=("color",))["color"]) > 55


def test_a_blurred_picture_has_no_noise_at_64_samples() -> None:
    """Motion, lens and pixel at once. Oracle: 1,024 samples of its own, >= 40 dB."""
    eye = eye_of(size=(40, 32), focal=40.0)
    scene, view, sampler = moving(
        eye, [random_cloud(6, n=40, degree=0)], (0.8, 0.3, 0.0),
        shutter=(-0.25, 0.25), lens_radius=0.15, focus_distance=4.0,
    )  # fmt: skip
    few, many = (
        picture(scene, view, sampler=sampler, samples=n, aovs=("color",))["color"]
        for n in (64, 1024)
    )
    assert psnr(few, many) > 40


@pytest.mark.parametrize("n", [4, 32])
def test_edges_of_surfaces_have_the_coverage_of_their_area(n: int) -> None:
    """Oracle: the part of each pixel that a rectangle covers, to one sample along either axis."""
    eye = eye_of()
    corners = np.array([(10.3, 8.6), (47.1, 8.6), (47.1, 33.2), (10.3, 33.2)])
    points = np.zeros((4, 3))
    points[:, :2] = (corners - eye.center) * 4 / np.array(eye.focal)
    scene = add(scene_of(), "/mesh", mesh(points, [[0, 1, 2], [0, 2, 3]]))
    found = picture(scene, view_of(eye), samples=n, aovs=("color",))["color"][..., 3]
    parts = []
    for low, high, size in ((10.3, 47.1, 60), (8.6, 33.2, 44)):
        at = np.arange(size)
        parts.append(np.clip(np.minimum(at + 1, high) - np.maximum(at, low), 0, 1))
    exact = np.outer(parts[1], parts[0])
    sides = (exact == 0) | (exact == 1) | ((parts[0] == 1)[None] | (parts[1] == 1)[:, None])
    assert np.abs(found - exact)[sides].max() <= 0.5 / n + 1e-5
    assert np.abs(found - exact).max() <= 2.0 / n


def test_bands_threads_and_crops_change_no_bit_of_an_average() -> None:
    """Oracle: the same picture in one band on one thread, and its part in a data window."""
    eye = eye_of()
    scene, view, sampler = moving(
        eye, [random_cloud(6, n=80)], (0.8, 0.3, 0.0),
        shutter=(-0.25, 0.25), lens_radius=0.15, focus_distance=4.0,
    )  # fmt: skip
    aovs = ("color", "albedo", "cryptoObject", "depth", "P", "Neye")
    options = {"sampler": sampler, "samples": 4, "aovs": aovs, "pixel_filter": "gaussian"}
    whole = picture(scene, view, threads=1, **options)
    banded = picture(scene, view, threads=2, band_pixels=60 * 16, **options)
    part = replace(view, framing=replace(view.framing, data_window=(-5, 7, 33, 40)))

    def inside(time):
        return sampler(time)[0], part

    cropped = picture(scene, part, **(options | {"sampler": inside}))
    for name in aovs:
        np.testing.assert_array_equal(whole[name], banded[name], err_msg=name)
        overlap = cropped[name][:, 5:]
        np.testing.assert_array_equal(whole[name][7:40, :33], overlap, err_msg=name)


def test_what_must_not_be_averaged_is_that_of_the_middle_of_the_shutter() -> None:
    """Depth, ids, positions, normals. Oracle: a still picture at that time, bit for bit."""
    eye = eye_of()
    scene, view, sampler = moving(
        eye, [random_cloud(6, n=80)], (0.8, 0.3, 0.0),
        shutter=(0.0, 0.5), lens_radius=0.15, focus_distance=4.0,
    )  # fmt: skip
    aovs = (
        "depth", "depthFront", "depthExpected", "P", "Neye", "primId", "instanceId", "elementId"
    )  # fmt: skip
    found = picture(scene, view, sampler=sampler, samples=4, aovs=(*aovs, "color"))
    middle, _ = sampler(0.25)
    expected = picture(middle, view, aovs=aovs)
    for name in aovs:
        np.testing.assert_array_equal(found[name], expected[name], err_msg=name)
