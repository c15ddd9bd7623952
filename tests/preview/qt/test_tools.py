"""Tests of tools, fixed views, selection and OCIO menus in a window, with mouse and key events."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QToolButton

from tests.preview.qt.conftest import wait_until
from tests.preview.qt.windows import LEFT, image, press, settled
from usdsplat.preview.document import Document
from usdsplat.preview.qt.window import TOOLS, Window
from usdsplat.preview.qt.workspace import Workspace
from usdsplat.preview.reading import read_window
from usdsplat.render.settings import RenderSettings

NONE, SHIFT = Qt.KeyboardModifier.NoModifier, Qt.KeyboardModifier.ShiftModifier
MODES = {"Q": None, "W": "translate", "E": "rotate", "R": "scale"}


@pytest.mark.parametrize("place", ["viewport", "tree", "panel"])
def test_the_keys_of_tools_work_wherever_the_focus_is(
    window: Window, workspace: Workspace, place: str
) -> None:
    """Oracle: the table of keys; a tree's type-ahead would take letters for names."""
    widgets = {
        "viewport": workspace.viewport,
        "tree": workspace.tree.view,
        "panel": workspace.render_panel.aov,
    }
    settled(workspace)
    for key, mode in MODES.items():
        widgets[place].setFocus()
        QTest.keyClick(widgets[place], getattr(Qt.Key, f"Key_{key}"))
        wait_until(lambda mode=mode: workspace.viewport.mode == mode)
        checked = [name for name in TOOLS if window.actions_by_name[name].isChecked()]
        assert checked == [f"tool_{mode or 'none'}"]


def test_letters_in_a_text_field_stay_there(window: Window, workspace: Workspace) -> None:
    """Oracle: a person's expectation."""
    settled(workspace)
    mode = workspace.viewport.mode
    QTest.mouseClick(workspace.tree.box, LEFT)
    QTest.keyClicks(workspace.tree.box, "were")
    assert workspace.tree.box.text() == "were" and workspace.viewport.mode == mode


def test_the_tool_bar_has_a_button_for_each_tool(window: Window, workspace: Workspace) -> None:
    """Oracle: the manipulator's mode after a click."""
    buttons = workspace.strip.findChildren(QToolButton)[: len(TOOLS)]
    for button, mode in zip(buttons, MODES.values(), strict=True):
        QTest.mouseClick(button, LEFT)
        assert workspace.viewport.mode == mode and button.isChecked()


def test_escape_goes_back_to_the_viewport_and_then_clears_the_selection(
    window: Window, workspace: Workspace
) -> None:
    """Oracle: the focus, then the selection."""
    settled(workspace)
    workspace.context.viewer.select(("/World/A",))
    QTest.mouseClick(workspace.tree.box, LEFT)
    press(window, "Escape")
    wait_until(workspace.viewport.hasFocus)
    assert workspace.context.viewer.state.selected == ("/World/A",)
    press(window, "Escape")
    wait_until(lambda: workspace.context.viewer.state.selected == ())


@pytest.mark.parametrize(("key", "out"), [("1", (0, 0, 1)), ("3", (1, 0, 0)), ("7", (0, 1, 0))])
def test_numbers_are_views_from_the_sides(workspace: Workspace, key: str, out: tuple) -> None:
    """Oracle: the direction from the target to the eye on a stage with y up."""
    before = settled(workspace)
    QTest.keyClick(workspace.viewport, Qt.Key(ord(key)))
    wait_until(lambda: workspace.context.viewer.state.camera is not None)
    camera = workspace.context.viewer.free_camera()
    assert camera is not None
    direction = np.subtract(camera.eye, camera.target) / camera.distance
    assert direction == pytest.approx(out, abs=1e-5)
    assert settled(workspace).number > before.number


def test_a_click_with_shift_adds_to_the_selection_and_takes_out(workspace: Workspace) -> None:
    """Oracle: what a click alone selects at the same places; the tree shows the same rows, and does
    not take any away once the window rests."""
    picture = settled(workspace)
    workspace.viewport.set_mode(None)  # its handles would take clicks
    height, width = picture.image.shape[:2]
    viewer = workspace.context.viewer
    found: dict[str, QPoint] = {}
    ratio = workspace.viewport.devicePixelRatioF()
    rows = np.linspace(0.2, 0.8, 7)
    for x in np.linspace(0.1, 0.9, 17):
        for y in rows:
            point = QPoint(int(x * width / ratio), int(y * height / ratio))
            viewer.select(())
            QTest.mouseClick(workspace.viewport, LEFT, pos=point)
            done: list[object] = []
            workspace.proxy.ask(lambda document: None, done.append)
            wait_until(lambda done=done: done)
            for path in viewer.state.selected:
                found.setdefault(path, point)
        if len(found) > 1:
            break
    (one, here), (two, there) = list(found.items())[:2]
    shift, alone = Qt.KeyboardModifier.ShiftModifier, Qt.KeyboardModifier.NoModifier
    viewer.select(())
    steps = [(alone, here, (one,)), (shift, there, (one, two)), (shift, here, (two,))]
    for modifier, place, expected in steps:
        QTest.mouseClick(workspace.viewport, LEFT, modifier, pos=place)
        wait_until(lambda expected=expected: viewer.state.selected == expected)
        wait_until(lambda expected=expected: _in_tree(workspace) == set(expected))
        settled(workspace)
        assert viewer.state.selected == expected


def _in_tree(workspace: Workspace) -> set[str]:
    """The paths of the selected rows of the tree of prims."""
    rows = map(workspace.tree.model.row_of, workspace.tree.view.selectionModel().selectedRows())
    return {row.path for row in rows if row}


def test_a_view_is_chosen_from_a_menu_and_is_seen(workspace: Workspace) -> None:
    """Oracle: the names that OpenImageIO reads from the config; the picture changes."""
    import OpenImageIO as oiio

    panel = workspace.render_panel
    before = image(workspace)
    known = oiio.ColorConfig("ocio://cg-config-latest")
    panel._set_setting("ocio_config", "ocio://cg-config-latest", "")
    row = panel.settings.row("ocio_view")
    first = known.getDisplayNames()[0]
    box = row.widget._box
    offered = [box.itemText(index) for index in range(1, box.count())]
    assert offered == list(known.getViewNames(first))
    index = next(i for i, name in enumerate(offered, 1) if "ACES" in name)
    box.activated.emit(index)
    settings = workspace.context.viewer.state.look.settings
    assert (settings.ocio_view, settings.color_mode) == (offered[index - 1], "scene")
    wait_until(lambda: not np.array_equal(image(workspace), before))
    panel.settings.row("ocio_view").widget._box.activated.emit(0)
    panel._set_setting("ocio_config", "", "")
    assert workspace.context.viewer.state.look.settings == RenderSettings()
    wait_until(lambda: np.array_equal(image(workspace), before))


def box_of(workspace: Workspace, paths: tuple[str, ...]) -> tuple[QPoint, QPoint]:
    """A rectangle of the viewport with everything that is seen of some prims, and a margin."""
    done: list[tuple[int, int, int, int]] = []

    def task(document: Document) -> tuple[int, int, int, int]:
        side, size = document.shown.sides[0], document.shown.picture.state.size
        ids = read_window(side, size, (0, 0, *size), ("primId",))["primId"]
        names = side.scene.engine.drawn_paths()
        rows, columns = np.nonzero(np.isin(ids, [names.index(each) for each in paths]))
        return columns.min() - 3, rows.min() - 3, columns.max() + 3, rows.max() + 3

    workspace.proxy.ask(task, done.append)
    wait_until(lambda: done)
    x0, y0, x1, y1 = done[0]
    ratio = workspace.viewport.devicePixelRatioF()
    return QPoint(int(x0 / ratio), int(y0 / ratio)), QPoint(int(x1 / ratio), int(y1 / ratio))


def drag_box(workspace: Workspace, start: QPoint, end: QPoint, modifiers=NONE) -> None:
    """Press, move and release the left button."""
    viewport = workspace.viewport
    QTest.mousePress(viewport, LEFT, modifiers, start)
    for part in (0.3, 0.7, 1.0):
        place = QPointF(start + (end - start) * part)
        event = QMouseEvent(
            QEvent.Type.MouseMove, place, viewport.mapToGlobal(place),
            Qt.MouseButton.NoButton, LEFT, modifiers,
        )  # fmt: skip
        QApplication.sendEvent(viewport, event)
    QTest.mouseRelease(viewport, LEFT, modifiers, end)


def test_a_box_selects_what_is_seen_in_it(workspace: Workspace) -> None:
    """Oracle: rectangles around the pixels of the prims, by the AOV; the view does not move."""
    settled(workspace)
    workspace.context.viewer.face("front")
    settled(workspace)
    workspace.viewport.set_mode(None)
    viewer = workspace.context.viewer
    camera = viewer.state.camera
    one, all_of_it = box_of(workspace, ("/World/A",)), box_of(workspace, ("/World/A", "/World/B"))
    viewer.select(())
    drag_box(workspace, *all_of_it)
    wait_until(lambda: viewer.state.selected == ("/World/A", "/World/B"))
    empty = QPoint(2, 2), QPoint(30, 30)
    drag_box(workspace, *empty, SHIFT)
    drag_box(workspace, *reversed(one), SHIFT)
    wait_until(lambda: set(viewer.state.selected) == {"/World/A", "/World/B"})
    drag_box(workspace, *empty)
    wait_until(lambda: viewer.state.selected == ())
    assert viewer.state.camera == camera


def test_ctrl_draws_a_box_with_any_tool(workspace: Workspace) -> None:
    """Oracle: the selection; without Ctrl the same drag moves the view, and selects nothing."""
    settled(workspace)
    viewer = workspace.context.viewer
    workspace.viewport.set_mode("translate")
    viewer.select(())
    box = box_of(workspace, ("/World/A", "/World/B"))
    drag_box(workspace, *box, Qt.KeyboardModifier.ControlModifier)
    wait_until(lambda: viewer.state.selected == ("/World/A", "/World/B"))
    viewer.select(())
    before = viewer.state.camera
    drag_box(workspace, *box)
    wait_until(lambda: viewer.state.camera != before)
    settled(workspace)
    assert viewer.state.selected == ()
