"""Tests of saving, opening and reloading in a window, with mouse and key events."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, UsdGeom
from PySide6.QtCore import QMimeData, QPointF, Qt, QUrl
from PySide6.QtGui import QDropEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QFileDialog,
    QLineEdit,
    QMessageBox,
)

from tests.preview.qt import windows
from tests.preview.qt.conftest import wait_until
from tests.preview.qt.windows import LEFT, click_cell, image, opened, press, type_into
from usdsplat.preview.qt.prim_model import VISIBLE
from usdsplat.preview.qt.window import Window
from usdsplat.preview.qt.workspace import Workspace


def test_the_session_layer_and_a_screenshot_are_saved(
    window: Window, workspace: Workspace, tmp_path: Path
) -> None:
    """Oracle: USD's and Pillow's own reading of the files."""
    from PIL import Image

    before = image(workspace)
    click_cell(workspace, "/World/A", VISIBLE)
    wait_until(lambda: not np.array_equal(image(workspace), before))
    press(window, "Ctrl+S")
    _save(window, tmp_path / "mine.usda")
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "mine.usda"))
    assert layer.GetAttributeAtPath("/World/A.visibility").default == UsdGeom.Tokens.invisible
    shown = image(workspace)
    press(window, "F12")
    _save(window, tmp_path / "shot.png")
    assert np.array_equal(np.asarray(Image.open(tmp_path / "shot.png")), shown)


def test_a_flipbook_of_some_frames(window: Window, workspace: Workspace, tmp_path: Path) -> None:
    """Oracle: the names of the files."""
    from usdsplat.preview.qt.save_dialogs import FlipbookDialog

    press(window, "Ctrl+Shift+F")
    dialog = window.findChild(FlipbookDialog)
    assert QTest.qWaitForWindowActive(dialog)
    type_into(dialog.name, str(tmp_path / "a.####.png"), Qt.Key.Key_Tab)
    type_into(dialog.last, "3")
    wanted = [f"a.{frame:04}.png" for frame in (1, 2, 3)]
    wait_until(lambda: sorted(path.name for path in tmp_path.iterdir()) == wanted)
    wait_until(lambda: "and 2 more" in window.note)

    (tmp_path / "a.0001.png").write_text("old")
    press(window, "Ctrl+Shift+F")
    wait_until(lambda: len(window.findChildren(FlipbookDialog)) == 1)
    dialog = window.findChild(FlipbookDialog)
    dialog.name.setText(str(tmp_path / "a.####.png"))
    dialog.last.show_value(1)
    dialog.buttons.accepted.emit()
    (box,) = dialog.findChildren(QMessageBox)
    assert box.text() == "a.0001.png exists."
    assert (tmp_path / "a.0001.png").read_text() == "old"
    replace = next(button for button in box.buttons() if button.text() == "Replace")
    QTest.mouseClick(replace, LEFT)
    wait_until(lambda: (tmp_path / "a.0001.png").read_bytes() != b"old")


def test_a_dropped_file_opens_here(window: Window, workspace: Workspace, tmp_path: Path) -> None:
    """Oracle: the tree of the other stage."""
    other = Usd.Stage.CreateNew(str(tmp_path / "other.usda"))
    UsdGeom.Xform.Define(other, "/Elsewhere")
    other.Save()
    _drop(window, tmp_path / "other.usda")
    wait_until(lambda: window.workspace is not workspace)
    here = window.workspace
    assert here is not None
    wait_until(lambda: here.tree.model.index_of("/Elsewhere").isValid())
    assert window.windowTitle().startswith("other.usda")


def test_a_broken_file_says_its_sentence_and_the_old_picture_stays(
    window: Window, workspace: Workspace, tmp_path: Path
) -> None:
    """Oracle: the error's own shape; the picture, which still follows."""
    before = image(workspace)
    (tmp_path / "broken.ply").write_bytes(b"ply\nformat nonsense\n")
    _drop(window, tmp_path / "broken.ply")
    wait_until(lambda: window.problems.sentence)
    assert "broken.ply" in window.problems.sentence
    assert "expected" in window.problems.sentence
    assert window.workspace is workspace
    press(window, "Shift+G")
    assert not np.array_equal(image(workspace), before)


def test_what_changed_on_disk_is_told_and_reloaded_when_asked(
    window: Window, tmp_path: Path
) -> None:
    """Oracle: the tree, which has the new prim afterwards and not before."""
    path = windows.write_stage(tmp_path / "mine.usda")
    workspace = opened(window, path)
    text = path.read_text()
    path.write_text(text + '\ndef Xform "Later"\n{\n}\n')
    wait_until(lambda: "mine.usda" in workspace.notices.sentence)
    assert not workspace.tree.model.index_of("/Later").isValid()
    QTest.mouseClick(workspace.notices.button, LEFT)
    wait_until(lambda: workspace.tree.model.index_of("/Later").isValid())
    wait_until(lambda: not workspace.notices.sentence)


def _save(window: Window, path: Path) -> None:
    """Give the file dialog a name, and wait for the file."""
    wait_until(lambda: len(window.findChildren(QFileDialog)) == 1)  # an older one is gone
    dialog = window.findChild(QFileDialog)
    field = dialog.findChild(QLineEdit)
    field.setText(str(path))
    dialog.accept()
    wait_until(path.exists)


def _drop(window: Window, path: Path) -> None:
    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(path))])
    event = QDropEvent(
        QPointF(100, 100),
        Qt.DropAction.CopyAction,
        data,
        Qt.MouseButton.LeftButton,
        Qt.KeyboardModifier.NoModifier,
    )
    window.dropEvent(event)
