"""Tests of deep pictures of several samples, and of the ids of deep samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.render import everything
from tests.render.rendering import lens, random_cloud, scene_of, settings_of, view_of
from tests.render.test_deep import flattened
from usdsplat.core.errors import UsageError
from usdsplat.images.cryptomatte import object_hash
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.render import deep_merging
from usdsplat.render.deep_memory import USUAL_SIZE, DeepSize
from usdsplat.render.deep_samples import DEEP_IDS, DeepSamples
from usdsplat.render.renderer import Renderer

SIZE = (150, 110)
LINEAR = {"blend_space": "linear", "color_mode": "scene"}
SAMPLES = {"samples": 12, "pixel_filter": "gaussian"}


def drawn(case, *, aovs=(), size=USUAL_SIZE, device=None, window=(0, 0, *SIZE), **settings):
    """A deep picture of a scene with every feature, whose camera moves in the shutter interval."""
    scene, view = everything.scene_of(case, 250), everything.view_on(case, SIZE)
    view = replace(view, framing=replace(view.framing, data_window=window))
    strips = Renderer(device or open_device()).render_deep(
        scene, view, settings_of(**case.settings | settings), aovs,
        sampler=lambda time: (scene, everything._moved(view, time)),
        holdout=everything.holdout_of(case), size=size,
    )  # fmt: skip
    strips = list(strips)
    ends = [y1 for _, y1, _ in strips]
    assert [y0 for y0, _, _ in strips] == [window[1], *ends[:-1]] and ends[-1] == window[3]
    parts = [samples for *_, samples in strips]
    assert len({part.prims for part in parts}) == 1
    names = ("counts", "depth", "depth_back", "color", "left", "ids")
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return replace(parts[0], **arrays), len(strips)


def flat(case, aovs=("color",), **settings):
    """The flat picture of the same view, and the paths of its prims."""
    scene, view = everything.scene_of(case, 250), everything.view_on(case, SIZE)
    bands = Renderer(open_device()).render(
        scene, view, settings_of(**case.settings | LINEAR | settings), aovs,
        sampler=lambda time: (scene, everything._moved(view, time)),
        holdout=everything.holdout_of(case),
    )  # fmt: skip
    (band,) = bands
    return {name: band.arrays[name].copy() for name in aovs}, scene.draw_list().prims


@pytest.mark.parametrize(
    "name",
    [
        "splats alone", "surfaces", "rays", "rays and surfaces", "orthographic", "matte splats",
        "matte mesh", "flat holdout", "deep holdout", "ellipses", "budget",
    ],
)  # fmt: skip
def test_flattened_it_is_the_flat_picture_of_the_same_samples(name) -> None:
    """With motion blur, lens blur, a pixel filter, two instances, surfaces before and behind
    splats, mattes and holdouts. Oracle: the flat picture, to 1e-5; one sample is not enough."""
    case = everything.CASES[name]
    beauty = flat(case, **SAMPLES)[0]["color"]
    deep, _ = drawn(case, **SAMPLES)
    assert (beauty[..., 3] > 0.1).mean() > 0.05
    error = flattened(deep) - beauty
    assert np.abs(error).max() < 1e-5
    sharp = flattened(drawn(case)[0]) - beauty
    assert np.mean(sharp[..., :3] ** 2) > 1e-5


def test_merging_stays_within_its_error() -> None:
    """Oracle: the exact samples: the flattened picture, and their number."""
    case = everything.CASES["rays and surfaces"]
    exact, merged = drawn(case, **SAMPLES)[0], drawn(case, deep_error=0.01, **SAMPLES)[0]
    assert len(merged.depth) < 0.6 * len(exact.depth)
    assert np.abs(flattened(merged) - flattened(exact)).max() < 1e-5
    assert (merged.depth_back > merged.depth).any()
    assert exact.depth_back is exact.depth or np.array_equal(exact.depth_back, exact.depth)


def equal(one: DeepSamples, other: DeepSamples) -> None:
    for name in ("counts", "depth", "depth_back", "color", "ids"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


@pytest.mark.parametrize(
    ("name", "held", "parts"),
    [
        ("splats alone", 15_000, 0),
        ("flat holdout", 15_000, 0),
        ("rays and surfaces", 15_000, 0),
        ("rays and surfaces", 2_400, 8),
    ],
)
def test_how_much_fits_in_memory_does_not_change_a_picture(monkeypatch, name, held, parts) -> None:
    """In strips of fewer rows, and in parts of rows. Oracle: the picture in one piece, to the
    bit."""
    case = everything.CASES[name]
    options = {"aovs": ("primId",), "device": CpuDevice(), "window": (9, 41, 141, 56)}
    options |= {"deep_error": 0.1, **SAMPLES}
    whole, count = drawn(case, **options)
    assert count == 1
    beside, joined = deep_merging._beside, [0]
    monkeypatch.setattr(
        deep_merging, "_beside", lambda found: joined.append(len(found)) or beside(found)
    )
    strips, count = drawn(case, size=DeepSize(band_pixels=32 * 150, entries=held), **options)
    assert count >= 2 and max(joined) == parts
    equal(strips, whole)


@pytest.mark.parametrize(
    ("entries", "said"),
    [
        (13, r"13 contributions to the pixel .* fewer --samples, or a larger --memory-limit"),
        (700, r"700 samples in the row .* a larger --deep-error or --memory-limit, or fewer --sam"),
    ],
)
def test_too_many_samples_say_what_to_do(entries, said) -> None:
    """Oracle: the sentence, if no pixel of a row fits, or not the whole row; with the named cure,
    the picture is drawn."""
    case, window = everything.CASES["rays"], (40, 50, 120, 52)
    with pytest.raises(UsageError, match=said):
        drawn(case, size=DeepSize(entries=entries), window=window, **SAMPLES)
    if entries > 13:
        drawn(case, size=DeepSize(entries=entries), window=window, deep_error=0.1, **SAMPLES)
    drawn(case, size=DeepSize(entries=60_000), window=window, **SAMPLES)


def test_few_pixels_may_have_many_samples() -> None:
    """Of a crop of four pixels. Oracle: the number of samples that they have, which is more than
    usual ones of as many rows of tiles."""
    size = DeepSize(band_pixels=2 * 16)
    window = (75, 55, 77, 57)
    deep, _ = drawn(everything.CASES["rays"], size=size, window=window, samples=512)
    assert deep.counts.max() > 64 * 2 * 16


def test_regions_grow_again_behind_dense_ones(monkeypatch) -> None:
    """Oracle: heights and widths of the regions of a picture whose middle is dense; few of them
    have too many contributions."""
    tried: list[tuple[int, int, bool]] = []
    region = deep_merging.merged_region

    def noted(frame, camera, window, regions):
        x0, y0, x1, y1 = window
        tried.append((y1 - y0, x1 - x0, False))
        found = region(frame, camera, window, regions)
        tried[-1] = (*tried[-1][:2], True)
        return found

    monkeypatch.setattr(deep_merging, "merged_region", noted)
    size = DeepSize(band_pixels=32 * 150, entries=8_000)
    window = (0, -96, 150, 300)
    drawn(everything.CASES["rays"], size=size, window=window, deep_error=0.1, **SAMPLES)
    fits = [(rows, columns) for rows, columns, is_done in tried if is_done]
    assert fits[0][1] == 150 and (32, 150) in fits[fits.index((1, 75)) :]
    assert len(tried) - len(fits) <= 12


def test_scene_and_time_are_those_of_the_frame_between_strips() -> None:
    """Oracle: the last time that is asked for before each strip, and after an error."""
    case = everything.CASES["splats alone"]
    scene, view = everything.scene_of(case, 50), everything.view_on(case, SIZE)
    asked: list[float] = []

    def sampler(time):
        asked.append(time)
        if len(asked) > 40:
            raise RuntimeError
        return scene, everything._moved(view, time)

    strips = Renderer(CpuDevice()).render_deep(
        scene, view, settings_of(**SAMPLES), sampler=sampler, size=DeepSize(band_pixels=16 * 150)
    )
    for _ in range(3):
        next(strips)
        assert asked[-1] == 0.0 and len({*asked}) == 13
    with pytest.raises(RuntimeError):
        list(strips)
    assert asked[-1] == 0.0


@pytest.mark.parametrize("name", everything.DEEP)
def test_ids_are_those_of_the_splat_at_each_sample(name) -> None:
    """With surfaces, two instances and mattes. Oracle: where half of a pixel's coverage is reached,
    the ids of the flat picture; the samples are those without ids, to the bit."""
    case = everything.CASES[name]
    aovs = ("depth", *DEEP_IDS)
    arrays, prims = flat(case, ("color", *aovs))
    deep, _ = drawn(case, aovs=DEEP_IDS)
    plain, _ = drawn(case)
    for each in ("counts", "depth", "color"):
        np.testing.assert_array_equal(getattr(deep, each), getattr(plain, each))
    assert deep.id_names == DEEP_IDS and deep.prims == prims
    counts = deep.counts.ravel().astype(int)
    ends = np.cumsum(counts)
    half = arrays["color"][..., 3].ravel().astype(np.float64) / 2
    checked = 0
    for pixel in range(len(counts)):
        cover = 0.0
        for j in range(ends[pixel] - counts[pixel], ends[pixel]):
            before, cover = cover, cover + (1 - cover) * float(deep.color[j, 3])
            if cover > half[pixel]:
                if before < half[pixel] - 1e-5 and cover > half[pixel] + 1e-5:
                    found = [arrays[each].ravel()[pixel] for each in DEEP_IDS]
                    assert deep.ids[j].tolist() == found, pixel
                    checked += 1
                break
    assert checked > 3000
    assert len({tuple(each) for each in deep.ids[:, :2].tolist()}) >= 2


def test_the_samples_of_a_prim_sum_to_its_cryptomatte() -> None:
    """Blurred, with surfaces and merged samples. Oracle: the coverage of each prim in the flat
    picture's Cryptomatte of the same samples."""
    case = everything.CASES["rays and surfaces"]
    (arrays, _), (deep, _) = (
        flat(case, ("cryptoObject",), **SAMPLES),
        drawn(case, aovs=("primId",), deep_error=0.01, **SAMPLES),
    )
    counts = deep.counts.ravel().astype(int)
    pixel = np.repeat(np.arange(len(counts)), counts)
    weights, first = np.zeros(len(pixel)), np.cumsum(counts) - counts
    for k in range(counts.max()):
        some = first[counts > k] + k
        front = weights.copy()
        taken = np.bincount(pixel, front, len(counts))
        weights[some] = (1 - taken[pixel[some]]) * deep.color[some, 3]
    mattes = arrays["cryptoObject"].reshape(-1, 6, 2)
    assert len(deep.prims) == 4
    for number, path in enumerate(deep.prims):
        is_path = deep.ids[:, 0] == number
        found = np.bincount(pixel[is_path], weights[is_path], len(counts))
        expected = np.where(mattes[..., 0] == object_hash(path), mattes[..., 1], 0).sum(axis=1)
        assert expected.max() > 0.2
        np.testing.assert_allclose(found, expected, atol=2e-5)


@pytest.mark.parametrize("samples", [1, 3])
def test_a_picture_without_anything_has_no_samples(samples) -> None:
    """Oracle: the numbers of samples, and the types of arrays that a file needs."""
    scene = scene_of((random_cloud(1), np.eye(4)))
    view = view_of(lens())
    away = replace(view, camera=replace(view.camera, clipping_range=(1e5, 1e6)))
    settings = settings_of(samples=samples)
    ((y0, y1, deep),) = Renderer(open_device()).render_deep(scene, away, settings, DEEP_IDS)
    assert (y0, y1) == (0, SIZE[1]) and not deep.counts.any() and deep.counts.dtype == np.uint32
    assert deep.color.shape == (0, 4) and deep.ids.shape == (0, 3) and deep.depth.shape == (0,)
    assert deep.id_names == DEEP_IDS and deep.prims == ("/field0",)


def test_only_ids_can_be_asked_of_samples() -> None:
    """Oracle: the sentence."""
    with pytest.raises(UsageError, match="deep AOV: found 'P', expected one of primId, inst"):
        drawn(everything.CASES["rays"], aovs=("P",))
