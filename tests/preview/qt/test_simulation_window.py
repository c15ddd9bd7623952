"""Tests of a simulation in a window: run, pause, step, edit a parameter, undo, record, reset."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QCheckBox, QFileDialog, QLineEdit, QMessageBox

from tests.preview.qt import windows
from tests.preview.qt.conftest import wait_until
from tests.preview.qt.windows import LEFT, opened, press, settled, type_into
from tests.preview.simulating.hosts import shot
from tests.preview.stage_model.stages import rich
from tests.sim.stage.stages import simulation_of
from usdsplat.preview.qt import remembered
from usdsplat.preview.qt.picture_dialogs import FlipbookDialog
from usdsplat.preview.qt.window import Window
from usdsplat.preview.qt.workspace import Workspace
from usdsplat.schema import is_splat_field
from usdsplat.sim.stage.authoring import author
from usdsplat.sim.stage.provenance import nested

LAST = 4


@pytest.fixture
def window(application: QApplication) -> Iterator[Window]:
    window = windows.show(Window())
    yield window
    window.leave()


@pytest.fixture
def workspace(window: Window, tmp_path: Path) -> Workspace:
    stage = shot(tmp_path, {}, last=LAST)
    return opened(window, Path(stage.GetRootLayer().realPath))


def test_buttons_run_pause_step_and_reset_and_the_timeline_follows(workspace: Workspace) -> None:
    """Oracle: the frames that were asked for, and the bar under the ruler."""
    panel = workspace.simulation
    wait_until(lambda: panel.status.state == "ready")
    assert workspace.right.currentWidget() is panel
    QTest.mouseClick(panel.step, LEFT)
    wait_until(lambda: panel.status.frame is not None and panel.status.state == "paused")
    first = panel.status.frame
    QTest.mouseClick(panel.step, LEFT)
    wait_until(lambda: panel.status.frame == first + 1 and panel.status.state == "paused")
    assert panel.run.text() == "Run"
    QTest.mouseClick(panel.run, LEFT)
    wait_until(lambda: panel.status.frame == LAST)
    wait_until(lambda: workspace.timeline.ruler.cached == (first, LAST))
    QTest.mouseClick(panel.reset, LEFT)
    wait_until(lambda: panel.status.state == "ready")
    wait_until(lambda: workspace.timeline.ruler.cached is None)


def scrub(workspace: Workspace, frame: float) -> None:
    """Click a frame of the ruler."""
    ruler = workspace.timeline.ruler
    part = (frame - 1) / (LAST - 1)
    at = QPoint(round(ruler.rect().left() + part * (ruler.width() - 1)), ruler.height() // 2)
    QTest.mousePress(ruler, LEFT, pos=at)
    QTest.mouseRelease(ruler, LEFT, pos=at)
    assert workspace.context.time == frame


def test_a_frame_that_is_not_simulated_says_so_while_it_is_scrubbed(workspace: Workspace) -> None:
    """Oracle: the frames of the status; the words are painted, and at the start and on simulated
    frames there are none."""
    panel, viewport = workspace.simulation, workspace.viewport
    wait_until(lambda: panel.status.state == "ready")

    def scrub_to(frame: float) -> str:
        scrub(workspace, frame)
        return viewport.badges.unsimulated

    assert viewport.badges.unsimulated == ""
    assert scrub_to(3) == "Frame 3 is not simulated yet"
    assert scrub_to(1) == ""
    for frame in (1, 2):
        QTest.mouseClick(panel.step, LEFT)
        wait_until(lambda frame=frame: panel.status.frames == (1, frame))
        wait_until(lambda: panel.status.state == "paused")
    assert scrub_to(2) == ""
    windows.settled(workspace)
    plain = viewport.grab().toImage()
    assert scrub_to(4) == "Frame 4 is not simulated yet: this is 2"
    windows.settled(workspace)
    assert viewport.grab().toImage() != plain
    QTest.mouseClick(panel.run, LEFT)
    wait_until(lambda: panel.status.frame == LAST and panel.status.state == "paused")
    assert viewport.badges.unsimulated == ""


def test_before_the_start_of_a_simulation_nothing_is_missing(
    window: Window, workspace: Workspace
) -> None:
    """Oracle: by hand, for a start that is typed into the panel, and taken back."""
    badges = workspace.viewport.badges
    wait_until(lambda: workspace.simulation.prims.count())
    scrub(workspace, 3)
    assert badges.unsimulated == "Frame 3 is not simulated yet"
    type_into(workspace.simulation.panel.row("sim:startTime").findChild(QLineEdit), "3")
    wait_until(lambda: badges.unsimulated == "")
    scrub(workspace, 4)
    assert badges.unsimulated == "Frame 4 is not simulated yet"
    scrub(workspace, 3)
    workspace.viewport.setFocus()
    press(window, "Ctrl+Z")
    wait_until(lambda: badges.unsimulated == "Frame 3 is not simulated yet")


def test_a_parameter_is_turned_and_taken_back(window: Window, workspace: Workspace) -> None:
    """Oracle: the editor's value, which is the stage's."""
    panel = workspace.simulation
    wait_until(lambda: panel.prims.count())
    field = panel.panel.row("sim:substeps").findChild(QLineEdit)
    before = field.text()
    type_into(field, "7")
    wait_until(lambda: window.actions_by_name["undo"].isEnabled())
    wait_until(lambda: field.text() == "7")
    workspace.viewport.setFocus()
    press(window, "Ctrl+Z")
    wait_until(lambda: field.text() == before)


def test_animated_parameters_are_those_of_the_time(window: Window, tmp_path: Path) -> None:
    """Oracle: what the samples say at each frame, also of a bool that is not at its default; an
    edit adds a sample at the frame, and leaves the others."""
    stage = rich()
    ball = stage.GetPrimAtPath("/World/Ball")
    for time, value in ((1, False), (3, True)):
        author(ball, {"affector:enabled": value}, time=time)
    for time, value in ((1, 0.0), (5, 0.4)):
        author(ball, {"affector:friction": value}, time=time)
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(5)
    stage.GetRootLayer().Export(str(tmp_path / "rich.usda"))
    workspace = opened(window, tmp_path / "rich.usda")
    panel, viewer = workspace.simulation, workspace.context.viewer
    wait_until(lambda: panel.prims.count() == 2)
    panel.prims.setCurrentRow(0)
    box = panel.panel.row("affector:enabled").findChild(QCheckBox)
    field = panel.panel.row("affector:friction").findChild(QLineEdit)
    for time, is_on, friction in ((1.0, False, "0"), (3.0, True, "0.2"), (2.0, False, "0.1")):
        viewer.set_time(time)
        wait_until(lambda is_on=is_on: box.isChecked() == is_on)
        wait_until(lambda friction=friction: field.text() == friction)
    type_into(field, "0.9")
    wait_until(lambda: window.actions_by_name["undo"].isEnabled())
    for time, friction in ((2.0, "0.9"), (5.0, "0.4"), (1.0, "0")):
        viewer.set_time(time)
        wait_until(lambda friction=friction: field.text() == friction)


def test_parameters_without_samples_are_not_asked_for_at_each_time(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: counted: no query of the stage is wanted when the time changes."""
    panel, viewer = workspace.simulation, workspace.context.viewer
    wait_until(lambda: panel.prims.count())
    asked: list[float | None] = []
    monkeypatch.setattr(panel._question, "refresh", lambda: asked.append(viewer.state.time))
    for time in (2.0, 3.0):
        viewer.set_time(time)
        windows.settled(workspace)
        assert viewer.state.time == time
    assert asked == []


def test_a_parameter_out_of_range_says_so_and_the_old_value_comes_back(
    workspace: Workspace,
) -> None:
    """Oracle: the sentence of the knob."""
    panel = workspace.simulation
    wait_until(lambda: panel.prims.count())
    field = panel.panel.row("sim:substeps").findChild(QLineEdit)
    before = field.text()
    type_into(field, "-3")
    wait_until(lambda: "-3" in workspace.problems.sentence)
    workspace.viewport.setFocus()
    wait_until(lambda: field.text() == before)


def test_a_recording_is_a_bake(window: Window, workspace: Workspace, tmp_path: Path) -> None:
    """Oracle: USD's own reading of the file."""
    panel = workspace.simulation
    wait_until(lambda: panel.status.state == "ready")
    QTest.mouseClick(panel.record, LEFT)
    wait_until(lambda: window.findChildren(QFileDialog))
    dialog = window.findChild(QFileDialog)
    assert dialog.defaultSuffix() == "usda"
    dialog.findChild(QLineEdit).setText(str(tmp_path / "bake.usda"))
    dialog.accept()
    wait_until(lambda: (tmp_path / "bake.usda").exists())
    wait_until(lambda: panel.status.state != "recording")
    assert Sdf.Layer.FindOrOpen(str(tmp_path / "bake.usda"))
    assert not workspace.problems.sentence


def test_a_recording_is_stopped_opened_and_remembered(window: Window, tmp_path: Path) -> None:
    """Oracle: USD's own reading of the bake, and what the panels say of it."""
    stage = shot(tmp_path, {}, last=200)
    workspace = opened(window, Path(stage.GetRootLayer().realPath))
    panel, target = workspace.simulation, tmp_path / "bake.usda"
    wait_until(lambda: panel.status.state == "ready")
    panel.record_to(target)
    wait_until(lambda: panel.status.recorded is not None and panel.status.recorded[0] > 2)
    assert panel.record.text().startswith("Stop (") and panel.record.text().endswith(" of 200)")
    assert panel.is_recording and panel.record.isEnabled() and not panel.step.isEnabled()
    wait_until(lambda: workspace.context.viewer.state.time in range(2, 200))
    QTest.mouseClick(panel.run, LEFT)
    wait_until(lambda: panel._state.text() == "Recording, paused")
    assert panel.run.text() == "Continue"
    QTest.mouseClick(panel.record, LEFT)
    wait_until(lambda: panel.status.bake)
    assert panel.status.recorded is not None
    done = panel.status.recorded[0]
    assert panel._message.text().startswith(f"{done} of 200 frames recorded: bake.usda.")
    assert panel.record.text() == "Record" and panel.run.text() == "Run"
    first, last = workspace.timeline.ruler.cached
    assert first == 1.0 and done - 1 <= last <= done  # the last frame is recorded before it is seen
    assert remembered.recent_files()[0] == target
    QTest.mouseClick(panel.open_bake, LEFT)
    wait_until(lambda: window.workspace is not workspace)
    now = window.workspace
    assert now is not None and now.opened.name == "bake.usda"
    assert now.opened.baked == now.timeline.ruler.baked == (1.0, done)
    wait_until(lambda: now.simulation.status.state == "ready")
    assert now.simulation._state.text() == f"Baked, frames 1–{done}"
    baked = Usd.Stage.Open(str(target))
    (field,) = [prim for prim in baked.Traverse() if is_splat_field(prim)]
    assert field.GetAttribute("positions").GetTimeSamples()[-1] == done


@pytest.mark.parametrize(
    ("is_stopped", "buttons"),
    [(True, {"Resume", "Replace", "Cancel"}), (False, {"Replace", "Cancel"})],
)
def test_what_becomes_of_a_bake_that_is_there_is_asked(
    workspace: Workspace, tmp_path: Path, is_stopped: bool, buttons: set[str]
) -> None:
    """Oracle: the answers that a person would want, and what the runner was asked for."""
    panel, target = workspace.simulation, tmp_path / "bake.usda"
    asked: list[dict[str, object]] = []
    layer = Sdf.Layer.CreateNew(str(target))
    layer.customLayerData = nested({"checkpoint": "there" if is_stopped else ""})
    layer.Save()
    workspace.proxy.ask(
        lambda document: setattr(
            document.simulation, "record", lambda path, **options: asked.append(options)
        )
    )
    panel.record_to(target)
    wait_until(lambda: panel.findChildren(QMessageBox))
    box = panel.findChild(QMessageBox)
    assert {button.text().replace("&", "") for button in box.buttons()} == buttons
    QTest.mouseClick(box.defaultButton(), LEFT)
    wait_until(lambda: bool(asked) or not is_stopped)
    assert asked == ([{"existing": "resume"}] if is_stopped else [])


def test_a_flipbook_of_what_was_not_simulated_says_so(window: Window, workspace: Workspace) -> None:
    """Oracle: the hint, and the frames that are offered once some are simulated."""
    panel = workspace.simulation
    wait_until(lambda: panel.status.state == "ready")
    dialog = FlipbookDialog(workspace.context, window)
    assert not dialog.hint.isHidden() and dialog.frames() == (1.0, 2.0, 3.0, 4.0)
    for frame in (1.0, 2.0):
        QTest.mouseClick(panel.step, LEFT)
        wait_until(lambda frame=frame: panel.status.frames == (1.0, frame))
        wait_until(lambda: panel.status.state == "paused")
    dialog = FlipbookDialog(workspace.context, window)
    assert dialog.hint.isHidden() and dialog.frames() == (1.0, 2.0)


def test_keys_run_and_pause(window: Window, workspace: Workspace) -> None:
    """Oracle: the state that the simulation tells."""
    panel = workspace.simulation
    wait_until(lambda: panel.status.state == "ready")
    workspace.viewport.setFocus(Qt.FocusReason.OtherFocusReason)
    press(window, "Ctrl+Right")
    wait_until(lambda: panel.status.frame is not None)
    press(window, "Ctrl+Home")
    wait_until(lambda: panel.status.state == "ready")


def test_a_click_on_its_outline_selects_what_acts_on_a_simulation(
    window: Window, tmp_path: Path
) -> None:
    """Oracle: the selection, by the place of a point of the ball's circle; its middle is that of
    what is seen there, Shift takes it out, and hidden outlines are no target."""
    stage = shot(tmp_path, {}, last=LAST)
    ball = UsdGeom.Sphere.Define(stage, "/World/Ball")
    ball.CreateRadiusAttr(0.5)
    ball.CreatePurposeAttr("guide")
    author(ball.GetPrim(), {"affector:role": "collide"})
    link = simulation_of(stage).CreateRelationship("collection:affectors:includes", custom=False)
    link.AddTarget("/World/Ball")
    stage.Save()
    workspace = opened(window, Path(stage.GetRootLayer().realPath))
    viewport, viewer = workspace.viewport, workspace.context.viewer
    wait_until(lambda: any(each.path for each in settled(workspace).overlays.affectors))
    (edges,) = [each for each in settled(workspace).overlays.affectors if each.path]
    assert viewport.projection is not None

    def place(point: np.ndarray) -> QPoint:
        world = edges.to_world[:3, :3] @ point + edges.to_world[:3, 3]
        x, y = viewport.projection.pixels(world)[0] / viewport.devicePixelRatioF()
        return QPoint(round(x), round(y))

    on_it = place(edges.segments[7, 0])
    QTest.mouseMove(viewport, on_it)
    QTest.mouseClick(viewport, LEFT, pos=on_it)
    assert viewer.state.selected == ("/World/Ball",)
    QTest.mouseClick(viewport, LEFT, Qt.KeyboardModifier.ShiftModifier, on_it)
    assert viewer.state.selected == ()
    QTest.mouseClick(viewport, LEFT, pos=place(np.zeros(3)))
    assert viewer.state.selected != ("/World/Ball",)
    press(window, "G")
    wait_until(lambda: not settled(workspace).overlays.affectors)
    viewer.select(())
    QTest.mouseClick(viewport, LEFT, pos=on_it)
    assert viewer.state.selected != ("/World/Ball",)
