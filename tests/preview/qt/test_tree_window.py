"""Tests of a window with a splat tree, with mouse events."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from PySide6.QtTest import QTest

from tests.preview.qt.conftest import wait_until
from tests.preview.qt.windows import LEFT, click_cell, opened, settled
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
