"""Tests of the estimate of memory of pictures with trees."""

from __future__ import annotations

import numpy as np
import pytest

from tests.render.lod.test_nodes import tree_scene
from tests.render.lod.trees import made
from tests.render.rendering import lens, picture, settings_of, view_of
from usdsplat.render.lod.memory import PER_SPLAT, estimate, view_load
from usdsplat.render.memory import COLOR_ALONE
from usdsplat.render.specs import InstanceSpec


def test_a_finer_cut_takes_more_and_nothing_is_read():
    """Oracle: the counts of splats of the cuts, by hand: the root's proxies, and all leaves."""
    tree = made(1, leaf=50)
    scene, view = tree_scene(tree), view_of(lens())

    def estimated(**settings):
        return estimate(
            scene, view, settings_of(**settings), COLOR_ALONE, band_pixels=1 << 20, threads=2
        )

    coarse, fine = estimated(lod_error=1000.0), estimated(lod_error=0.0)
    few, many = int(tree.table.proxies[0]), len(tree.leaves())
    assert fine.splats - coarse.splats == PER_SPLAT * (many - few)
    one = 4 * (3 + 4 + 3 + 1 + 48)
    assert abs(fine.held - coarse.held - one * (many - few)) < 20 << 20  # of the process itself
    assert tree.reads == []
    picture(scene, view, aovs=("color",), lod_error=0.0)
    assert scene.node_cache.bytes == one * many


@pytest.mark.parametrize("settings", [{}, {"lod_samples": 1}, {"splat_budget": 700}])
@pytest.mark.parametrize("error", [0.0, 0.7, 3.0, 1000.0])
def test_a_load_is_what_a_picture_reads(error, settings):
    """Oracle: the cache of the renderer after the picture, and the reads of the tree's nodes."""
    tree = made(1, leaf=20, strays=9)
    moves = [(0, 0, 0), (0.5, 0, -4), (0, 0, -40), (900, 0, 0)]
    transforms = [(1, 0, 0, x, 0, 1, 0, y, 0, 0, 1, z, 0, 0, 0, 1) for x, y, z in moves]
    instances = [
        InstanceSpec(path="/tree", index=index, transform=transform)
        for index, transform in enumerate(transforms)
    ]
    scene, view = tree_scene(tree, *instances), view_of(lens())
    settings = {"lod_error": error, **settings}
    load = view_load(scene, view, settings_of(**settings))
    assert tree.reads == []
    picture(scene, view, aovs=("color",), **settings)
    assert load.bytes == scene.node_cache.bytes
    assert load.nodes == len({chunk for chunk, _, _ in tree.reads})


@pytest.mark.parametrize("error", [0.0, 2.0, 1000.0])
def test_instances_share_the_memory_of_their_nodes(error):
    """Oracle: the bytes of the cache after the picture, of instances of different cuts."""
    tree = made(2, leaf=20, strays=3)
    matrices = [np.diag([size, size, size, 1.0]) for size in (1.0, 0.5, 0.1, 1.0)]
    matrices[1][0, 3] = 2.5  # beside the window in part
    instances = tuple(
        InstanceSpec(path="/tree", transform=tuple(matrix.ravel()), index=index)
        for index, matrix in enumerate(matrices)
    )
    scene, view = tree_scene(tree), view_of(lens())
    scene.set_instances("/tree", instances)
    settings = settings_of(lod_error=error, lod_samples=1)
    expected = view_load(scene, view, settings).bytes
    assert tree.reads == []
    picture(scene, view, aovs=("color",), lod_error=error, lod_samples=1)
    assert scene.node_cache.bytes == expected > 0
