"""Tests of values that are edited in the list of properties, with mouse and key events."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtGui import QWheelEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QLineEdit, QTreeView

from tests.preview.qt import windows
from tests.preview.qt.conftest import wait_until
from tests.preview.qt.windows import LEFT, click_cell, opened, press, type_into, write_stage
from usdsplat.preview.dragging import as_matrix
from usdsplat.preview.qt.panel_context import PAUSE
from usdsplat.preview.qt.prim_model import NAME
from usdsplat.preview.qt.window import Window
from usdsplat.preview.qt.workspace import Workspace


def focused() -> QLineEdit:
    """The field that has the focus."""
    field = QApplication.focusWidget()
    assert isinstance(field, QLineEdit)
    return field


@pytest.mark.parametrize(
    ("name", "tabs", "shown"), [("focalLength", 0, "35"), ("clippingRange", 1, "(0.1, 35)")]
)
def test_a_double_click_takes_digits_and_enter_and_tool_keys_work_after_it(
    window: Window, workspace: Workspace, name: str, tabs: int, shown: str
) -> None:
    """Oracle: digits go to where the focus is, as a person's do; the value, the search box and the
    tool that is chosen."""
    click_cell(workspace, "/Camera", NAME)
    rows, view = workspace.prim.properties, workspace.prim.view
    wait_until(lambda: any(row.name == name for row in rows.rows))
    number = next(i for i, row in enumerate(rows.rows) if row.name == name)
    index = rows.index(number, 1)
    view.scrollTo(index)
    place = view.visualRect(index).center()
    QTest.mouseClick(view.viewport(), LEFT, pos=place)
    QTest.mouseDClick(view.viewport(), LEFT, pos=place)
    for _ in range(tabs):
        focused().nextInFocusChain().setFocus()
    assert focused().selectedText() == focused().text() != ""
    QTest.keyClicks(focused(), "35")
    QTest.keyClick(focused(), Qt.Key.Key_Return)
    wait_until(lambda: rows.rows[number].text.startswith(shown))
    assert view.hasFocus()
    workspace.viewport.set_mode(None)
    QTest.keyClick(QApplication.focusWidget(), Qt.Key.Key_W)
    wait_until(lambda: workspace.viewport.mode == "translate")
    assert workspace.tree.box.text() == ""


def test_a_prim_is_moved_turned_and_scaled_by_typed_numbers(
    window: Window, workspace: Workspace
) -> None:
    """Oracle: the placement that the manipulator has; undo takes each number back, and a drag of a
    handle is seen in the fields."""
    click_cell(workspace, "/World/A", NAME)
    fields, viewer = workspace.prim.pose.fields, workspace.context.viewer
    wait_until(lambda: workspace.prim.pose.isVisible() and viewer.placement is not None)

    def matrix() -> np.ndarray:
        assert viewer.placement is not None
        return np.reshape(viewer.placement.matrix, (4, 4))

    before = matrix()
    assert fields["translate", 0].value == pytest.approx(before[0, 3])
    type_into(fields["translate", 0], "1.5")
    wait_until(lambda: matrix()[0, 3] == pytest.approx(1.5))
    type_into(fields["rotate", 2], "90")
    wait_until(lambda: matrix()[1, 0] == pytest.approx(1.0))
    type_into(fields["scale", 1], "3")
    wait_until(lambda: np.linalg.norm(matrix()[:3, 1]) == pytest.approx(3.0))
    assert window.actions_by_name["undo"].text() == "Undo Scale A"
    assert fields["rotate", 2].text().startswith("90")
    for _ in range(3):
        press(window, "Ctrl+Z")
    wait_until(lambda: np.allclose(matrix(), before))
    wait_until(lambda: fields["scale", 1].value == 1.0 and fields["rotate", 2].value == 0.0)
    viewer.begin_drag()
    moved = before.copy()
    moved[1, 3] += 0.25
    viewer.place(as_matrix(moved))
    wait_until(lambda: fields["translate", 1].value == pytest.approx(moved[1, 3]))


@pytest.mark.parametrize("other", ["/World/B", ""])
def test_a_typed_number_moves_the_prim_that_it_was_typed_for(
    window: Window, workspace: Workspace, other: str
) -> None:
    """Oracle: a number without Return when another prim is selected, or none, is the first prim's:
    its field, the only step of the undo history, and no problem."""
    viewer, undo = workspace.context.viewer, window.actions_by_name["undo"]
    click_cell(workspace, "/World/A", NAME)
    wait_until(workspace.prim.pose.isVisible)
    field = workspace.prim.pose.fields["translate", 0]
    before = field.value
    QTest.mouseClick(field, LEFT)
    field.selectAll()
    QTest.keyClicks(field, "7")
    if other:
        viewer.select((other,))
    else:
        press(window, "Ctrl+Shift+A")
    assert viewer.state.selected == ((other,) if other else ())
    wait_until(lambda: undo.text() == "Undo Move A")
    windows.settled(workspace)
    assert workspace.problems.sentence == ""
    click_cell(workspace, "/World/A", NAME)
    wait_until(lambda: workspace.prim.pose.isVisible() and field.value == pytest.approx(7.0))
    press(window, "Ctrl+Z")
    wait_until(lambda: field.value == pytest.approx(before) and not undo.isEnabled())


@pytest.mark.parametrize("uses_wheel", [False, True])
def test_no_step_of_arrow_keys_or_the_wheel_is_lost_and_one_undo_takes_them_back(
    window: Window, workspace: Workspace, uses_wheel: bool
) -> None:
    """Oracle: 30 steps of 0.1, as fast as a held key; the field and the placement."""
    click_cell(workspace, "/World/A", NAME)
    field, viewer = workspace.prim.pose.fields["translate", 1], workspace.context.viewer
    wait_until(lambda: workspace.prim.pose.isVisible() and viewer.placement is not None)
    type_into(field, "0.5")
    wait_until(lambda: window.actions_by_name["undo"].isEnabled())
    place = QPointF(5.0, 5.0)
    for _ in range(30):
        if uses_wheel:
            event = QWheelEvent(
                place,
                field.mapToGlobal(place),
                QPoint(),
                QPoint(0, 120),
                Qt.MouseButton.NoButton,
                Qt.KeyboardModifier.NoModifier,
                Qt.ScrollPhase.NoScrollPhase,
                False,
            )
            QApplication.sendEvent(field, event)
        else:
            QTest.keyClick(field, Qt.Key.Key_Up)
        QTest.qWait(30)
    assert field.value == pytest.approx(3.5)

    def height() -> float:
        assert viewer.placement is not None
        return float(np.reshape(viewer.placement.matrix, (4, 4))[1, 3])

    wait_until(lambda: height() == pytest.approx(3.5))
    QTest.qWait(3 * PAUSE)  # the last answers are in
    assert field.value == pytest.approx(3.5)
    press(window, "Ctrl+Z")
    wait_until(lambda: height() == pytest.approx(0.5) and field.value == pytest.approx(0.5))


def test_a_factor_of_zero_is_refused_and_the_old_one_comes_back(workspace: Workspace) -> None:
    """Oracle: the sentence, and the field."""
    click_cell(workspace, "/World/A", NAME)
    field = workspace.prim.pose.fields["scale", 0]
    wait_until(lambda: field.value == 1.0)
    type_into(field, "0")
    wait_until(lambda: "expected a finite number other than 0" in workspace.problems.sentence)
    wait_until(lambda: field.value == 1.0)


def test_what_cannot_be_moved_has_no_fields(window: Window, tmp_path: Path) -> None:
    """Oracle: a material, after a prim that has them."""
    stage = Usd.Stage.Open(str(write_stage(tmp_path / "a.usda")))
    stage.DefinePrim("/Look", "Material")
    stage.GetRootLayer().Save()
    workspace = opened(window, tmp_path / "a.usda")
    click_cell(workspace, "/World/A", NAME)
    wait_until(workspace.prim.pose.isVisible)
    click_cell(workspace, "/Look", NAME)
    wait_until(lambda: workspace.prim.properties.rows and not workspace.prim.pose.isVisible())


def test_properties_are_searched_and_the_keys_are_those_of_the_search_of_prims(
    window: Window, workspace: Workspace
) -> None:
    """Oracle: the rows that have the word, also of the prim that is selected next; Ctrl-F goes to
    the search of the panel that has the focus, and Escape clears it, then leaves."""
    click_cell(workspace, "/Camera", NAME)
    panel = workspace.prim
    wait_until(lambda: len(panel.properties.rows) > 10)
    press(window, "Ctrl+F")
    assert workspace.tree.box.hasFocus()
    QTest.mouseClick(panel.view.viewport(), LEFT)
    press(window, "Ctrl+F")
    assert panel.box.hasFocus()
    QTest.keyClicks(panel.box, "aperture")
    names = {row.name for row in panel.properties.rows}
    assert names == {
        f"{way}Aperture{end}" for way in ("horizontal", "vertical") for end in ("", "Offset")
    }
    panel.box.setText("visib")
    click_cell(workspace, "/World/A", NAME)
    wait_until(lambda: panel.pose.isVisible())
    assert {row.name for row in panel.properties.rows} == {"visibility", "Visibility, inherited"}
    panel.box.setFocus()
    QTest.keyClick(panel.box, Qt.Key.Key_Escape)
    assert panel.box.text() == "" and panel.box.hasFocus()
    assert len(panel.properties.rows) > 10
    QTest.keyClick(panel.box, Qt.Key.Key_Escape)
    assert workspace.viewport.hasFocus()


@pytest.mark.parametrize("page", [1, 2])
def test_the_search_of_properties_is_seen_from_the_other_pages(
    window: Window, workspace: Workspace, page: int
) -> None:
    """Oracle: what is typed after Ctrl-F on the page of metadata or composition, and whether the
    box is visible."""
    click_cell(workspace, "/Camera", NAME)
    panel = workspace.prim
    wait_until(lambda: len(panel.properties.rows) > 10)
    QTest.mouseClick(panel.tabBar(), LEFT, pos=panel.tabBar().tabRect(page).center())
    table = panel.currentWidget()
    assert isinstance(table, QTreeView)
    QTest.mouseClick(table.viewport(), LEFT)
    press(window, "Ctrl+F")
    assert panel.box.isVisible() and panel.box.hasFocus()
    QTest.keyClicks(focused(), "focal")
    assert [row.name for row in panel.properties.rows] == ["focalLength"]
