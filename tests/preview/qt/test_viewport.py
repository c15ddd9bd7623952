"""Tests of the viewport with mouse and key events, and a session that records requests."""

from __future__ import annotations

import math

import numpy as np
import pytest
from PySide6.QtCore import QEvent, QObject, QPoint, Qt, QTimer
from PySide6.QtTest import QSignalSpy, QTest
from PySide6.QtWidgets import QApplication, QWidget

from tests.preview.fakes import BOX
from tests.preview.qt.bench import (
    ALT,
    CTRL,
    HEIGHT,
    LEFT,
    MIDDLE,
    MIDDLE_OF_IT,
    NONE,
    RIGHT,
    WIDTH,
    Bench,
)
from tests.preview.qt.conftest import wait_until
from usdsplat.preview.camera import ORBIT
from usdsplat.preview.manipulator import AXES, Handle
from usdsplat.preview.qt.viewport_navigation import DOLLY, HURRY, QUICKER
from usdsplat.preview.values import Look


@pytest.mark.parametrize(("button", "modifiers"), [(LEFT, ALT), (LEFT, NONE)])
def test_a_drag_with_the_left_button_orbits(
    bench: Bench, button: Qt.MouseButton, modifiers: Qt.KeyboardModifier
) -> None:
    """Oracle: the free camera's orbit by the drag, in parts of the height."""
    start = bench.start()
    bench.drag(QPoint(100, 40), button, modifiers)
    expected = start.orbited(100 / HEIGHT, 40 / HEIGHT)
    assert bench.camera.eye == pytest.approx(expected.eye)
    assert bench.camera.target == pytest.approx(expected.target)
    assert not bench.session.states[-1].is_moving, "let go"


@pytest.mark.parametrize("modifiers", [NONE, ALT])
def test_a_drag_with_the_middle_button_pans(bench: Bench, modifiers: Qt.KeyboardModifier) -> None:
    """Oracle: the free camera's pan."""
    start = bench.start()
    bench.drag(QPoint(-60, 20), MIDDLE, modifiers)
    expected = start.panned(-60 / HEIGHT, 20 / HEIGHT, aspect=WIDTH / HEIGHT)
    assert bench.camera.eye == pytest.approx(expected.eye)


def test_alt_and_the_right_button_dolly(bench: Bench) -> None:
    """Oracle: the closed form: right and down is nearer, as usdview has it."""
    start = bench.start()
    bench.drag(QPoint(40, 60), RIGHT, ALT)
    assert bench.camera.distance == pytest.approx(start.distance * math.exp(-DOLLY * 100 / HEIGHT))


def test_the_wheel_dollies_and_the_view_rests_soon_after(bench: Bench) -> None:
    """Oracle: 0.88 of the distance for each notch."""
    start = bench.start()
    bench.turn_wheel(120)
    told = len(bench.session.states)
    bench.turn_wheel(240)
    wait_until(lambda: any(state.is_moving for state in bench.session.states[told:]))
    assert bench.camera.distance == pytest.approx(start.distance * 0.88**3)
    wait_until(lambda: not bench.session.states[-1].is_moving)


def test_many_moves_are_one_look(bench: Bench) -> None:
    """Oracle: a pass of the event loop tells the session once, of the whole way."""
    start = bench.start()
    QTest.mousePress(bench.viewport, LEFT, ALT, MIDDLE_OF_IT)
    told = len(bench.session.states)
    for i in range(1, 51):
        bench.move(MIDDLE_OF_IT + QPoint(i, 0), LEFT, ALT)
    wait_until(lambda: len(bench.session.states) > told)
    assert len(bench.session.states) == told + 1
    assert bench.camera.eye == pytest.approx(start.orbited(50 / HEIGHT, 0.0).eye)
    assert bench.session.states[-1].is_moving
    wait_until(lambda: not bench.session.states[-1].is_moving)
    bench.move(MIDDLE_OF_IT + QPoint(60, 0), LEFT, ALT)
    wait_until(lambda: bench.session.states[-1].is_moving)
    QTest.mouseRelease(bench.viewport, LEFT, ALT, MIDDLE_OF_IT + QPoint(60, 0))
    assert not bench.session.states[-1].is_moving


def test_a_move_of_the_view_paints_with_its_picture_only(bench: Bench) -> None:
    """Oracle: counted paint events: a drag paints nothing anew, which would hold up the picture
    that it asks for; that picture, the wipe and the end of the drag do."""
    painted = Paintings(bench.viewport)
    bench.start()
    QTest.mousePress(bench.viewport, LEFT, ALT, MIDDLE_OF_IT)
    painted.settle()
    for i in range(1, 4):
        told = len(bench.session.states)
        bench.move(MIDDLE_OF_IT + QPoint(9 * i, 0), LEFT, ALT)
        wait_until(lambda told=told: len(bench.session.states) > told)
    assert painted.settle() == 0
    bench.show()
    assert painted.settle() == 1
    bench.viewer.set_other(Look(aov="Z"))
    assert painted.settle() == 1
    bench.viewer.set_wipe(0.25)
    assert painted.settle() == 1
    QTest.mouseRelease(bench.viewport, LEFT, ALT, MIDDLE_OF_IT + QPoint(27, 0))
    assert painted.settle() == 1


class Paintings(QObject):
    """Counts the paint events of a widget."""

    def __init__(self, widget: QWidget) -> None:
        super().__init__()
        self._count = 0
        self._widget = widget
        widget.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        self._count += event.type() == QEvent.Type.Paint
        return False

    def settle(self) -> int:
        """Handle all events that wait, and return how many paintings there were since."""
        turns: list[None] = []
        for _ in range(3):
            QTimer.singleShot(0, lambda: turns.append(None))
        wait_until(lambda: len(turns) == 3)
        found, self._count = self._count, 0
        return found


def test_a_click_picks_and_moves_nothing(bench: Bench) -> None:
    """Oracle: the signal, in pixels of the viewport; a hand that trembles still clicks."""
    picks = QSignalSpy(bench.viewport.pick_requested)
    told = len(bench.session.states)
    bench.drag(QPoint(2, 1))
    assert picks.count() == 1
    assert picks.at(0) == [MIDDLE_OF_IT.x(), MIDDLE_OF_IT.y(), False]
    bench.drag(QPoint(0, 0), LEFT, ALT)
    assert picks.count() == 1, "Alt holds the view, however little it moves"
    assert not [state for state in bench.session.states[told:] if state.is_moving]


def test_a_double_click_asks_for_another_focus(bench: Bench) -> None:
    """Oracle: the signal; a double click on a handle is none."""
    focuses = QSignalSpy(bench.viewport.focus_requested)
    QTest.mouseDClick(bench.viewport, LEFT, NONE, MIDDLE_OF_IT)
    assert focuses.at(0) == [MIDDLE_OF_IT.x(), MIDDLE_OF_IT.y()]
    bench.viewer.select(("/Ball",))
    QTest.mouseDClick(bench.viewport, LEFT, NONE, grip(bench, "x"))
    assert focuses.count() == 1


def test_the_right_button_looks_around_and_keys_fly(bench: Bench) -> None:
    """Oracle: the way goes along the camera's axes, and ends where the keys are let go."""
    start = bench.start()
    QTest.mousePress(bench.viewport, RIGHT, NONE, MIDDLE_OF_IT)
    bench.move(MIDDLE_OF_IT + QPoint(30, 0), RIGHT)
    wait_until(lambda: bench.session.states[-1].is_moving)
    turned = bench.camera
    assert turned.eye == start.eye
    assert turned.axes == pytest.approx(start.looked_around(30 / HEIGHT, 0.0).axes)
    QTest.keyPress(bench.viewport, Qt.Key.Key_W)
    QTest.keyPress(bench.viewport, Qt.Key.Key_E)
    wait_until(lambda: math.dist(bench.camera.eye, turned.eye) > 0.05)
    way = turned.axes @ np.subtract(bench.camera.eye, turned.eye)
    assert way[0] == pytest.approx(0.0, abs=1e-9)
    QTest.keyRelease(bench.viewport, Qt.Key.Key_W)
    QTest.keyRelease(bench.viewport, Qt.Key.Key_E)
    assert not bench.viewer.is_ticking
    QTest.mouseRelease(bench.viewport, RIGHT, NONE, MIDDLE_OF_IT)
    assert not bench.session.states[-1].is_moving
    assert bench.viewport.mode == "translate", "W and E were for the flight"


def test_shift_hurries_and_the_wheel_changes_the_speed_of_a_flight(bench: Bench) -> None:
    """Oracle: the viewer's speed; the flight that is asked for."""
    start = bench.start()
    QTest.mousePress(bench.viewport, RIGHT, NONE, MIDDLE_OF_IT)
    bench.turn_wheel(240)
    assert bench.viewer.speed == pytest.approx(QUICKER**2)
    QTest.keyPress(bench.viewport, Qt.Key.Key_D, Qt.KeyboardModifier.ShiftModifier)
    assert bench.viewer.flight == (HURRY, 0.0, 0.0)
    QTest.keyPress(bench.viewport, Qt.Key.Key_A, NONE)
    assert bench.viewer.flight == (0.0, 0.0, 0.0), "opposite keys cancel"
    QTest.mouseRelease(bench.viewport, RIGHT, NONE, MIDDLE_OF_IT)
    assert bench.start().distance == pytest.approx(start.distance), "no dolly meanwhile"


def test_keys_frame_what_is_selected_or_everything(bench: Bench) -> None:
    """Oracle: what the document is asked for the bounds of; what is framed is centred."""
    bench.viewer.select(("/Ball",))
    for key, modifiers, paths in (
        (Qt.Key.Key_F, NONE, ("/Ball",)),
        (Qt.Key.Key_F, Qt.KeyboardModifier.ShiftModifier, ()),
        (Qt.Key.Key_A, NONE, ()),
    ):
        bench.session.document.asked.clear()
        QTest.keyClick(bench.viewport, key, modifiers)
        assert bench.session.document.asked == [paths]
    middle = 0.5 * (BOX[0] + BOX[1])
    assert (bench.camera.axes @ (bench.camera.target - middle))[2] == pytest.approx(0, abs=1e-9)
    assert np.linalg.norm(bench.camera.target - middle) < 0.3


def test_keys_choose_the_manipulator_its_space_and_the_numbers(bench: Bench) -> None:
    """Oracle: Q, W, E and R as other packages have them."""
    for key, mode in (("E", "rotate"), ("R", "scale"), ("Q", None), ("W", "translate")):
        QTest.keyClick(bench.viewport, key)
        assert bench.viewport.mode == mode
    QTest.keyClick(bench.viewport, "x")
    assert bench.viewport.space == "local"
    QTest.keyClick(bench.viewport, "h")
    assert not bench.viewport.shows_hud


def grip(bench: Bench, handle: Handle) -> QPoint:
    """A place on a handle."""
    manipulator, projection = bench.viewport.manipulator, bench.viewport.projection
    assert manipulator is not None
    assert projection is not None
    shapes = {shape.handle: shape for shape in manipulator.shapes(projection)}
    x, y = shapes[handle].points.mean(axis=0)
    return QPoint(round(x), round(y))


@pytest.mark.parametrize("handle", AXES)
def test_a_drag_of_a_handle_moves_the_prim(bench: Bench, handle: Handle) -> None:
    """Oracle: the prim goes along its axis, by as much as the pointer did on the screen."""
    bench.viewer.select(("/Ball",))
    place = grip(bench, handle)
    manipulator, projection = bench.viewport.manipulator, bench.viewport.projection
    assert manipulator is not None
    assert projection is not None
    axis = np.eye(3)[AXES.index(handle)]
    first, second = projection.pixels([manipulator.origin, manipulator.origin + 0.3 * axis])
    way = QPoint(*(round(value) for value in second - first))
    told = len(bench.session.states)
    bench.drag(way, at=place)
    moves = bench.session.document.edits.moves
    assert {path for path, *_ in moves} == {"/Ball"}
    assert len({key for *_, key in moves}) == 1, "one step of undo"
    shift = np.reshape(moves[-1][1], (4, 4))[:3, 3] - (0.5, 0.0, 0.0)
    assert shift == pytest.approx(0.3 * axis, abs=0.1)
    assert not [state for state in bench.session.states[told:] if state.camera is not None]


def test_ctrl_snaps_a_drag(bench: Bench) -> None:
    """Oracle: whole steps, where the free drag has none."""
    bench.viewer.select(("/Ball",))
    bench.drag(QPoint(37, 0), LEFT, CTRL, at=grip(bench, "x"))
    shift = bench.session.document.edits.moves[-1][1][3] - 0.5
    assert shift > 0
    assert shift / 0.1 == pytest.approx(round(shift / 0.1))


def test_the_wipe_is_dragged(bench: Bench) -> None:
    """Oracle: the part of the width where the pointer is; without a comparison nothing is there."""
    at = QPoint(WIDTH // 2, 50)
    bench.viewer.set_other(Look(aov="depth"))
    bench.drag(QPoint(-150, 0), at=at)
    assert bench.session.states[-1].wipe == pytest.approx(0.25)
    assert bench.session.states[-1].camera is None
    bench.viewer.set_other(None)
    bench.drag(QPoint(50, 0), at=QPoint(WIDTH // 4, 50))
    assert bench.session.states[-1].wipe == pytest.approx(0.25)


def test_the_pointer_probes_while_it_holds_nothing(bench: Bench) -> None:
    """Oracle: the signal, once for many moves, and one when the pointer leaves."""
    moved, left = QSignalSpy(bench.viewport.probe_moved), QSignalSpy(bench.viewport.probe_left)
    for x in range(40):
        bench.move(QPoint(100 + x, 100), Qt.MouseButton.NoButton)
    wait_until(lambda: moved.count() > 0)
    assert moved.count() == 1
    assert moved.at(0) == [139.0, 100.0]
    QApplication.sendEvent(bench.viewport, QEvent(QEvent.Type.Leave))
    assert left.count() == 1


def test_a_resize_is_told_in_pixels_of_the_screen(bench: Bench) -> None:
    """Oracle: the widget's size, times the screen's ratio."""
    bench.viewport.resize(500, 300)
    ratio = bench.viewport.devicePixelRatioF()
    wait_until(lambda: bench.session.states[-1].size == (500 * ratio, 300 * ratio))


def test_an_orbit_over_the_height_is_half_a_turn(bench: Bench) -> None:
    """Oracle: the closed form, by a drag of the whole height."""
    start = bench.start()
    bench.drag(QPoint(-HEIGHT, 0), LEFT, ALT)
    assert math.pi == ORBIT
    assert np.dot(bench.camera.axes[0], start.axes[0]) == pytest.approx(-1.0)
