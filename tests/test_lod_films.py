"""Tests of pictures of trees in motion, and of the measure of `benchmarks.lod_films`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import lod_films
from benchmarks.lod_films import Film
from benchmarks.lod_quality import tree_to_capture
from benchmarks.minification import Framing
from tests.interchange.lod.worlds import ground
from usdsplat import formats
from usdsplat.delegate.engine import Engine
from usdsplat.interchange.files import open_stage
from usdsplat.interchange.lod import LodOptions, build_tree
from usdsplat.render.lod.cut import FADE

SIZE = (64, 48)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """An engine of a tree of some levels, and views of a camera that moves away from it."""
    folder = tmp_path_factory.mktemp("films")
    cloud = ground(3000)
    formats.write(cloud, folder / "scan.ply")
    build_tree(folder / "scan.ply", folder / "tree.usda", options=LodOptions(leaf_splats=256))
    stage = open_stage(folder / "tree.usda")
    where = replace(Framing.of(cloud), radius=Framing.of(cloud).radius / 8)
    shots = list(lod_films.views("dolly", where, 48, SIZE, tree_to_capture(stage)))
    with Engine(stage, device="cpu") as engine:
        yield engine, shots


def test_a_view_with_its_own_cut(scene):
    """Oracle: the same picture without a given cut, bit for bit."""
    engine, shots = scene
    film = Film(engine)
    expected, cut = film.draw(shots[5])
    film.draw(shots[-1])
    found, _ = film.draw(shots[5], cut)
    np.testing.assert_array_equal(found, expected)


def test_a_view_with_the_cut_of_another(scene):
    """The cut of a far view is coarser. Oracle: near, the view's own cut draws the leaves."""
    engine, shots = scene
    film = Film(engine)
    near, far = (film.draw(shots[k])[1] for k in (0, -1))
    leaves, _ = film.draw(shots[0], error=0.0)
    fine, coarse = (film.draw(shots[0], cut)[0] for cut in (near, far))
    np.testing.assert_array_equal(fine, leaves)
    assert np.abs(coarse - leaves).max() > 10 / 255


def test_the_end_of_a_fade_is_the_beginning_of_a_coarser_one(scene):
    """Oracle: the range of a fade ends at FADE times its error, so both pictures have one cut."""
    engine, shots = scene
    film, view = Film(engine), shots[20]
    coarse, fine = (film.draw(view, error=1.0, fade=end)[0] for end in (1.0, 0.0))
    expected, _ = film.draw(view, error=FADE, fade=0.0)
    np.testing.assert_allclose(coarse, expected, atol=1e-6)
    assert np.abs(coarse - fine).max() > 5 / 255


def test_samples_fade_levels(scene):
    """Levels are faded in as many steps as a pixel has samples. Oracle: closed form: one of n steps
    changes n-th part of the samples, and a frame of this film sees less than half of the steps."""
    engine, shots = scene
    hard, soft = (lod_films.film(engine, shots, samples) for samples in (1, 4))
    assert max(hard.jump_together) > 10 / 255
    assert max(soft.jump_together) < 0.5 * max(hard.jump_together)


def test_squares_that_change_at_once():
    """Oracle: by hand: only the square has a change in all of its pixels."""
    values = np.zeros((9, 9), np.float32)
    values[2:7, 3:8] = 0.25
    values[0, 0] = 1
    found = lod_films.smallest(values, 5)
    assert found.max() == 0.25 and np.argwhere(found).tolist() == [[2, 3]]
