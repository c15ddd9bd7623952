"""Tests of the colours of splat trees by level."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd

from tests.preview.documents import BLACK, SIZE
from tests.render.rendering import random_cloud
from tests.trees import little_tree
from usdsplat import schema
from usdsplat.preview.document import Document
from usdsplat.preview.tree_levels import NO_TREE, OTHERS, Levels, TreeLevels
from usdsplat.preview.values import Look, ViewState
from usdsplat.render.settings import RenderSettings

LEVELS = replace(BLACK, id_colors="levels")


@pytest.fixture
def stage(tmp_path):
    """A tree of a root, branches and leaves, and a field that is in no tree."""
    cloud = random_cloud(3, 400, 0)
    stage = Usd.Stage.Open(str(little_tree(tmp_path, replace(cloud, scales=0.4 * cloud.scales))))
    other = random_cloud(5, n=3)
    schema.author(stage, "/Field", replace(other, opacities=np.full(3, 0.99, np.float32)))
    return stage


@pytest.mark.parametrize("error", [0.0, 1000.0])
def test_each_pixel_has_the_colour_of_its_level(stage, events, error):
    """Oracle: the node whose run of element ids contains each pixel's, looked up one by one in the
    table of the tree."""
    document = Document(stage, publish=events.append)
    look = Look(aov="splatId", settings=RenderSettings(lod_error=error))
    state = ViewState(size=SIZE, look=look, display=LEVELS)
    shown = document.still(state)
    arrays, prims = shown.sides[0].arrays, shown.sides[0].scene.prims
    ((path, tree),) = document.engine.render_scene.drawn_trees()
    table, elements = tree.spec.table, tree.spec.first_elements()
    colors = Levels.of(document.engine.render_scene).colors
    level_of = {
        node: level
        for level, (start, end) in enumerate(table.levels())
        for node in range(start, end)
    }
    runs = {}
    for node in range(len(table)):
        is_leaf = table.child_count[node] == 0
        captured = table.residents[node] + (table.proxies[node] if is_leaf else 0)
        for first, count in (
            (elements[0, node], captured),
            (elements[1, node], 0 if is_leaf else table.proxies[node]),
        ):
            runs |= {int(first) + each: node for each in range(int(count))}
    seen = set()
    for y in range(SIZE[1]):
        for x in range(SIZE[0]):
            number, element = arrays["primId"][y, x], int(arrays["elementId"][y, x])
            pixel = tuple(shown.picture.image[y, x])
            if number < 0:
                assert pixel == (0, 0, 0)
            elif prims[number] == path:
                level = level_of[runs[element]]
                seen.add(level)
                assert pixel == tuple(colors[level + 1])
            else:
                assert pixel == OTHERS
    if error:
        assert seen == {0}
    else:  # the root keeps some splats of the capture
        assert len(table.levels()) - 1 in seen and seen <= {0, len(table.levels()) - 1}
    document.close()


def test_colours_of_elements_are_those_of_before_unless_levels_are_asked_for(stage, events):
    """Oracle: the picture of the ids themselves, which has many colours."""
    document = Document(stage, publish=events.append)
    look = Look(aov="splatId", settings=RenderSettings(lod_error=0.0))
    for display in (BLACK, LEVELS):
        document.still(ViewState(size=SIZE, look=look, display=display))
    plain, leveled = (
        document.still(ViewState(size=SIZE, look=look, display=display)).picture.image
        for display in (BLACK, LEVELS)
    )
    count = [len(np.unique(each.reshape(-1, 3), axis=0)) for each in (plain, leveled)]
    assert count[0] > 20 and count[1] <= 4
    document.close()


def test_pixels_without_a_tree_have_no_level():
    """Oracle: written down by hand."""
    levels = Levels({"/T": TreeLevels(np.array([0, 10, 40]), np.array([2, 1, 0], np.int32), 3)})
    ids = np.array([[-1, 0, 1, 1, 1]], np.int32)
    found = levels.at(ids, np.array([[-1, 12, 9, 10, 41]], np.int32), ("/F", "/T"))
    assert found.tolist() == [[-1, NO_TREE, 3, 2, 1]]
    assert len(levels.colors) == 4
