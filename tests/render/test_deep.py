"""Tests that flattened deep pictures equal flat ones, and merge with others as if rendered
together.

Captures are drawn at 320x240, with cameras that see nearly all of their splats.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from tests.render import everything
from tests.render.rendering import (
    lens,
    picture,
    random_cloud,
    scene_of,
    settings_of,
    view_of,
)
from tests.render.surface_scenes import add, mesh, sphere
from usdsplat import formats
from usdsplat.core.errors import UsageError
from usdsplat.delegate.default_camera import frame_subject
from usdsplat.images.deep import DeepBand, DeepWriter
from usdsplat.images.layout import ImageLayout
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.render import frame
from usdsplat.render.deep_memory import DeepSize
from usdsplat.render.deep_samples import DeepSamples
from usdsplat.render.renderer import Renderer
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import FieldSpec, Framing, InstanceSpec, View

OIIOTOOL = str(Path(sys.executable).with_name("oiiotool"))
LINEAR = {"blend_space": "linear", "color_mode": "scene"}
SIZE = (320, 240)
CAPTURES = ["playbot_lod5.sog", "statue_massa.sog", "flowers_lod3_0.sog"]
ORDERS = ["zDepth", "rayHitDistance"]
COLORS = np.float32([0.6, 0.3, 0.1])


@cache
def captured(path) -> tuple[RenderScene, View]:
    scene = RenderScene()
    scene.set_field("/capture", FieldSpec(cloud=formats.read(path).cloud))
    scene.set_instances("/capture", (InstanceSpec(path="/capture"),))
    aspect = SIZE[0] / SIZE[1]
    camera = frame_subject(scene.seen(), scene.bounds(), up_axis="Y", aspect=aspect)
    return scene, View(camera=camera, framing=Framing(resolution=SIZE))


def deep_of(scene, view, *, holdout=None, **settings) -> DeepSamples:
    """All samples of a picture, drawn in two bands and joined."""
    renderer = Renderer(open_device())
    width, height = view.framing.resolution
    bands = renderer.render_deep(
        scene,
        view,
        settings_of(**settings),
        holdout=holdout,
        size=DeepSize(band_pixels=width * height // 2),
    )
    parts = [samples for _, _, samples in bands]
    names = ("counts", "depth", "depth_back", "color", "left")
    return DeepSamples(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))


def flattened(deep: DeepSamples) -> np.ndarray:
    """Samples over each other, in float64."""
    counts = deep.counts.ravel().astype(np.int64)
    first = np.cumsum(counts) - counts
    image = np.zeros((len(counts), 4))
    for k in range(int(counts.max(initial=0))):
        some = np.flatnonzero(counts > k)
        image[some] += (1 - image[some, 3:]) * deep.color[first[some] + k]
    return image.reshape(*deep.counts.shape, 4)


def write(path, deep: DeepSamples, size) -> None:
    band = DeepBand(
        counts=deep.counts, depth=deep.depth, depth_back=deep.depth_back, color=deep.color
    )
    layout = ImageLayout(resolution=size, pixel_type="float")
    merged = bool((deep.depth_back > deep.depth).any())
    with DeepWriter(path, layout, merged=merged) as writer:
        writer.write_band(0, band)


def oiiotool(*arguments) -> None:
    run = subprocess.run([OIIOTOOL, *map(str, arguments)], capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr


def read(path) -> np.ndarray:
    image = oiio.ImageBuf(str(path))
    names = list(image.spec().channelnames)
    return image.get_pixels(oiio.FLOAT)[..., [names.index(c) for c in "RGBA"]]


@pytest.mark.parametrize("sorting", ORDERS)
@pytest.mark.parametrize("name", CAPTURES)
def test_a_flattened_deep_picture_is_the_beauty(data, tmp_path, name, sorting) -> None:
    """Of real captures, to 1e-3; merging stays within its bound. Oracle: `over` in NumPy, and
    oiiotool --flatten on the file, beside the renderer's flat picture."""
    scene, view = captured(data / "splats" / name)
    beauty = picture(scene, view, aovs=("color",), sorting=sorting, **LINEAR)["color"]
    assert (beauty[..., 3] > 0.5).mean() > 0.05
    deep = deep_of(scene, view, sorting=sorting)
    assert np.abs(flattened(deep) - beauty).max() < 1e-3
    write(tmp_path / "deep.exr", deep, SIZE)
    oiiotool(tmp_path / "deep.exr", "--flatten", "-o", tmp_path / "flat.exr")
    assert np.abs(read(tmp_path / "flat.exr") - beauty).max() < 1e-3
    pixel = np.repeat(np.arange(deep.counts.size), deep.counts.ravel())
    same = pixel[1:] == pixel[:-1]
    assert (np.diff(deep.depth)[same] >= 0).all()
    merged = deep_of(scene, view, sorting=sorting, deep_error=0.002)
    assert np.abs(flattened(merged) - beauty).max() < 1e-3
    assert len(merged.depth) < 0.9 * len(deep.depth)
    assert (merged.depth_back >= merged.depth).all()
    assert front_error(deep, merged) <= 0.002 * 1.01


def front_error(deep: DeepSamples, merged: DeepSamples) -> float:
    """By how much at most the opacity in front of any sample's depth differs, on some pixels. A
    merged sample is all there at its nearer end, or at its farther one."""
    rng = np.random.default_rng(0)
    ends = [np.append(0, np.cumsum(each.counts, dtype=np.int64)) for each in (deep, merged)]
    worst = 0.0
    for pixel in rng.permutation(deep.counts.size)[:4000].tolist():
        own = slice(*ends[0][pixel : pixel + 2])
        few = slice(*ends[1][pixel : pixel + 2])
        if own.stop == own.start:
            continue
        exact = 1 - np.cumprod(1 - deep.color[own, 3].astype(np.float64))
        cover = 1 - np.cumprod(1 - merged.color[few, 3].astype(np.float64))
        for place in (merged.depth[few], merged.depth_back[few]):
            at = np.searchsorted(place, deep.depth[own], side="right") - 1
            found = np.where(at >= 0, cover[at], 0.0)
            last = np.append(deep.depth[own][1:] > deep.depth[own][:-1], True)
            worst = max(worst, float(np.abs(found - exact)[last].max()))
    return worst


def ball_scene(*parts) -> RenderScene:
    points, triangles = sphere(256, 128)
    made = mesh(0.9 * points + (0.1, 0.05, 0), triangles)
    colors = np.broadcast_to(COLORS, (len(made.triangles), 3, 3)).copy()
    return add(scene_of(*parts), "/mesh", replace(made, colors=colors))


def elsewhere(path, depth, color) -> None:
    """A deep picture that another renderer could have made of a surface: OpenImageIO's own."""
    height, width = depth.shape
    names = ("R", "G", "B", "A", "Z")
    spec = oiio.ImageSpec(width, height, 5, oiio.FLOAT)
    spec.channelnames, spec.deep = names, True
    data = oiio.DeepData()
    data.init(width * height, 5, (oiio.TypeFloat,) * 5, names)
    for pixel in np.flatnonzero(np.isfinite(depth)).tolist():
        data.set_samples(pixel, 1)
        values = (*color.reshape(-1, 4)[pixel].tolist(), float(depth.flat[pixel]))
        for channel, value in enumerate(values):
            data.set_deep_value(pixel, channel, 0, value)
    file = oiio.ImageOutput.create(str(path))
    assert file.open(str(path), spec)
    assert file.write_deep_image(data)
    file.close()


def test_a_deep_merge_is_the_picture_of_both(tmp_path) -> None:
    """A surface from elsewhere, merged with our deep splats by where they peak. Oracle: oiiotool
    --deepmerge --flatten equals our own picture of both to 1e-3; where splats are at their centres'
    depth for all pixels, no renderer can agree with it but on average."""
    view, size = view_of(lens()), (150, 110)
    parts = [(random_cloud(1), np.eye(4))]
    aovs = ("color", "depth")
    alone = picture(ball_scene(), view, aovs=aovs, **LINEAR)
    elsewhere(tmp_path / "cg.exr", alone["depth"], alone["color"])

    def merged(sorting):
        write(tmp_path / "deep.exr", deep_of(scene_of(*parts), view, sorting=sorting), size)
        oiiotool(
            tmp_path / "deep.exr", tmp_path / "cg.exr", "--deepmerge", "--flatten",
            "-o", tmp_path / "flat.exr",
        )  # fmt: skip
        both = picture(ball_scene(*parts), view, aovs=("color",), sorting=sorting, **LINEAR)
        return np.abs(read(tmp_path / "flat.exr") - both["color"])

    exact, by_center = merged("rayHitDistance"), merged("zDepth")
    print(
        f"deep merge: {exact.max():.1e} by ray, {by_center.max():.2f} by centre, "
        f"mean {by_center.mean():.1e}"
    )
    assert exact.max() < 1e-3
    assert by_center.mean() < 0.02


@pytest.mark.parametrize("sorting", ORDERS)
@pytest.mark.parametrize("case", ["mesh", "matte mesh", "matte splats", "deep holdout"])
def test_flatten_equals_beauty_whatever_holds_out(case, sorting) -> None:
    """Oracle: the flat picture of the same view, to 1e-3."""
    parts = [(random_cloud(1), np.eye(4)), (random_cloud(2), np.eye(4))]
    scene, view, holdout = ball_scene(*parts), view_of(lens()), None
    if case == "matte mesh":
        view = replace(view, matte=(("/mesh", True),))
    if case == "matte splats":
        view = replace(view, matte=(("/field1", True),))
    if case == "deep holdout":

        def holdout(x0, y0, x1, y1):
            pixels = (x1 - x0) * (y1 - y0)
            depth = np.full(pixels, 3.0, np.float32)
            return np.arange(pixels + 1), depth, np.full(pixels, 0.4, np.float32)

    options = {"sorting": sorting, "holdout": holdout}
    beauty = picture(scene, view, aovs=("color",), **LINEAR, **options)["color"]
    deep = deep_of(scene, view, **options)
    assert np.abs(flattened(deep) - beauty).max() < 1e-3
    assert deep.depth.min() >= 0.01


@pytest.mark.parametrize("name", everything.DEEP)
def test_strips_join_without_a_seam(monkeypatch, name) -> None:
    """In strips of one row of tiles, of which the first and the last are cut.
    Oracle: the same picture in one strip, bit for bit."""
    case = everything.CASES[name]
    scene, view = everything.scene_of(case, 300), everything.view_on(case, SIZE)
    window = (7, 5, 315, 230)
    view = replace(view, framing=replace(view.framing, data_window=window))
    settings = settings_of(**case.settings, deep_error=0.01)

    def drawn():
        holdout = everything.holdout_of(case)
        return list(
            Renderer(CpuDevice()).render_deep(
                scene, view, settings, holdout=holdout, size=DeepSize(band_pixels=SIZE[0] * SIZE[1])
            )
        )

    ((y0, y1, whole),) = drawn()
    assert (y0, y1) == (window[1], window[3])
    monkeypatch.setattr(frame, "DEEP_PIXELS", 16 * 308)
    strips = drawn()
    assert [y1 for _, y1, _ in strips] == [*range(16, 230, 16), 230]
    for field in ("counts", "depth", "depth_back", "color", "left"):
        joined = np.concatenate([getattr(strip, field) for _, _, strip in strips])
        np.testing.assert_array_equal(joined, getattr(whole, field), err_msg=field)


def test_memory_of_samples_is_used_again_once_they_are_released(monkeypatch) -> None:
    """Oracle: addresses of the samples, of all strips of two pictures."""
    monkeypatch.setattr(frame, "DEEP_PIXELS", 1)
    scene, view = scene_of((random_cloud(1), np.eye(4))), view_of(lens())
    renderer = Renderer(CpuDevice())
    fullest = max(len(s.depth) for _, _, s in renderer.render_deep(scene, view, settings_of()))
    renderer._idle[0].samples.take(6 * fullest)  # from here on, each strip fits in the first place
    addresses = []
    for _ in range(2):
        for _, _, samples in renderer.render_deep(scene, view, settings_of()):
            addresses.append(samples.color.ctypes.data)
        del samples
    assert len(addresses) > 8 and len(set(addresses)) <= 2


def test_centres_at_a_distance_cannot_be_deep() -> None:
    """Oracle: the error says which orders can."""
    renderer = Renderer(open_device())
    with pytest.raises(UsageError, match="zDepth or rayHitDistance"):
        next(
            renderer.render_deep(scene_of(), view_of(lens()), settings_of(sorting="cameraDistance"))
        )


@pytest.mark.parametrize("error", [0.0, 0.003, 0.05])
@pytest.mark.parametrize("name", CAPTURES)
def test_sixteen_pixels_at_a_time_hold_what_each_holds(data, name, error) -> None:
    """Of real captures, the same samples whether pixels go by sixteen or, as a holdout that is
    infinitely far away makes them, one by one. Oracle: the walk."""
    scene, view = captured(data / "splats" / name)

    def nothing(x0: int, y0: int, x1: int, y1: int) -> np.ndarray:
        return np.full((y1 - y0, x1 - x0), np.inf, np.float32)

    deep = deep_of(scene, view, deep_error=error)
    walked = deep_of(scene, view, deep_error=error, holdout=nothing)
    assert deep.counts.max() > 8
    assert np.array_equal(deep.counts, walked.counts)
    assert np.array_equal(deep.depth, walked.depth)
    assert np.array_equal(deep.depth_back, walked.depth_back)
    # On a GPU, a rounding error of 1e-7 behind a transmittance of 1e-4 is 1e-3 of the quotient.
    assert np.abs(deep.color - walked.color).max() < 2e-3
    if open_device().name == "cpu":
        assert np.array_equal(deep.color, walked.color)
    assert np.abs(flattened(deep) - flattened(walked)).max() < 1e-6


@pytest.mark.parametrize("error", [0.0, 0.01])
def test_a_crop_of_a_deep_picture_is_a_part_of_it(error) -> None:
    """To the bit, wherever tiles are cut. Oracle: the whole picture."""
    scene, whole = scene_of((random_cloud(5, n=300), np.eye(4))), view_of(lens())
    width, height = whole.framing.resolution
    x0, y0, x1, y1 = 21, 13, width - 9, height - 5
    deep = deep_of(scene, whole, deep_error=error)
    crop = replace(whole, framing=replace(whole.framing, data_window=(x0, y0, x1, y1)))
    part = deep_of(scene, crop, deep_error=error)
    inside = np.zeros(deep.counts.shape, bool)
    inside[y0:y1, x0:x1] = True
    kept = np.repeat(inside.ravel(), deep.counts.ravel())
    assert np.array_equal(part.counts, deep.counts[y0:y1, x0:x1])
    assert np.array_equal(part.depth, deep.depth[kept])
    assert np.array_equal(part.depth_back, deep.depth_back[kept])
    assert np.array_equal(part.color, deep.color[kept])
