"""Tests of a window with a stage, with mouse and key events."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QEvent, QObject, QPoint, QPointF, Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QApplication,
    QComboBox,
    QLineEdit,
    QSlider,
    QWidget,
)

from tests.preview.qt import windows
from tests.preview.qt.conftest import wait_until
from tests.preview.qt.windows import LEFT, click_cell, image, opened, press, settled, type_into
from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.qt.keys import KEYS
from usdsplat.preview.qt.prim_model import NAME, VISIBLE
from usdsplat.preview.qt.window import Window
from usdsplat.preview.qt.workspace import Workspace
from usdsplat.preview.values import Picture
from usdsplat.render.frame_stats import Clock


def test_a_window_is_there_before_its_stage_and_says_what_it_reads(
    window: Window, stage_path: Path
) -> None:
    """Oracle: a person's expectation."""
    window.open(stage_path)
    assert window.isVisible()
    assert window.empty.note.text() == "Reading two.usda…"
    wait_until(lambda: window.workspace)
    assert window.windowTitle() == "two.usda — usdsplat"


def test_no_panel_flashes_as_a_window_of_its_own(window: Window, stage_path: Path) -> None:
    """Oracle: the windows that Qt shows while a stage opens, counted."""

    class Watch(QObject):
        def eventFilter(self, watched: QObject, event: QEvent) -> bool:
            if event.type() == QEvent.Type.Show and isinstance(watched, QWidget):
                flashed.extend([watched] if watched.isWindow() else [])
            return False

    flashed: list[QWidget] = []
    watch = Watch()
    application = QApplication.instance()
    assert application is not None
    application.installEventFilter(watch)
    try:
        opened(window, stage_path)
    finally:
        application.removeEventFilter(watch)
    assert not flashed


def test_a_click_on_the_eye_hides_a_prim_and_undo_shows_it_again(
    window: Window, workspace: Workspace
) -> None:
    """Oracle: the pictures before and after, bit for bit."""
    before = image(workspace)
    click_cell(workspace, "/World/A", VISIBLE)
    wait_until(lambda: window.actions_by_name["undo"].isEnabled())
    wait_until(lambda: not np.array_equal(image(workspace), before))
    assert "Undo" in window.actions_by_name["undo"].text()
    assert window.actions_by_name["undo"].text() != "Undo"
    press(window, "Ctrl+Z")
    wait_until(lambda: np.array_equal(image(workspace), before))
    assert not window.actions_by_name["undo"].isEnabled()
    press(window, "Shift+Ctrl+Z")
    wait_until(lambda: not np.array_equal(image(workspace), before))


def test_a_selected_prim_shows_its_properties_and_one_is_edited_in_place(
    window: Window, workspace: Workspace
) -> None:
    """Oracle: the attribute on the stage."""
    click_cell(workspace, "/Camera", NAME)
    rows = workspace.prim.properties
    wait_until(lambda: any(row.name == "focalLength" for row in rows.rows))
    number = next(i for i, row in enumerate(rows.rows) if row.name == "focalLength")
    assert rows.rows[number].text.startswith("24")
    view = workspace.prim.view
    index = rows.index(number, 1)
    view.scrollTo(index)
    place = view.visualRect(index).center()
    QTest.mouseClick(view.viewport(), LEFT, pos=place)
    QTest.mouseDClick(view.viewport(), LEFT, pos=place)
    field = view.viewport().findChild(QLineEdit)
    assert field is not None
    type_into(field, "35")
    wait_until(lambda: rows.rows[number].text.startswith("35"))
    assert rows.rows[number].is_edited


def test_a_search_lists_prims_and_a_click_selects_one(workspace: Workspace) -> None:
    """Oracle: the prims of that type on the stage."""
    QTest.mouseClick(workspace.tree.box, LEFT)
    QTest.keyClicks(workspace.tree.box, "camera")
    found = workspace.tree.found
    wait_until(lambda: found.count() and found.isVisible())
    assert [found.item(i).text() for i in range(found.count())] == ["/Camera"]
    QTest.mouseClick(found.viewport(), LEFT, pos=found.visualItemRect(found.item(0)).center())
    assert workspace.context.selected == "/Camera"
    QTest.keyClick(workspace.tree.box, Qt.Key.Key_Escape)
    wait_until(lambda: workspace.tree.view.isVisible())


def test_a_click_in_the_viewport_selects_the_prim_in_the_tree_and_shows_the_splat(
    workspace: Workspace,
) -> None:
    """Oracle: the prim that is there is one of the two clouds, and stays picked in the tree."""
    workspace.right.setCurrentWidget(workspace.probe)
    picture = settled(workspace)
    color = np.abs(picture.image.astype(int) - picture.image[0, 0]).sum(axis=2)
    y, x = np.unravel_index(np.argmax(color), color.shape)
    ratio = workspace.viewport.devicePixelRatioF()
    QTest.mouseClick(workspace.viewport, LEFT, pos=QPoint(round(x / ratio), round(y / ratio)))
    wait_until(lambda: workspace.context.selected)
    assert workspace.context.selected in ("/World/A", "/World/B")
    wait_until(lambda: "Opacity" in workspace.probe.picked.rows)
    view, model = workspace.tree.view, workspace.tree.model

    def chosen() -> list[str]:
        rows = (model.row_of(index) for index in view.selectionModel().selectedRows())
        return [row.path for row in rows if row]

    wait_until(lambda: chosen() == [workspace.context.selected])


def test_the_pixel_under_the_pointer_has_the_numbers_of_the_picture(workspace: Workspace) -> None:
    """Oracle: the picture's own pixel."""
    workspace.right.setCurrentWidget(workspace.probe)
    picture = settled(workspace)
    QTest.mouseMove(workspace.viewport, QPoint(200, 150))
    wait_until(lambda: workspace.probe.pixel.rows.get("Pixel") == "200, 150")
    shown = [int(part) for part in workspace.probe.pixel.rows["8 bit"].split()]
    assert shown == picture.image[150, 200].tolist()


def test_a_scrub_changes_time_and_picture_and_full_quality_follows(workspace: Workspace) -> None:
    """Oracle: the frame under the pointer, and the prim that moves by then."""
    before = image(workspace)
    ruler = workspace.timeline.ruler
    QTest.mousePress(ruler, LEFT, pos=QPoint(round(ruler.position(1)), 10))
    QTest.mouseMove(ruler, QPoint(round(ruler.position(12)), 10))
    QTest.mouseMove(ruler, QPoint(round(ruler.position(24)), 10))
    QTest.mouseRelease(ruler, LEFT, pos=QPoint(round(ruler.position(24)), 10))
    picture = settled(workspace)
    assert picture.state.time == 24
    assert workspace.timeline.frame.text() == "24"
    assert not np.array_equal(picture.image, before)
    assert picture.scale == 1


def test_keys_step_frames_play_and_stop(window: Window, workspace: Workspace) -> None:
    """Oracle: usdview's habits."""
    workspace.viewport.setFocus()
    press(window, "Right")
    press(window, "Right")
    press(window, "Left")
    assert workspace.context.time == 2
    press(window, "End")
    assert workspace.context.time == 24
    press(window, "Home")
    press(window, "Space")
    wait_until(lambda: (workspace.context.time or 0) > 3)
    press(window, "Space")
    assert not workspace.context.viewer.timeline.is_playing
    settled(workspace)


def test_arrow_keys_in_the_tree_are_the_trees(window: Window, workspace: Workspace) -> None:
    """Oracle: the time, which stays."""
    click_cell(workspace, "/World", NAME)
    workspace.tree.view.setFocus()
    QTest.keyClick(workspace.tree.view, Qt.Key.Key_Left)
    assert not workspace.tree.view.isExpanded(workspace.tree.model.index_of("/World"))
    assert workspace.context.time == 1


def test_a_typed_exposure_brightens_and_one_out_of_range_says_so(
    window: Window, workspace: Workspace
) -> None:
    """Oracle: the sentence of the knob; a picture that is brighter by two stops."""
    before = image(workspace).astype(int)
    field = workspace.render_panel.display.row("exposure").findChild(QLineEdit)
    type_into(field, "2")
    assert image(workspace).astype(int).sum() > before.sum()
    bright = image(workspace)
    type_into(field, "99")
    wait_until(lambda: workspace.problems.sentence)
    assert "99" in workspace.problems.sentence
    assert "-16 to 16" in workspace.problems.sentence
    assert workspace.strip.exposure.value == 2
    QTest.mouseClick(workspace.problems.dismiss, LEFT)
    assert not workspace.problems.sentence
    wait_until(lambda: np.array_equal(image(workspace), bright))


def test_a_slider_of_the_render_settings_changes_the_picture(workspace: Workspace) -> None:
    """Oracle: harmonics of degree 1 that are there, and then are not."""
    before = image(workspace)
    slider = workspace.render_panel.settings.row("sh_degree").findChild(QSlider)
    slider.setFocus()
    for _ in range(4):
        QTest.keyClick(slider, Qt.Key.Key_Left)
    assert workspace.context.viewer.state.look.settings.sh_degree == 0
    assert not np.array_equal(image(workspace), before)


def test_a_comparison_shows_another_aov_right_of_the_wipe(
    window: Window, workspace: Workspace
) -> None:
    """Oracle: the left half of the picture alone, which stays as it was."""
    before = image(workspace)
    press(window, "Shift+W")
    box = workspace.render_panel.aov
    box.setFocus()
    assert workspace.render_panel.side.currentIndex() == 1
    QTest.keyClicks(box, "N")
    QTest.keyClick(box, Qt.Key.Key_Return)
    wait_until(lambda: workspace.context.viewer.state.other.aov == "N")
    after = image(workspace)
    middle = before.shape[1] // 2
    assert np.array_equal(after[:, : middle - 1], before[:, : middle - 1])
    assert not np.array_equal(after[:, middle + 1 :], before[:, middle + 1 :])
    press(window, "Shift+W")
    assert np.array_equal(image(workspace), before)


def test_a_channel_is_shown_alone_and_a_second_time_all_again(
    window: Window, workspace: Workspace
) -> None:
    """Oracle: three equal channels."""
    before = image(workspace)
    press(window, "Shift+G")
    alone = image(workspace)
    assert np.array_equal(alone[..., 0], alone[..., 1])
    assert np.array_equal(alone[..., 1], alone[..., 2])
    assert workspace.strip.channel.currentText() == "green"
    press(window, "Shift+G")
    assert np.array_equal(image(workspace), before)


def test_cameras_and_bookmarks(window: Window, workspace: Workspace) -> None:
    """Oracle: the camera that a picture was seen by."""
    box: QComboBox = workspace.strip.camera
    box.setFocus()
    QTest.keyClick(box, Qt.Key.Key_End)
    wait_until(lambda: workspace.context.viewer.state.camera == "/Camera")
    seen = settled(workspace).camera
    press(window, "Ctrl+B")
    press(window, "Shift+F")
    wait_until(lambda: isinstance(workspace.context.viewer.state.camera, FreeCamera))
    workspace.bookmarks.aboutToShow.emit()
    assert "View 1" in windows.texts(workspace.bookmarks)
    next(a for a in workspace.bookmarks.actions() if a.text() == "View 1").trigger()
    back = settled(workspace).camera
    assert np.allclose(back.world_to_camera, seen.world_to_camera, atol=1e-6)


def test_the_view_becomes_a_camera_of_the_stage(window: Window, workspace: Workspace) -> None:
    """Oracle: the list of cameras, and what the new one sees."""
    seen = settled(workspace).camera
    window.actions_by_name["save_camera"].trigger()
    wait_until(lambda: len(workspace.context.viewer.cameras) == 2)
    path = next(path for path in workspace.context.viewer.cameras if path != "/Camera")
    workspace.context.viewer.use_camera(path)
    back = settled(workspace).camera
    assert np.allclose(back.world_to_camera, seen.world_to_camera, atol=1e-4)


def test_a_drag_ends_the_full_picture_in_progress(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the pictures that were shown: the full one that is held up after its first stage is
    not among them, that of the movement is the first, and the full one of its end the last."""
    begun, goes_on, lap = threading.Event(), threading.Event(), Clock.lap

    def held(self: Clock, stage: str) -> None:
        if not begun.is_set():
            begun.set()
            goes_on.wait()
        lap(self, stage)

    settled(workspace)
    viewport, viewer = workspace.viewport, workspace.context.viewer
    viewport._rest.setInterval(1 << 30)  # on a busy machine, the movement would be over first
    monkeypatch.setattr(Clock, "lap", held)
    shown: list[Picture] = []
    workspace.context.proxy.picture.connect(shown.append)
    viewer.face("front")
    full = viewer.state
    wait_until(begun.is_set)
    middle = viewport.rect().center()
    QTest.mousePress(viewport, LEFT, Qt.KeyboardModifier.AltModifier, middle)
    for step in (10, 20):
        place = QPointF(middle + QPoint(step, 0))
        event = QMouseEvent(
            QEvent.Type.MouseMove,
            place,
            viewport.mapToGlobal(place),
            Qt.MouseButton.NoButton,
            LEFT,
            Qt.KeyboardModifier.AltModifier,
        )
        QApplication.sendEvent(viewport, event)
    wait_until(lambda: viewer.state.is_moving)
    goes_on.set()
    wait_until(lambda: shown)
    QTest.mouseRelease(viewport, LEFT, Qt.KeyboardModifier.AltModifier, middle + QPoint(20, 0))
    assert settled(workspace) is shown[-1]
    assert shown[0].state.is_moving and full not in [each.state for each in shown]


def test_two_windows_do_not_influence_each_other(
    window: Window, workspace: Workspace, tmp_path: Path
) -> None:
    """Oracle: each one's pictures, bit for bit."""
    other = windows.show(Window())
    try:
        there = opened(other, windows.write_stage(tmp_path / "again.usda"))
        here_before, there_before = image(workspace), image(there)
        click_cell(there, "/World/A", VISIBLE)
        there.context.viewer.set_time(20)
        wait_until(lambda: not np.array_equal(image(there), there_before))
        assert np.array_equal(image(workspace), here_before)
        assert workspace.context.time == 1
        assert not window.actions_by_name["undo"].isEnabled()
    finally:
        other.leave()
    press(window, "Shift+G")
    assert not np.array_equal(image(workspace), here_before)


def test_a_window_can_be_closed_at_any_time(application: QApplication, stage_path: Path) -> None:
    """Oracle: nothing is left that complains."""
    for wait in (lambda window: True, lambda window: window.workspace):
        window = windows.show(Window())
        window.open(stage_path)
        wait_until(lambda window=window, wait=wait: wait(window))
        closed: list[bool] = []
        window.closed.connect(lambda closed=closed: closed.append(True))
        window.close()
        assert closed


def test_every_action_of_the_table_is_in_a_menu(window: Window) -> None:
    """Oracle: the table; without a stage only what needs none is on."""
    for key in KEYS:
        action = window.actions_by_name[key.name]
        assert action.associatedObjects()
    assert window.actions_by_name["open"].isEnabled()
    assert not window.actions_by_name["screenshot"].isEnabled()


def test_the_help_stays_beside_the_window(window: Window, workspace: Workspace) -> None:
    """Oracle: a person's expectation."""
    from usdsplat.preview.qt.help_dialog import HelpDialog

    press(window, "F1")
    dialog = window.findChild(HelpDialog)
    assert dialog.isVisible()
    assert "orbit" in dialog.text.toPlainText()
    assert window.isEnabled()
