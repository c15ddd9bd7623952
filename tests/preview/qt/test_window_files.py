"""Tests of saving, opening and reloading in a window, with mouse and key events."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom
from PySide6.QtCore import QDir, QMimeData, QPoint, QPointF, Qt, QUrl
from PySide6.QtGui import QDropEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QDialogButtonBox,
    QFileDialog,
    QLineEdit,
    QMessageBox,
    QProgressDialog,
)

from tests.preview.qt import windows
from tests.preview.qt.conftest import wait_until
from tests.preview.qt.windows import LEFT, click_cell, image, opened, press, settled, type_into
from usdsplat import formats
from usdsplat.interchange.exporting import export_capture
from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.document import Document
from usdsplat.preview.qt.picture_dialogs import FlipbookDialog, ScreenshotDialog
from usdsplat.preview.qt.prim_model import VISIBLE
from usdsplat.preview.qt.save_dialogs import NO_EDITS
from usdsplat.preview.qt.window import Window
from usdsplat.preview.qt.workspace import Workspace
from usdsplat.preview.sides import Shown
from usdsplat.preview.values import ViewState


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """All that the status bar has said: on a busy machine a sentence may be over unseen."""
    sentences: list[str] = []
    say = Window._say

    def noted(window: Window, words: str) -> None:
        sentences.append(words)
        say(window, words)

    monkeypatch.setattr(Window, "_say", noted)
    return sentences


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
    _ask_for_a_screenshot(window)
    _save(window, tmp_path / "shot.png")
    assert np.array_equal(np.asarray(Image.open(tmp_path / "shot.png")), shown)


def _ask_for_a_screenshot(window: Window, width: str = "", height: str = "") -> None:
    """Open the dialog, set a size if there is one, and go on to the dialog for the file."""
    press(window, "F12")
    wait_until(lambda: window.findChildren(ScreenshotDialog))
    dialog = window.findChild(ScreenshotDialog)
    dialog.activateWindow()
    wait_until(dialog.isActiveWindow)
    fields = dialog.size_fields
    if height:
        QTest.mouseClick(fields.keeps_shape, LEFT, pos=QPoint(8, 8))
        type_into(fields.height_field, height, Qt.Key.Key_Tab)
    if width:
        type_into(fields.width_field, width, Qt.Key.Key_Tab)
    save = dialog.buttons.button(QDialogButtonBox.StandardButton.Save)
    QTest.mouseClick(save, LEFT)


@pytest.mark.parametrize(("width", "height"), [("300", ""), ("320", "80"), ("20000", "")])
def test_pictures_are_saved_in_a_size_of_their_own(
    window: Window, workspace: Workspace, tmp_path: Path, width: str, height: str
) -> None:
    """Oracle: Pillow's reading of the file: the size that was typed, with the viewport's shape or
    without; a size that cannot be is a sentence, and that of the viewport stays."""
    from PIL import Image

    settled(workspace)
    before = workspace.context.viewer.state.size
    _ask_for_a_screenshot(window, width, height)
    _save(window, tmp_path / "shot.png")
    wait_until(lambda: (tmp_path / "shot.png").exists())
    found = Image.open(tmp_path / "shot.png").size
    if width == "20000":
        assert "expected 1 to 16384" in workspace.problems.sentence
        assert found == before
        return
    assert found == (int(width), int(height or round(int(width) * before[1] / before[0])))
    assert workspace.context.viewer.state.size == before


@pytest.mark.parametrize("name", ["seen.ply", "seen.spz", "seen.usda"])
def test_what_is_seen_is_exported(
    window: Window, workspace: Workspace, tmp_path: Path, said: list[str], name: str
) -> None:
    """Oracle: the command's own conversion of the stage with the same edit: one field is hidden in
    the session, and the time is not the first; the sentence says how many splats."""
    workspace.context.edit(lambda edits: edits.set_visible("/World/A", False))
    workspace.context.viewer.set_time(12.0)
    settled(workspace)
    press(window, "Ctrl+E")
    _save(window, tmp_path / name)
    wait_until(lambda: any(f"Wrote {name}, " in each for each in said))
    if name.endswith(".usda"):
        stage = Usd.Stage.Open(str(tmp_path / name))
        seen = [UsdGeom.Imageable(stage.GetPrimAtPath(f"/World/{each}")) for each in "AB"]
        assert [each.ComputeVisibility() for each in seen] == ["invisible", "inherited"]
        return
    stage = Usd.Stage.Open(str(windows.write_stage(tmp_path / "mine.usda")))
    export_capture(stage, tmp_path / f"mine_{name}", prim_path="/World/B", time=12.0)
    ours, theirs = (formats.read(tmp_path / each).cloud for each in (name, f"mine_{name}"))
    np.testing.assert_array_equal(ours.positions, theirs.positions)
    assert any(f"{len(theirs)} splats" in each for each in said)


def test_an_export_that_fails_leaves_only_its_sentence(
    window: Window, workspace: Workspace, tmp_path: Path
) -> None:
    """Oracle: the problem, and a status line without what was begun."""
    settled(workspace)
    window.saving.write_export(tmp_path / "seen.obj")
    assert window.note == "Writing seen.obj…"
    wait_until(lambda: "obj" in workspace.problems.sentence)
    assert window.note == ""


def test_a_page_is_exported_and_takes_back_the_problem_of_the_last_try(
    window: Window, workspace: Workspace, tmp_path: Path
) -> None:
    """Oracle: the page's own fields, and the camera of the view, which looks from the right."""
    settled(workspace)
    assert window.saving is not None
    window.saving.write_export(tmp_path / "seen.obj")
    wait_until(lambda: "obj" in workspace.problems.sentence)
    assert ".html" in workspace.problems.sentence and ".usda" in workspace.problems.sentence
    workspace.context.viewer.face("right")
    settled(workspace)
    press(window, "Ctrl+E")
    _save(window, tmp_path / "seen.html")
    wait_until(lambda: "Wrote seen.html, " in window.note)
    assert not workspace.problems.sentence
    text = (tmp_path / "seen.html").read_text()
    assert "<title>two" in text
    assert workspace.context.viewer.cameras == ("/Camera",)  # the stage has no more


def test_one_escape_closes_the_dialogs_of_pictures(window: Window, workspace: Workspace) -> None:
    """Oracle: no dialog is left, though a number has the focus."""
    for key, kind in (("F12", ScreenshotDialog), ("Ctrl+Shift+F", FlipbookDialog)):
        press(window, key)
        wait_until(lambda kind=kind: window.findChildren(kind))
        dialog = window.findChild(kind)
        dialog.activateWindow()
        wait_until(dialog.isActiveWindow)
        field = dialog.size_fields.width_field
        field.setFocus()
        QTest.keyClick(field, Qt.Key.Key_Escape)
        wait_until(lambda kind=kind: not window.findChildren(kind))
        window.activateWindow()
        wait_until(window.isActiveWindow)


def test_a_flipbook_that_is_stopped_says_how_far_it_came(
    window: Window, workspace: Workspace, tmp_path: Path
) -> None:
    """Oracle: the files."""
    settled(workspace)
    assert window.saving is not None
    window.saving.write_flipbook(tmp_path / "a.####.png", tuple(map(float, range(1, 25))))
    wait_until(lambda: (tmp_path / "a.0002.png").exists())
    window.findChild(QProgressDialog).canceled.emit()
    wait_until(lambda: window.note.startswith("Stopped: "))
    written = len(list(tmp_path.glob("a.*.png")))
    assert 2 <= written < 24
    assert window.note == f"Stopped: {written} of 24 frames written"


def test_without_edits_no_layer_is_written(
    window: Window, workspace: Workspace, tmp_path: Path, said: list[str]
) -> None:
    """Oracle: the folder; edits that were taken back after a save are saved again, as the file
    still has them."""
    assert window.saving is not None
    window.saving.write_session(tmp_path / "a.usda")
    wait_until(lambda: NO_EDITS in said)
    assert not list(tmp_path.iterdir())
    click_cell(workspace, "/World/A", VISIBLE)
    wait_until(lambda: workspace.context.has_unsaved)
    window.saving.write_session(tmp_path / "a.usda")
    wait_until(lambda: "Wrote a.usda" in said)
    press(window, "Ctrl+Z")
    wait_until(lambda: workspace.context.has_unsaved)
    said.clear()
    window.saving.write_session(tmp_path / "a.usda")
    wait_until(lambda: "Wrote a.usda" in said)
    assert "invisible" not in (tmp_path / "a.usda").read_text()


def test_a_movie_without_ffmpeg_says_what_it_needs(
    window: Window, workspace: Workspace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the sentence of `products.movie`, before a frame is drawn; the dialog stays for
    another name, which takes the sentence back."""
    monkeypatch.setattr(Document, "still", lambda document, state: pytest.fail("a frame is drawn"))
    monkeypatch.setenv("PATH", str(tmp_path))
    press(window, "Ctrl+Shift+F")
    wait_until(lambda: window.findChildren(FlipbookDialog))
    dialog = window.findChild(FlipbookDialog)
    dialog.name.selectAll()
    QTest.keyClicks(dialog.name, str(tmp_path / "a.mp4"))
    QTest.keyClick(dialog.name, Qt.Key.Key_Return)
    wait_until(lambda: workspace.problems.sentence)
    assert "a.mp4: found no ffmpeg, expected ffmpeg on PATH" in workspace.problems.sentence
    assert not list(tmp_path.iterdir())
    assert dialog.isVisible()
    monkeypatch.undo()
    QTest.mouseClick(dialog.name, LEFT)
    dialog.name.selectAll()
    QTest.keyClicks(dialog.name, str(tmp_path / "a.####.png"))
    QTest.keyClick(dialog.name, Qt.Key.Key_Return)
    wait_until(lambda: (tmp_path / "a.0001.png").exists())
    assert workspace.problems.sentence == ""
    window.findChild(QProgressDialog).canceled.emit()
    wait_until(lambda: window.note.startswith("Stopped: "))


@pytest.mark.parametrize(
    ("first", "last", "step", "words"),
    [
        ("1", "inf", "1", "found more than 100000, expected at most 100000"),
        ("1", "1e12", "1", "found more than 100000, expected at most 100000"),
        ("inf", "inf", "1", "found more than 100000, expected at most 100000"),
        ("1", "24", "inf", "found one that is not finite"),
    ],
)
def test_a_flipbook_of_frames_without_end_is_refused(
    window: Window,
    workspace: Workspace,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    first: str,
    last: str,
    step: str,
    words: str,
) -> None:
    """Oracle: the sentence, by hand; the dialog stays, holds no more frames than are allowed and
    one, and no picture is written."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    press(window, "Ctrl+Shift+F")
    dialog = window.findChild(FlipbookDialog)
    wait_until(dialog.isActiveWindow)
    for field, text in ((dialog.first, first), (dialog.last, last), (dialog.step, step)):
        type_into(field, text, Qt.Key.Key_Tab)
    QTest.mouseClick(dialog.buttons.button(QDialogButtonBox.StandardButton.Save), LEFT)
    wait_until(lambda: words in workspace.problems.sentence)
    assert dialog.isVisible() and len(dialog.frames()) <= 100_001
    assert not list(Path.cwd().iterdir())


def test_without_edits_save_says_so_before_it_asks_for_a_name(
    window: Window, workspace: Workspace, said: list[str]
) -> None:
    """Oracle: what the status bar says, and the dialogs that are there; with an edit the dialog
    comes."""
    press(window, "Ctrl+S")
    wait_until(lambda: NO_EDITS in said)
    assert not window.findChildren(QFileDialog)
    click_cell(workspace, "/World/A", VISIBLE)
    wait_until(lambda: workspace.context.has_unsaved)
    press(window, "Ctrl+S")
    wait_until(lambda: window.findChildren(QFileDialog))
    window.findChild(QFileDialog).reject()


def test_the_dialog_of_an_export_shows_every_format(window: Window, workspace: Workspace) -> None:
    """Oracle: Qt's own match of names with the patterns of its filter, also of a file in a
    folder of its own."""
    window.saving.export()
    (dialog,) = window.findChildren(QFileDialog)
    patterns = dialog.nameFilters()[0].partition("(")[2].rstrip(")").split()
    for name in ("a.ply", "a.sog", "a.usda", "meta.json"):
        assert QDir.match(patterns, name), name
    dialog.reject()


def test_pictures_of_another_shape_have_the_view_of_the_viewport(
    window: Window, workspace: Workspace, tmp_path: Path, said: list[str]
) -> None:
    """Oracle: the view before and after: the camera that frames everything stays, in the pictures,
    which have one camera although the scene moves, and in the viewport."""
    viewer = workspace.context.viewer
    viewer.use_camera(None)
    camera = settled(workspace).camera
    states: list[ViewState] = []
    still = Document.still

    def noted(document: Document, state: ViewState) -> Shown:
        states.append(state)
        return still(document, state)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Document, "still", noted)
        window.saving.write_flipbook(tmp_path / "a.####.png", (1.0, 12.0), (90, 30))
        wait_until(lambda: any("and 1 more" in each for each in said))
        window.saving.write_screenshot(tmp_path / "b.png", size=(30, 90))
        wait_until(lambda: "Wrote b.png" in said)
    assert len({each.camera for each in states}) == 1 and len(states) == 3
    assert isinstance(states[0].camera, FreeCamera)
    theirs = states[0].camera.spec(aspect=1.0, bounds=None).world_to_camera
    np.testing.assert_allclose(theirs, camera.world_to_camera, atol=1e-6)
    viewer.set_display(exposure=0.5)
    assert settled(workspace).camera == camera


def test_a_flipbook_of_some_frames(
    window: Window, workspace: Workspace, tmp_path: Path, said: list[str]
) -> None:
    """Oracle: the names of the files, and Pillow's reading of their size; to replace is asked."""
    from PIL import Image

    press(window, "Ctrl+Shift+F")
    dialog = window.findChild(FlipbookDialog)
    wait_until(dialog.isActiveWindow)
    type_into(dialog.name, str(tmp_path / "a.####.png"), Qt.Key.Key_Tab)
    type_into(dialog.size_fields.width_field, "120", Qt.Key.Key_Tab)
    wide, high = workspace.context.viewer.state.size
    type_into(dialog.last, "3")
    wanted = [f"a.{frame:04}.png" for frame in (1, 2, 3)]
    wait_until(lambda: any("and 2 more" in each for each in said))
    assert sorted(path.name for path in tmp_path.iterdir()) == wanted
    sizes = {Image.open(tmp_path / each).size for each in wanted}
    assert sizes == {(120, round(120 * high / wide))}

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
