"""Tests of values that are edited in the list of properties, with mouse and key events."""

from __future__ import annotations

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QLineEdit

from tests.preview.qt.conftest import wait_until
from tests.preview.qt.windows import LEFT, click_cell
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
