"""Windows with small stages, for tests."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QLineEdit, QMenu, QWidget

from tests.delegate.stages import add_camera, two_fields
from tests.preview.qt.conftest import wait_until
from usdsplat.preview.qt.window import Window
from usdsplat.preview.qt.workspace import Workspace
from usdsplat.preview.values import Image, Picture

LEFT = Qt.MouseButton.LeftButton


def write_stage(path: Path) -> Path:
    """Two clouds under /World and a camera; frames 1 to 24, in which /World/B moves away."""
    stage = two_fields()
    camera = add_camera(stage)
    camera.GetPrim().GetAttribute("focalLength").Set(24.0)
    operation = stage.GetAttributeAtPath("/World/B.xformOp:translate")
    operation.Set((2, 0, 0), 1)
    operation.Set((4, 0, 0), 24)
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(24)
    stage.GetRootLayer().Export(str(path))
    return path


def show(window: Window) -> Window:
    """Show a window, small, and have it take keys."""
    window.resize(1100, 700)
    window.show()
    window.activateWindow()
    wait_until(window.isActiveWindow)
    return window


def opened(window: Window, path: Path) -> Workspace:
    """Open a file, and wait for its first full picture."""
    before = window.workspace
    window.open(path)
    wait_until(lambda: window.workspace is not before)
    assert window.workspace is not None
    settled(window.workspace)
    return window.workspace


def settled(workspace: Workspace) -> Picture:
    """The full picture of what is asked for now."""

    def is_settled() -> bool:
        picture, viewer = workspace.context.picture, workspace.context.viewer
        return (
            picture is not None
            and picture.is_final
            and replace(picture.state, is_moving=False) == viewer.state
            and not viewer.is_ticking
        )

    wait_until(is_settled)
    assert workspace.context.picture is not None
    return workspace.context.picture


def image(workspace: Workspace) -> Image:
    """What the settled picture shows."""
    return settled(workspace).image


def press(widget: QWidget, keys: str) -> None:
    """Press a key sequence such as "Ctrl+Z" in a window, which comes to the front for it."""
    widget.activateWindow()
    wait_until(widget.isActiveWindow)
    QTest.keySequence(widget, keys)


def click_cell(workspace: Workspace, path: str, column: int) -> None:
    """Click a column of a prim in the tree, opening its ancestors as a person would."""
    tree = workspace.tree
    parts = path.strip("/").split("/")
    for count in range(1, len(parts)):
        parent = "/" + "/".join(parts[:count])
        wait_until(lambda parent=parent: tree.model.index_of(parent).isValid())
        tree.view.expand(tree.model.index_of(parent))
    wait_until(lambda: tree.model.index_of(path).isValid())
    index = tree.model.index_of(path).siblingAtColumn(column)
    QTest.mouseClick(tree.view.viewport(), LEFT, pos=tree.view.visualRect(index).center())


def type_into(field: QLineEdit, text: str, end: Qt.Key = Qt.Key.Key_Return) -> None:
    """Replace what a field says; Return would close a dialog."""
    QTest.mouseClick(field, LEFT, pos=QPoint(5, 5))
    field.selectAll()
    QTest.keyClicks(field, text)
    QTest.keyClick(field, end)


def texts(menu: QMenu) -> list[str]:
    """What a menu offers."""
    return [action.text() for action in menu.actions()]
