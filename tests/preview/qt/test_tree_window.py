"""Tests of a window with a splat tree, with mouse events."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from PySide6.QtTest import QTest

from tests.preview.qt.conftest import wait_until
from tests.preview.qt.windows import LEFT, click_cell, opened, press, settled
from tests.render.rendering import random_cloud
from tests.trees import little_tree
from usdsplat.preview.qt.prim_model import NAME
from usdsplat.preview.qt.window import Window
from usdsplat.preview.qt.workspace import Workspace
from usdsplat.render.settings import RenderSettings

TREE = "/tree/splats"


def fact(workspace: Workspace, name: str) -> str:
    """The text of a row of the selected prim; "" if there is none."""
    rows = workspace.prim.properties.rows
    return next((row.text for row in rows if row.name == name), "")


def test_a_selected_tree_says_what_of_it_is_drawn_as_the_view_changes(
    window: Window, tmp_path: Path
) -> None:
    """Oracle: counts by hand: the root with its resident, then the four leaves with that resident.
    The search finds the tree by its type."""
    workspace = opened(window, little_tree(tmp_path, random_cloud(3, 400, 0)))
    viewer = workspace.context.viewer
    viewer.set_look(settings=RenderSettings(lod_error=1000.0))
    settled(workspace)
    click_cell(workspace, TREE, NAME)
    wait_until(lambda: fact(workspace, "Drawn now").startswith("1 nodes"))
    assert (fact(workspace, "Nodes"), fact(workspace, "Levels")) == ("7", "3")
    viewer.set_look(settings=replace(viewer.state.look.settings, lod_error=0.0))
    picture = settled(workspace)
    assert picture.missing == 0
    wait_until(lambda: fact(workspace, "Drawn now") == "5 nodes, 400 splats")
    QTest.mouseClick(workspace.tree.box, LEFT)
    QTest.keyClicks(workspace.tree.box, "splattree")
    found = workspace.tree.found
    wait_until(lambda: found.count() and found.isVisible())
    assert [found.item(i).text() for i in range(found.count())] == [TREE]


def test_a_key_shows_the_levels_of_trees_and_colour_again(window: Window, tmp_path: Path) -> None:
    """Oracle: the AOV and the colours of the picture: that of the root, and those of before."""
    workspace = opened(window, little_tree(tmp_path, random_cloud(3, 400, 0)))
    workspace.context.viewer.set_look(settings=RenderSettings(lod_error=1000.0))
    before = settled(workspace).image
    workspace.viewport.setFocus()
    press(window, "5")
    wait_until(lambda: workspace.strip.aov.currentText() == "splatId")
    found = np.unique(settled(workspace).image.reshape(-1, 3), axis=0)
    assert len(found) == 2 and window.actions_by_name["levels"].isChecked()
    press(window, "5")
    wait_until(lambda: workspace.strip.aov.currentText() == "color")
    assert np.array_equal(settled(workspace).image, before)
