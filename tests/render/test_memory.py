"""Tests of the memory estimate of a picture."""

from __future__ import annotations

import mmap
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from tests.images.test_deep import deep_picture, write_deep
from tests.images.test_holdout import flat
from tests.render import everything
from tests.render.rendering import lens, random_cloud, scene_of, settings_of, view_of
from usdsplat import images
from usdsplat.images.aovs import is_light
from usdsplat.images.holdout import open_holdout
from usdsplat.images.holdout_nodes import STRIP
from usdsplat.kernels import project
from usdsplat.kernels.devices import open_device
from usdsplat.render import deep_memory, memory
from usdsplat.render.buffers import Sizes
from usdsplat.render.frame import DEEP_PIXELS
from usdsplat.render.memory import PictureRequest
from usdsplat.render.renderer import Renderer
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import Framing, View

VIEW = view_of(lens())
SIZE = (256, 256)
SETTINGS = RenderSettings(sorting="zDepth", color_mode="scene")


@pytest.fixture
def scene():
    return scene_of((random_cloud(1), np.eye(4)))


def needed(scene, *aovs, settings=SETTINGS, size=SIZE, rows=64, **options):
    view = View(camera=view_of(lens()).camera, framing=Framing(resolution=size))
    band = rows * size[0]
    request = PictureRequest(aovs=aovs or ("color",), **options)
    return memory.estimate(scene, view, settings, request, band_pixels=band, threads=2)


@pytest.mark.parametrize("budget", [0, 100])
def test_the_seen_and_their_pairs_are_those_that_are_drawn(scene, budget):
    """Oracle: the renderer's own counts, from all splats, within a third."""
    renderer = Renderer(open_device("cpu"))
    settings = replace(SETTINGS, splat_budget=budget)
    for _ in renderer.render(scene, view_of(lens()), settings, ("color",)):
        pass
    screen = memory.Screen.of(view_of(lens()))
    visible, crossings, pairs = memory._visible(scene.draw_list(budget), screen)
    assert renderer.stats.visible > 0
    assert visible == pytest.approx(renderer.stats.visible, rel=0.33)
    assert pairs == pytest.approx(renderer.stats.pairs, rel=0.33)
    made = renderer._idle[0].allocated()["tiles.crossings"]
    assert crossings == pytest.approx(made / 8, rel=0.33)


WITHOUT_TREES = [name for name, case in everything.CASES.items() if not case.tree]
"""The buffers of a tree follow from its cut, see tests/render/lod/test_memory.py."""


@pytest.mark.parametrize("name", WITHOUT_TREES)
def test_a_picture_allocates_what_is_declared(name):
    """Oracle: the bytes of every buffer that a renderer has after one band."""
    case = everything.CASES[name]
    scene, view = everything.scene_of(case, 300), everything.view_on(case, SIZE)
    settings = settings_of(**case.settings)
    renderer = Renderer(open_device("cpu", threads=2))
    for _ in renderer.render(
        scene, view, settings, case.aovs, sampler=lambda _: (scene, view),
        holdout=everything.holdout_of(case),
    ):  # fmt: skip
        pass
    check(
        renderer,
        scene,
        view,
        settings,
        PictureRequest(aovs=case.aovs, holds_out=bool(case.holdout)),
    )


@pytest.mark.parametrize("name", everything.DEEP)
def test_a_deep_picture_allocates_what_is_declared(name):
    """Oracle: as above."""
    case = everything.CASES[name]
    scene, view = everything.scene_of(case, 300), everything.view_on(case, SIZE)
    settings = settings_of(**case.settings)
    renderer = Renderer(open_device("cpu", threads=2))
    for _ in renderer.render_deep(scene, view, settings, holdout=everything.holdout_of(case)):
        pass
    request = PictureRequest(aovs=(), holds_out=bool(case.holdout), deep=True)
    check(renderer, scene, view, settings, request)


@pytest.mark.parametrize("settings", [{}, {"samples": 3}, {"deep_error": 0.01}])
def test_ids_of_deep_samples_take_what_is_declared(settings):
    """Oracle: as above; the estimate has more bytes for each id, and for merging."""
    case = everything.CASES["surfaces"]
    scene, view = everything.scene_of(case, 300), everything.view_on(case, SIZE)
    renderer = Renderer(open_device("cpu", threads=2))
    for _ in renderer.render_deep(scene, view, settings_of(**settings), ("primId",)):
        pass
    request = PictureRequest(aovs=(), deep=True, deep_ids=1)
    check(renderer, scene, view, settings_of(**settings), request)
    pixels = 64 * 256
    how = replace(SETTINGS, **settings)
    none, one, two = (needed(scene, deep=True, deep_ids=ids, settings=how) for ids in range(3))
    merging = 8 * 128 if settings else 0
    assert two.band - one.band == (24 * 48 + merging) * pixels
    assert one.splats - none.splats == two.splats - none.splats > 0
    plain = needed(scene, deep=True).band
    if "samples" in settings:
        # sums of the flat picture that a deep one is compared with, and entries
        assert none.band - plain == (16 + 40 * 128) * pixels


def test_what_a_limit_leaves_is_for_contributions_that_are_merged():
    """Oracle: bytes of a contribution and of the sample that it becomes, with an id: 40 + 8 and 80
    + 24, and 32 for the beauty."""
    for settings, each in ((SETTINGS, 152), (replace(SETTINGS, deep_color="beauty"), 184)):
        assert deep_memory.entries_within(settings, 1, 10**9) == 10**9 // each
        usual = deep_memory.deep_bytes(replace(settings, samples=2), 1)
        assert usual == 128 * 48 + 48 * (each - 48)


def check(renderer, scene, view, settings, request) -> None:
    """Compare the buffers of a renderer with what `memory` says of its picture."""
    made = renderer._idle[0].allocated()
    layout = scene.draw_list(settings.splat_budget)
    visible = made["splats.ordered"] // (4 * project.RECORD)
    shown = made.get("display.records", 0) // (4 * project.RECORD)
    if settings.samples == 1:
        assert renderer.stats.visible == (shown // 2 or visible)
        assert renderer.stats.pairs == made["tiles.lists"] // 4
    sizes = Sizes(
        slots=layout.slots,
        blocks=len(layout.block_starts),
        visible=visible,
        shown=shown,
        drawn=shown or visible,
        chunks=4 * 2,
        height=SIZE[1],
        width=SIZE[0],
        tile_rows=-(-SIZE[1] // 16),
        tile_columns=-(-SIZE[0] // 16),
        crossings=made["tiles.crossings"] // 8,
        pairs=made["tiles.lists"] // 4,
        rank_pairs=(settings.crypto_rank + 1) // 2,
        triangle_pairs=made.get("triangles.lists", 0) // 4,
        light_parts=sum(map(is_light, request.aovs)),
    )
    used = memory.buffers_of(scene, view, settings, request)
    declared = {name: buffer.nbytes(sizes) for name, buffer in used.items()}
    spare = {"splats.ties", "splats.closed"}
    if request.holds_out:  # a flat holdout is a depth, a deep one is walked through
        spare |= {name for name in declared if name.endswith((".through", ".ray_depths"))}
        spare |= {"tiles.work", "pixels.holdout_depth", "pixels.holdout_covered"}
    assert made.keys() - spare == declared.keys() - spare
    assert {name: declared.get(name, made[name]) for name in made} == made


def test_display_modes_take_what_they_make(scene):
    """Oracle: the arrays: twelve features of each splat twice; records, order, ranks twice more,
    and a byte for whether it is opaque."""
    visible, *_ = memory._visible(scene.draw_list(), memory.Screen.of(VIEW))

    def per_splat(mode):
        settings = replace(SETTINGS, display_mode=mode)
        estimate = memory.estimate(
            scene, VIEW, settings, PictureRequest(), band_pixels=1 << 20, threads=2
        )
        return estimate.splats / visible

    assert per_splat("normals") - per_splat("splats") == pytest.approx(2 * 12 * 4)
    assert per_splat("ellipses") - per_splat("splats") == pytest.approx(2 * (12 + 1 + 1) * 4 + 1)
    assert per_splat("points") == per_splat("splats")


def test_every_aov_and_sample_takes_more(scene):
    """Oracle: the arrays: four float32 for colour, six numbers for the median, and so on."""
    plain = needed(scene).band
    assert needed(scene, "color", "depth").band - plain >= 24 * 64 * 256
    assert needed(scene, "color", "cryptoObject").band - plain >= 192 * 64 * 256
    blurred = RenderSettings(sorting="zDepth", color_mode="scene", samples=4)
    assert needed(scene, settings=blurred).band - plain == 16 * 64 * 256
    assert needed(scene, deep=True).band > needed(scene, baked=True).band > plain
    assert needed(scene, holds_out=True).splats > needed(scene).splats


@pytest.mark.parametrize("kind", ["flat", "deep"])
def test_a_holdout_takes_what_is_declared(tmp_path, kind):
    """Oracle: NumPy's own account of its arrays while a band is read; at least a third of it is
    used."""
    rows, columns = 300, 200
    if kind == "flat":
        layers = {"A": np.full((rows, columns), 0.5), "Z": np.full((rows, columns), 2.0)}
        flat(tmp_path / "a.exr", layers, full=(columns, rows))
    else:
        write_deep(tmp_path / "a.exr", deep_picture(rows, columns, most=20), merged=True)
    holdout = open_holdout(tmp_path / "a.exr", resolution=(columns, rows))
    tracemalloc.start()
    kept = holdout.rows(0, 0, columns, rows)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert kept
    expected = rows * columns * memory.HOLDOUT_ROWS + int(
        holdout.nodes * columns * (rows * memory.HOLDOUT_NODE + STRIP * memory.STRIP_NODE)
    )
    assert expected / 3 < peak < expected


def test_a_crop_of_a_deep_holdout_takes_what_is_declared(tmp_path):
    """Oracle: as above, of the crop's columns, and what two threads decode: four rows of 1,500
    columns."""
    rows, columns, crop = 64, 1500, (700, 732)
    write_deep(tmp_path / "a.exr", deep_picture(rows, columns, most=20), merged=True)
    holdout = open_holdout(tmp_path / "a.exr", resolution=(columns, rows))
    before = images.thread_count()
    images.limit_threads(2)
    try:
        tracemalloc.start()
        kept = holdout.rows(crop[0], 0, crop[1], rows)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
        images.limit_threads(before)
    assert len(kept[0]) == 32 * rows + 1
    expected = rows * 32 * memory.HOLDOUT_ROWS + int(
        holdout.nodes * 32 * rows * (memory.HOLDOUT_NODE + memory.STRIP_NODE)
    )
    assert peak < expected + 4 * 1500 * 20 * 40


@pytest.mark.parametrize("y0", [0, -8, 5])
def test_a_band_is_the_highest_of_the_picture(scene, y0):
    """Where the first and the last are lower. Oracle: the bands."""
    view = View(camera=VIEW.camera, framing=Framing(resolution=SIZE, data_window=(0, y0, 256, 200)))
    found = memory.estimate(
        scene, view, SETTINGS, PictureRequest(deep=True), band_pixels=64 * 256, threads=2
    )
    assert found.rows == 64
    assert found.band == pytest.approx(needed(scene, deep=True).band, rel=0.02)


def test_the_nodes_of_a_holdout_take_memory(scene):
    """Oracle: the declared bytes of a band of 64 rows, which is one strip."""
    plain, held = (needed(scene, holds_out=True, held_nodes=n).band for n in (0, 10))
    assert held - plain == 10 * 64 * 256 * (memory.HOLDOUT_NODE + memory.STRIP_NODE)


def test_deep_samples_are_those_of_a_strip_not_of_a_band(scene):
    """Oracle: of 32 more rows only the offsets grow, 8 bytes a pixel, where a strip has 32 rows;
    of the 32 rows of the strip also the samples."""

    def extra(rows):
        size = DEEP_PIXELS // 32, 128
        deep, flat = (
            needed(scene, size=size, rows=rows, deep=is_deep).band for is_deep in (True, False)
        )
        return deep - flat

    assert extra(64) - extra(32) == 8 * DEEP_PIXELS
    assert extra(32) - extra(16) == (8 + 48 * 80) * DEEP_PIXELS // 2


def test_a_band_is_linear_in_its_rows(scene):
    """Oracle: twice the rows are twice the pixels; nothing else grows so."""
    one, two, three = (needed(scene, rows=rows).band for rows in (16, 32, 48))
    assert two - one == pytest.approx(three - two, abs=2)


@pytest.mark.parametrize("limit", range(0, 130, 7))
def test_the_tallest_bands_that_fit_are_chosen(limit):
    """Oracle: all heights tried one by one."""

    def of(tiles):
        return memory.Estimate(held=20, splats=5, band=10 * tiles, rows=16 * tiles)

    tiles, found = memory.fitting(of, 9, limit)
    fits = [t for t in range(1, 10) if of(t).total <= limit]
    assert tiles == max(fits, default=1)
    assert found == of(tiles)


def test_the_system_says_what_is_held():
    """Oracle: 32 MiB of new pages that are written to; an array might reuse old ones."""
    before = memory.resident()
    with mmap.mmap(-1, 32 << 20) as held:
        held.write(b"x" * len(held))
        now = memory.resident()
    assert now - before >= 0.9 * (32 << 20)
