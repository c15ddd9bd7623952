"""Tests of lights, bounds and wireframes in a window, with mouse and key events."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdLux
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest

from tests.preview.qt import windows
from tests.preview.qt.conftest import wait_until
from tests.preview.qt.windows import LEFT, opened, press, settled
from usdsplat.preview.qt.window import Window
from usdsplat.preview.qt.workspace import Workspace

PLACE = (0.5, 2.0, 1.0)


@pytest.fixture
def workspace(window: Window, tmp_path: Path) -> Workspace:
    """Two fields and a light."""
    path = windows.write_stage(tmp_path / "lit.usda")
    stage = Usd.Stage.Open(str(path))
    light = UsdLux.SphereLight.Define(stage, "/Key")
    light.AddTranslateOp().Set(Gf.Vec3d(*PLACE))
    stage.Save()
    return opened(window, path)


def place_of(workspace: Workspace) -> QPoint:
    """Where the window shows the light."""
    viewport = workspace.viewport
    (mark,) = settled(workspace).overlays.lights
    assert viewport.projection is not None
    x, y = viewport.projection.pixels(mark.place)[0] / viewport.devicePixelRatioF()
    return QPoint(round(x), round(y))


def test_a_light_is_picked_by_its_figure_and_moved(workspace: Workspace) -> None:
    """Oracle: the selection, and the light's matrix on the stage after an arrow was dragged."""
    viewer = workspace.context.viewer
    viewer.face("front")
    here = place_of(workspace)
    QTest.mouseClick(workspace.viewport, LEFT, pos=here + QPoint(3, 2))
    wait_until(lambda: viewer.state.selected == ("/Key",))
    viewer.select(("/World/A",))
    workspace.viewport.set_mode(None)
    QTest.mouseClick(workspace.viewport, LEFT, Qt.KeyboardModifier.ShiftModifier, pos=here)
    wait_until(lambda: viewer.state.selected == ("/World/A", "/Key"))
    wait_until(lambda: viewer.placement is not None and viewer.placement.path == "/Key")
    matrix = np.reshape(viewer.placement.matrix, (4, 4)).copy()
    np.testing.assert_allclose(matrix[:3, 3], PLACE)
    matrix[0, 3] += 1.0
    viewer.begin_drag()
    viewer.place(tuple(matrix.ravel()))
    viewer.end_move()
    wait_until(lambda: place_of(workspace) != here)
    (mark,) = settled(workspace).overlays.lights
    np.testing.assert_allclose(mark.place, (PLACE[0] + 1.0, *PLACE[1:]))


def test_menus_show_and_hide_bounds_wireframes_and_lights(
    window: Window, workspace: Workspace
) -> None:
    """Oracle: the overlays of the picture, and the marks in the menu."""
    workspace.viewport.setFocus()
    for keys, name, count in (("B", "bounds", 2), ("4", "edges", 0), ("L", "lights", 0)):
        press(window, keys)
        wait_until(
            lambda name=name, count=count: len(getattr(settled(workspace).overlays, name)) == count
        )
    state = workspace.context.viewer.state
    assert (state.shows_bounds, state.shows_edges, state.shows_lights) == (True, True, False)
    names = ("bounds", "wireframe", "lights")
    checked = [window.actions_by_name[each].isChecked() for each in names]
    assert checked == [True, True, False]
