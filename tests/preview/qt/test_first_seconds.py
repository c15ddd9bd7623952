"""Tests of first seconds: size, recent files, drops, turned captures, unsaved work."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Usd, UsdGeom
from PySide6.QtCore import QMimeData, QPointF, Qt, QUrl
from PySide6.QtGui import QDragEnterEvent, QDropEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QFileDialog, QLineEdit, QMessageBox

from tests.preview.qt import windows
from tests.preview.qt.conftest import wait_until
from tests.preview.qt.windows import LEFT, click_cell, opened, press, settled, texts
from usdsplat import formats, procedural_capture
from usdsplat.core.cancel import CancelToken
from usdsplat.core.errors import UsageError
from usdsplat.preview import pacing
from usdsplat.preview.compiling import COMPILING
from usdsplat.preview.document import Document
from usdsplat.preview.opening import _Telling, open_document
from usdsplat.preview.qt import remembered
from usdsplat.preview.qt.empty_page import INVITATION
from usdsplat.preview.qt.leaving import CLOSES, EDITED, MARKED, RECORDS, losses
from usdsplat.preview.qt.prim_model import VISIBLE
from usdsplat.preview.qt.viewport_painting import PREPARING
from usdsplat.preview.qt.window import Window
from usdsplat.preview.qt.workspace import Workspace
from usdsplat.preview.values import (
    Busy,
    DisplaySettings,
    Event,
    Look,
    Picture,
    SimulationStatus,
    ViewState,
)
from usdsplat.render.settings import RenderSettings


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    """A capture whose file says nothing of its axes, and whose splats say little."""
    cloud = procedural_capture(2000)
    rng = np.random.default_rng(3)
    cloud.positions[:] = rng.normal(0, 1, cloud.positions.shape)
    formats.write(cloud, tmp_path / "scan.ply")
    return tmp_path / "scan.ply"


# --- size and place ---------------------------------------------------------------------------


def test_a_first_window_fits_its_screen(application: QApplication) -> None:
    """Oracle: the available geometry that Qt reports."""
    window = Window()
    window.show()
    room = window.screen().availableGeometry()
    assert room.contains(window.geometry())
    wanted = remembered.SIZE.boundedTo(room.size() * remembered.SHARE)
    assert window.size() == wanted.expandedTo(window.minimumSizeHint())
    window.leave()


def test_the_next_window_has_the_size_of_the_last(application: QApplication) -> None:
    """Oracle: the size that a user gave."""
    first = Window()
    first.show()
    first.resize(611, 433)
    first.close()
    second = Window()
    second.show()
    assert (second.width(), second.height()) == (611, 433)
    second.leave()


# --- recent files -----------------------------------------------------------------------------


def test_files_that_were_opened_are_offered_again(
    window: Window, stage_path: Path, tmp_path: Path
) -> None:
    """Oracle: the order in which they were opened; a file that is gone cannot be chosen."""
    gone = windows.write_stage(tmp_path / "gone.usda")
    opened(window, gone)
    opened(window, stage_path)
    gone.unlink()
    menu = window._recent
    menu.aboutToShow.emit()
    assert texts(menu)[:2] == ["two.usda", "gone.usda"]
    assert [action.isEnabled() for action in menu.actions()[:2]] == [True, False]
    before = window.workspace
    menu.actions()[0].trigger()
    wait_until(lambda: window.workspace is not before)
    menu.aboutToShow.emit()
    menu.actions()[-1].trigger()
    assert remembered.recent_files() == ()


def test_a_file_that_nobody_may_look_at_cannot_be_chosen(
    window: Window, stage_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the entries. Root may look everywhere, so `os.stat` says what it says to others."""
    hidden, look = Path("/closed/hidden.usda"), os.stat

    def denied(path: Any, *args: Any, **options: Any) -> os.stat_result:
        if path in (hidden, str(hidden)):
            raise PermissionError(13, "Permission denied", str(path))
        return look(path, *args, **options)

    remembered.note_file(stage_path)
    remembered.note_file(hidden)
    monkeypatch.setattr(os, "stat", denied)
    menu = window._recent
    menu._fill()  # an exception in a slot of Qt would not come here
    assert texts(menu)[:2] == ["hidden.usda", stage_path.name]
    assert [action.isEnabled() for action in menu.actions()[:2]] == [False, True]


def test_no_more_files_are_kept_than_a_menu_holds(application: QApplication) -> None:
    """Oracle: the newest first, each once."""
    for number in (*range(20), 12):
        remembered.note_file(Path(f"/shots/{number}.usda"))
    kept = [path.stem for path in remembered.recent_files()]
    assert kept == ["12", *map(str, (19, 18, 17, 16, 15, 14, 13, 11, 10, 9, 8))]


# --- drops ------------------------------------------------------------------------------------


def test_a_drop_is_a_copy_even_where_a_move_is_proposed(window: Window, stage_path: Path) -> None:
    """Oracle: the action that the sender reads; of a move it may delete the file."""
    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(stage_path))])
    both = Qt.DropAction.MoveAction | Qt.DropAction.CopyAction
    place, none = QPointF(100, 100), Qt.KeyboardModifier.NoModifier
    enter = QDragEnterEvent(place.toPoint(), both, data, LEFT, none)
    enter.setDropAction(Qt.DropAction.MoveAction)
    window.dragEnterEvent(enter)
    drop = QDropEvent(place, both, data, LEFT, none)
    drop.setDropAction(Qt.DropAction.MoveAction)
    window.dropEvent(drop)
    for event in (enter, drop):
        assert event.isAccepted() and event.dropAction() == Qt.DropAction.CopyAction
    wait_until(lambda: window.workspace is not None)


# --- captures that look turned ----------------------------------------------------------------


def test_a_capture_of_unknown_axes_offers_to_be_turned(window: Window, capture: Path) -> None:
    """Oracle: half a turn about the direction right: y and z of the axes change their signs."""
    workspace = opened(window, capture)
    assert (workspace.opened.axes, workspace.opened.axes_are_assumed) == ("rdf", True)
    assert "rdf is assumed" in workspace.notices.sentence
    assert workspace.notices.button.text() == "Flip"
    QTest.mouseClick(workspace.notices.button, LEFT)
    wait_until(lambda: window.workspace is not workspace)
    turned = window.workspace
    assert turned is not None
    assert (turned.opened.axes, turned.opened.axes_are_assumed) == ("rub", False)
    assert turned.notices.sentence == ""
    window.actions_by_name["flip"].trigger()
    wait_until(lambda: window.workspace is not turned)
    assert window.workspace is not None and window.workspace.opened.axes == "rdf"


def test_what_is_turned_is_what_is_open(window: Window, capture: Path, tmp_path: Path) -> None:
    """Oracle: a file that cannot be read leaves the capture open, which is the one to turn."""
    workspace = opened(window, capture)
    (tmp_path / "broken.ply").write_bytes(b"ply\nformat nonsense\n")
    window.open(tmp_path / "broken.ply")
    wait_until(lambda: "broken.ply" in window.problems.sentence)
    window.flip()
    wait_until(lambda: window.workspace is not workspace)
    turned = window.workspace
    assert turned is not None and (turned.opened.name, turned.opened.axes) == ("scan.ply", "rub")
    window._use_device("cpu")
    wait_until(lambda: window.workspace is not turned)
    assert window.workspace is not None and window.workspace.opened.axes == "rub"


def test_a_file_of_the_command_line_is_turned_and_remembered(window: Window, capture: Path) -> None:
    """Oracle: as if the user had opened it in the window."""
    window.open_with(partial(open_document, capture), path=capture)
    wait_until(lambda: window.workspace is not None)
    before = window.workspace
    assert remembered.recent_files() == (capture,)
    window.flip()
    wait_until(lambda: window.workspace is not before)
    assert window.workspace is not None and window.workspace.opened.axes == "rub"


def test_a_stage_is_not_turned(window: Window, workspace: Workspace) -> None:
    """Oracle: a stage states its axes."""
    assert workspace.opened.axes == "" and not workspace.notices.sentence
    assert not window.actions_by_name["flip"].isEnabled()
    window.flip()
    assert window.workspace is workspace


# --- work that would be lost ------------------------------------------------------------------


def test_closing_asks_before_edits_are_lost(window: Window, workspace: Workspace) -> None:
    """Oracle: a person's expectation: nothing to ask before the edit, and after its undo."""
    assert losses(workspace) == ()
    _hide(workspace)
    press(window, "Ctrl+Z")
    wait_until(lambda: not workspace.context.has_unsaved)
    press(window, "Shift+Ctrl+Z")
    wait_until(lambda: workspace.context.has_unsaved)
    window.close()
    box = _box(window)
    assert box.text() == EDITED.format(name="two.usda", event=CLOSES)
    assert "Save your edits to two.usda before the window closes?" in box.text()
    _click(box, "Stay")
    assert window.isVisible() and window.workspace is workspace
    closed: list[bool] = []
    window.closed.connect(lambda: closed.append(True))
    window.close()
    _click(_box(window), "Leave without saving")
    assert closed == [True]


def test_edits_can_be_saved_before_another_stage_is_opened(
    window: Window, workspace: Workspace, stage_path: Path, tmp_path: Path
) -> None:
    """Oracle: the file, and the stage that is open afterwards."""
    _hide(workspace)
    workspace.context.viewer.add_bookmark("mine")
    window.open(stage_path)
    words = _box(window).text()
    assert "Save your edits to two.usda before you open two.usda?" in words and "mine" in words
    _click(_box(window), "Save as…")
    wait_until(lambda: len(window.findChildren(QFileDialog)) == 1)
    dialog = window.findChild(QFileDialog)
    dialog.findChild(QLineEdit).setText(str(tmp_path / "mine.usda"))
    dialog.accept()
    wait_until(lambda: window.workspace is not workspace)
    assert "invisible" in (tmp_path / "mine.usda").read_text()


def test_bookmarks_are_said_to_be_forgotten_only_where_they_are(
    window: Window, workspace: Workspace, stage_path: Path
) -> None:
    """Oracle: the sentences: another device shows the same scene, another stage does not."""
    _hide(workspace)
    workspace.context.viewer.add_bookmark("mine")
    workspace.device_chosen.emit("cpu")
    asked = EDITED.format(name="two.usda", event="you open two.usda")
    assert _box(window).text() == asked
    _click(_box(window), "Stay")
    window.open(stage_path)
    assert _box(window).text() == f"{asked}\n\n{MARKED.format(names='mine')}"
    _click(_box(window), "Stay")


def test_bookmarks_alone_are_asked_about(
    window: Window, workspace: Workspace, stage_path: Path
) -> None:
    """Oracle: the sentence, before the window closes; nothing where the same scene stays."""
    press(window, "Ctrl+B")
    (mark,) = workspace.context.viewer.bookmarks
    assert losses(workspace, is_same_scene=True) == ()
    window.close()
    box = _box(window)
    assert box.text() == MARKED.format(names=mark.name)
    assert [button.text() for button in box.buttons()].count("Save as…") == 0
    _click(box, "Stay")
    assert window.isVisible()
    closed: list[bool] = []
    window.closed.connect(lambda: closed.append(True))
    window.close()
    _click(_box(window), "Leave")
    assert closed == [True]


def test_edits_that_were_saved_are_not_asked_about(
    window: Window, workspace: Workspace, tmp_path: Path
) -> None:
    """Oracle: a further step of the same kind is one more edit."""
    _hide(workspace)
    assert window.saving is not None
    window.saving.write_session(tmp_path / "mine.usda")
    wait_until(lambda: not workspace.context.has_unsaved)
    assert losses(workspace) == ()
    click_cell(workspace, "/World/B", VISIBLE)
    wait_until(lambda: workspace.context.has_unsaved)


def test_what_was_hidden_and_shown_again_is_not_asked_about(
    window: Window, workspace: Workspace
) -> None:
    """Oracle: a person's expectation: nothing is left to be saved."""
    _hide(workspace)
    workspace.context.edit(lambda edits: edits.set_visible("/World/A", True))
    wait_until(lambda: not workspace.context.has_unsaved)
    assert losses(workspace) == ()


def test_closing_asks_before_a_recording_is_stopped(window: Window, workspace: Workspace) -> None:
    """Oracle: the status that the session reports."""
    workspace.simulation.show_status(SimulationStatus(state="paused", frame=3, recorded=(3, 9)))
    window.close()
    box = _box(window)
    assert box.text() == RECORDS.format(event=CLOSES)
    assert [button.text() for button in box.buttons()].count("Save as…") == 0
    _click(box, "Stay")
    assert window.isVisible()


# --- a first simulation -----------------------------------------------------------------------


def test_an_empty_simulation_tab_starts_one(
    window: Window, workspace: Workspace, tmp_path: Path
) -> None:
    """Oracle: the stage that `simulate --preset` writes has a SplatSim prim."""
    formats.write(procedural_capture(2000), tmp_path / "scan.ply")
    workspace = opened(window, tmp_path / "scan.ply")
    first = workspace.simulation.first
    workspace.right.setCurrentWidget(workspace.simulation)
    assert first.isVisible()
    QTest.mouseClick(first.buttons["push"], LEFT)
    wait_until(lambda: len(window.findChildren(QFileDialog)) == 1)
    dialog = window.findChild(QFileDialog)
    dialog.findChild(QLineEdit).setText(str(tmp_path / "push.usda"))
    dialog.accept()
    wait_until(lambda: window.workspace is not workspace)
    assert window.workspace is not None
    assert window.windowTitle().startswith("push.usda")
    panel = window.workspace.simulation
    wait_until(lambda: panel.status.state == "ready")
    assert not panel.first.isVisible()


def test_a_preset_takes_over_edits_view_and_bookmarks_without_a_question(
    window: Window, workspace: Workspace, tmp_path: Path
) -> None:
    """Oracle: what was authored, and the states of the two viewers."""
    formats.write(procedural_capture(2000), tmp_path / "scan.ply")
    workspace = opened(window, tmp_path / "scan.ply")
    viewer = workspace.context.viewer
    place = np.eye(4)
    place[0, 3] = 3.0
    workspace.context.edit(
        lambda edits: edits.set_transform("/scan", tuple(place.ravel().tolist()))
    )
    wait_until(lambda: workspace.context.has_unsaved)
    viewer.orbit(0.2, 0.1)
    viewer.end_move()
    viewer.set_display(exposure=1.5)
    viewer.set_look(settings=replace(viewer.state.look.settings, color_mode="scene"))
    viewer.add_bookmark("here")
    settled(workspace)
    workspace.simulation.first.make("push", tmp_path / "push.usda")
    wait_until(lambda: window.workspace is not workspace)
    assert not window.findChildren(QMessageBox)
    assert window.workspace is not None
    now = window.workspace.context.viewer
    assert now.state.camera == viewer.state.camera
    assert now.state.display == viewer.state.display
    assert now.state.look == viewer.state.look
    assert now.bookmarks == viewer.bookmarks
    stage = Usd.Stage.Open(str(tmp_path / "push.usda"))
    moved = UsdGeom.XformCache().GetLocalToWorldTransform(stage.GetPrimAtPath("/scan"))
    assert tuple(moved.ExtractTranslation()) == (3.0, 0.0, 0.0)


def test_another_file_keeps_exposure_and_colour_but_not_the_camera(
    window: Window, workspace: Workspace, tmp_path: Path
) -> None:
    """Oracle: what was chosen; a range of depths is that of one scene."""
    viewer = workspace.context.viewer
    viewer.set_display(exposure=-1.0, background="white", depth_range=(1.0, 2.0))
    viewer.set_look(
        settings=replace(viewer.state.look.settings, color_mode="scene", self_shadows=True)
    )
    viewer.use_camera("/Camera")
    viewer.add_bookmark("here")
    formats.write(procedural_capture(2000), tmp_path / "scan.ply")
    window.open(tmp_path / "scan.ply")
    _click(_box(window), "Leave")  # the bookmark
    wait_until(lambda: window.workspace is not workspace)
    assert window.workspace is not None
    settled(window.workspace)
    now = window.workspace.context.viewer
    assert now.state.display == DisplaySettings(exposure=-1.0, background="white")
    assert now.state.look == Look(settings=RenderSettings(color_mode="scene"))
    assert now.state.camera is None and now.bookmarks == ()


def test_a_preset_that_fails_says_why_and_can_be_tried_again(
    window: Window, workspace: Workspace, stage_path: Path
) -> None:
    """Oracle: the sentence of the command; this stage has two fields."""
    first = workspace.simulation.first
    first.make("grow", stage_path.with_name("grow.usda"))
    assert not first.buttons["grow"].isEnabled()
    wait_until(lambda: workspace.problems.sentence)
    assert "found 2 splat fields, expected one" in workspace.problems.sentence
    assert first.buttons["grow"].isEnabled()


# --- progress ---------------------------------------------------------------------------------


def test_reading_shows_how_much_is_read(window: Window) -> None:
    """Oracle: the numbers of the events."""
    from usdsplat.preview.qt.opening_again import Source

    hold = threading.Event()

    def opener(publish: Callable[[Event], None]) -> Document:
        publish(Busy(what="reading scan.ply", done=3, total=4))
        publish(Busy(what=""))
        hold.wait()
        raise UsageError("scan.ply", "nothing", "something")

    told: list[Busy] = []
    window._read(Source(opener=opener, path=Path("scan.ply")))
    assert window._pending is not None
    window._pending.busy.connect(told.append)
    wait_until(lambda: len(told) == 2)
    assert window.note == window.empty.note.text() == "Reading scan.ply…"  # it goes on
    assert window.empty.bar.isVisible()
    hold.set()
    wait_until(lambda: window.problems.sentence)
    assert window.empty.note.text() == INVITATION and not window.empty.bar.isVisible()


def test_a_first_picture_is_coarse_and_then_sharp(
    window: Window, stage_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the pictures that were drawn, on a machine on which each would take long, of which
    the window shows the last. Until the first one, the viewport says what it waits for."""
    monkeypatch.setattr(pacing, "RESTING_MS", 0.0)
    monkeypatch.setattr(pacing, "MIDDLE_MS", 0.0)
    goes_on, draw = threading.Event(), Document.draw

    def held(self: Document, state: ViewState, cancel: CancelToken | None = None) -> bool:
        goes_on.wait()
        return draw(self, state, cancel)

    monkeypatch.setattr(Document, "draw", held)
    window.open(stage_path)
    wait_until(lambda: window.workspace)
    assert window.workspace is not None
    viewport, proxy = window.workspace.viewport, window.workspace.context.proxy
    assert viewport.badges.waiting == PREPARING and window.workspace.isVisible()
    before = viewport.grab().toImage()
    proxy.busy.emit(COMPILING)
    assert viewport.badges.waiting == "Compiling kernels, once for this machine…"
    assert viewport.grab().toImage() != before
    proxy.busy.emit(Busy(what=""))
    assert viewport.badges.waiting == PREPARING and viewport.grab().toImage() == before
    drawn: list[Picture] = []  # a busy window takes the last of several only
    proxy.session.listen(lambda event: drawn.append(event) if isinstance(event, Picture) else None)
    goes_on.set()
    wait_until(lambda: viewport.picture and viewport.picture.is_final)
    assert drawn[0].scale > 1.0 and not drawn[0].is_final
    assert (drawn[-1].scale, viewport.picture) == (1.0, drawn[-1])


def test_the_bar_has_the_numbers_of_the_task(window: Window) -> None:
    """Oracle: the numbers of the events."""
    window.empty.show_busy(Busy(what="reading scan.ply", done=3, total=4))
    assert window.empty.bar.isVisible()
    assert (window.empty.bar.value(), window.empty.bar.maximum()) == (3, 4)
    window.empty.show_busy(Busy(what=""))
    assert not window.empty.bar.isVisible() and window.empty.note.text() == INVITATION


def test_the_end_of_a_task_clears_its_own_words_only(window: Window, workspace: Workspace) -> None:
    """Oracle: the status bar, after the events of a task that compiles kernels."""
    proxy = workspace.context.proxy
    proxy.busy.emit(Busy(what="compiling"))
    assert window.note == "compiling"
    proxy.busy.emit(Busy(what=""))
    assert window.note == ""
    proxy.busy.emit(Busy(what="compiling"))
    window._say_briefly("Wrote a.png")
    proxy.busy.emit(Busy(what=""))
    assert window.note == "Wrote a.png"


def test_each_percent_is_told_once() -> None:
    """Oracle: a count by hand."""
    told: list[Event] = []
    telling = _Telling(told.append)
    for done in range(1001):
        telling.step("reading", done, 1000)
    assert len(told) == 101
    telling.end()
    assert told[-1] == Busy(what="")


def _hide(workspace: Workspace) -> None:
    settled(workspace)
    click_cell(workspace, "/World/A", VISIBLE)
    wait_until(lambda: workspace.context.has_unsaved)


def _box(window: Window) -> QMessageBox:
    wait_until(lambda: any(box.isVisible() for box in window.findChildren(QMessageBox)))
    return next(box for box in window.findChildren(QMessageBox) if box.isVisible())


def _click(box: QMessageBox, text: str) -> None:
    QTest.mouseClick(next(each for each in box.buttons() if each.text() == text), LEFT)
