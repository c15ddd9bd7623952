"""Tests of the estimate of memory of pictures with trees."""

from __future__ import annotations

from tests.render.lod.test_nodes import tree_scene
from tests.render.lod.trees import made
from tests.render.rendering import lens, picture, settings_of, view_of
from usdsplat.render.lod.memory import PER_SPLAT, estimate
from usdsplat.render.memory import COLOR_ALONE


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
