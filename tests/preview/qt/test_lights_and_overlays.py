"""Tests of lights, bounds and wireframes in a window, with mouse and key events."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdLux
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest

from tests.preview.qt import windows
from tests.preview.qt.conftest import wait_until
from tests.preview.qt.windows import LEFT, opened, press, settled
from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.document import Document
from usdsplat.preview.overlays import LightMark
from usdsplat.preview.projection import Projection
from usdsplat.preview.qt.viewport_figures import EdgeLines, lights_at
from usdsplat.preview.qt.viewport_targets import with_lights
from usdsplat.preview.qt.window import Window
from usdsplat.preview.qt.workspace import Workspace

PLACE = (0.5, 2.0, 1.0)


@pytest.fixture
def workspace(window: Window, tmp_path: Path) -> Workspace:
    """Two fields, a light and a mesh."""
    path = windows.write_stage(tmp_path / "lit.usda")
    stage = Usd.Stage.Open(str(path))
    light = UsdLux.SphereLight.Define(stage, "/Key")
    light.AddTranslateOp().Set(Gf.Vec3d(*PLACE))
    plate = UsdGeom.Mesh.Define(stage, "/World/Plate")
    plate.CreatePointsAttr([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
    plate.CreateFaceVertexCountsAttr([4])
    plate.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    plate.CreateSubdivisionSchemeAttr("none")
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
    """Oracle: the selection, with Shift beside the others or no longer, and the light's place on
    the stage after its arrow was dragged: only x is another one."""
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
    QTest.mouseClick(workspace.viewport, LEFT, Qt.KeyboardModifier.ShiftModifier, pos=here)
    wait_until(lambda: viewer.state.selected == ("/World/A",))
    QTest.mouseClick(workspace.viewport, LEFT, Qt.KeyboardModifier.ShiftModifier, pos=here)
    wait_until(lambda: viewer.placement is not None and viewer.placement.path == "/Key")
    settled(workspace)
    workspace.viewport.set_mode("translate")
    arrow = here + QPoint(40, 0)
    QTest.mousePress(workspace.viewport, LEFT, pos=arrow)
    for step in (5, 15, 30):
        QTest.mouseMove(workspace.viewport, arrow + QPoint(step, 0))
    QTest.mouseRelease(workspace.viewport, LEFT, pos=arrow + QPoint(30, 0))
    wait_until(lambda: place_of(workspace) != here)
    (mark,) = settled(workspace).overlays.lights
    assert mark.place[0] > PLACE[0] + 0.01
    np.testing.assert_allclose(mark.place[1:], PLACE[1:], atol=1e-9)


def test_escape_takes_the_drag_of_a_handle_back(window: Window, workspace: Workspace) -> None:
    """Oracle: the opinions of the session layer and the place before, though the pointer goes on;
    nothing of it is left to undo."""
    viewer, viewport = workspace.context.viewer, workspace.viewport
    viewer.face("front")
    viewer.select(("/Key",))
    here = place_of(workspace)
    wait_until(lambda: viewport.manipulator is not None)
    layers: list[str] = []

    def told(document: Document) -> str:
        return document.edits.layer.ExportToString()

    workspace.proxy.ask(told, layers.append)
    viewport.setFocus()
    arrow = here + QPoint(40, 0)
    QTest.mousePress(viewport, LEFT, pos=arrow)
    for step in (5, 15, 30):
        QTest.mouseMove(viewport, arrow + QPoint(step, 0))
    wait_until(lambda: window.actions_by_name["undo"].isEnabled())
    QTest.keyClick(viewport, Qt.Key.Key_Escape)
    QTest.mouseMove(viewport, arrow + QPoint(60, 0))
    QTest.mouseRelease(viewport, LEFT, pos=arrow + QPoint(60, 0))
    wait_until(lambda: not window.actions_by_name["undo"].isEnabled())
    workspace.proxy.ask(told, layers.append)
    wait_until(lambda: len(layers) == 2)
    assert layers[1] == layers[0]
    assert place_of(workspace) == here and viewer.state.selected == ("/Key",)
    assert viewer.placement is not None
    np.testing.assert_allclose(np.reshape(viewer.placement.matrix, (4, 4))[:3, 3], PLACE)


def test_a_box_selects_the_lights_in_it(workspace: Workspace) -> None:
    """Oracle: the place of the light's figure, and the way out of it."""
    viewer, viewport = workspace.context.viewer, workspace.viewport
    viewer.face("front")
    here = place_of(workspace)
    viewport.set_mode(None)
    for start, end, found in (
        (QPoint(-8, -8), QPoint(8, 8), True),
        (QPoint(-30, -8), QPoint(-8, 8), False),
    ):
        QTest.mousePress(viewport, LEFT, pos=here + start + QPoint(0, -30) * (not found))
        for part in (0.4, 0.7, 1.0):
            QTest.mouseMove(viewport, here + start + (end - start) * part)
        QTest.mouseRelease(viewport, LEFT, pos=here + end)
        wait_until(lambda found=found: ("/Key" in viewer.state.selected) == found)


def test_lights_at_one_place_are_picked_in_turn_and_those_without_one_not() -> None:
    """Oracle: the rules of a click: the nearest, then the others there; Shift adds one after the
    other, and takes one out when all are selected. A dome that was never moved is no target."""
    at, identity = (1, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1, 3, 0, 0, 0, 1), tuple(np.eye(4).ravel())
    marks = [LightMark(path=path, shape="sphere", matrix=at) for path in ("/B", "/A")]
    camera = FreeCamera(eye=(0, 0, 20), target=(0, 0, 0)).spec(aspect=1.0, bounds=None)
    projection = Projection.of(camera, (400, 400))
    x, y = projection.pixels(marks[0].place)[0]
    both = lights_at(marks, (x + 2, y), projection, ratio=1.0)
    assert both == ("/A", "/B")
    for shape in ("dome", "distant"):
        mark = LightMark(path="/Sky", shape=shape, matrix=identity)
        assert lights_at([mark], (200, 200), projection, ratio=1.0) == ()
        moved = replace(mark, matrix=at)
        assert lights_at([moved], (x, y), projection, ratio=1.0) == ("/Sky",)
    selected = ("/C",)
    for expected in (("/A",), ("/B",), ("/A",)):
        selected = with_lights(selected, both, adds=False)
        assert selected == expected
    for expected in (("/A", "/B"), ("/B",), ("/B", "/A")):
        selected = with_lights(selected, both, adds=True)
        assert selected == expected


def test_edges_become_lines_once_for_a_picture_and_a_size(workspace: Workspace) -> None:
    """Oracle: the same list for a repaint; four sides of the plate and a diagonal, as a surface
    of one face has those of its triangles."""
    press(workspace.window(), "4")
    wait_until(lambda: len(settled(workspace).overlays.edges) == 1)
    picture, projection = settled(workspace), workspace.viewport.projection
    assert projection is not None
    made, size = EdgeLines(lambda overlays: overlays.edges), picture.state.size
    lines = made.of(picture, size, projection)
    assert len(lines) == 5 and made.of(picture, size, projection) is lines
    assert made.of(picture, (10, 10), projection) is not lines
    assert made.of(replace(picture), (10, 10), projection) is not lines


def test_edges_that_reach_behind_the_camera_are_cut(workspace: Workspace) -> None:
    """Oracle: the projection of each line alone, which is cut at the near plane; the camera is at
    the middle of the plate and looks along it."""
    press(workspace.window(), "4")
    wait_until(lambda: len(settled(workspace).overlays.edges) == 1)
    workspace.context.viewer.use_camera(FreeCamera(eye=(0.0, 0.05, 0.1), target=(0.9, 0.0, 0.0)))
    picture, projection = settled(workspace), workspace.viewport.projection
    assert projection is not None
    (plate,) = picture.overlays.edges
    lines = EdgeLines(lambda overlays: overlays.edges).of(picture, (64, 48), projection)
    segments = plate.segments @ plate.to_world[:3, :3].T + plate.to_world[:3, 3]
    expected = [line for line in (projection.line(*ends) for ends in segments) if line is not None]
    assert 1 < len(expected) < 5
    depths = projection.depths(segments.reshape(-1, 3)).reshape(-1, 2)
    assert ((depths < 0).any(axis=1) & (depths > 0).any(axis=1)).any(), "one is cut"
    found = [((line.x1(), line.y1()), (line.x2(), line.y2())) for line in lines]
    assert np.array(found) == pytest.approx(np.array(expected))


def test_menus_show_and_hide_bounds_wireframes_and_lights(
    window: Window, workspace: Workspace
) -> None:
    """Oracle: the overlays of the picture, and the marks in the menu."""
    workspace.viewport.setFocus()
    for keys, name, count in (("B", "bounds", 3), ("4", "edges", 1), ("L", "lights", 0)):
        press(window, keys)
        wait_until(
            lambda name=name, count=count: len(getattr(settled(workspace).overlays, name)) == count
        )
    state = workspace.context.viewer.state
    assert (state.shows_bounds, state.shows_edges, state.shows_lights) == (True, True, False)
    names = ("bounds", "wireframe", "lights")
    checked = [window.actions_by_name[each].isChecked() for each in names]
    assert checked == [True, True, False]
