"""What a picture is said to take."""

from __future__ import annotations

import mmap
from dataclasses import replace

import numpy as np
import pytest

from tests.render.rendering import lens, random_cloud, scene_of, view_of
from usdsplat.kernels.devices import open_device
from usdsplat.render import memory
from usdsplat.render.memory import PictureRequest
from usdsplat.render.renderer import Renderer
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import Framing, View

VIEW = view_of(lens())
SETTINGS = RenderSettings(sorting="zDepth", color_mode="scene")


@pytest.fixture
def scene():
    return scene_of((random_cloud(1), np.eye(4)))


def needed(scene, *aovs, settings=SETTINGS, size=(256, 256), rows=64, **options):
    view = View(camera=view_of(lens()).camera, framing=Framing(resolution=size))
    band = rows * size[0]
    request = PictureRequest(aovs=aovs or ("color",), **options)
    return memory.estimate(scene, view, settings, request, band_pixels=band)


@pytest.mark.parametrize("budget", [0, 100])
def test_the_seen_and_their_pairs_are_those_that_are_drawn(scene, budget):
    """Oracle: the renderer's own counts, from all splats, within a third."""
    renderer = Renderer(open_device())
    settings = replace(SETTINGS, splat_budget=budget)
    for _ in renderer.render(scene, view_of(lens()), settings, ("color",)):
        pass
    screen = memory.Screen.of(view_of(lens()))
    seen, pairs = memory._seen(scene.draw_list(budget), screen)
    assert renderer.stats.visible > 0
    assert seen == pytest.approx(renderer.stats.visible, rel=0.33)
    assert pairs == pytest.approx(renderer.stats.pairs, rel=0.33)


def test_display_modes_take_what_they_make(scene):
    """Oracle: the arrays: nine features of each splat twice; records, order, ranks twice more."""
    seen, _ = memory._seen(scene.draw_list(), memory.Screen.of(VIEW))

    def per_splat(mode):
        settings = replace(SETTINGS, display_mode=mode)
        estimate = memory.estimate(scene, VIEW, settings, PictureRequest(), band_pixels=1 << 20)
        return estimate.splats / seen

    assert per_splat("normals") - per_splat("splats") == pytest.approx(2 * 9 * 4)
    assert per_splat("ellipses") - per_splat("splats") == pytest.approx(2 * (12 + 1 + 1) * 4)
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
