"""The viewport is driven as a person would, before a session that remembers what it was told."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QImage, QMouseEvent, QWheelEvent
from PySide6.QtTest import QSignalSpy, QTest
from PySide6.QtWidgets import QApplication

from tests.preview.fakes import OPENED, FakeSession, picture_of
from tests.preview.qt.conftest import wait_until
from usdsplat.preview.boxes import corners
from usdsplat.preview.camera import ORBIT, FreeCamera
from usdsplat.preview.manipulator import AXES, Handle
from usdsplat.preview.qt import viewport_hud as hud
from usdsplat.preview.qt.viewport import Viewport
from usdsplat.preview.qt.viewport_navigation import DOLLY, HURRY, QUICKER
from usdsplat.preview.values import Look, ViewState
from usdsplat.preview.viewer import Viewer

LEFT, MIDDLE, RIGHT = (
    Qt.MouseButton.LeftButton,
    Qt.MouseButton.MiddleButton,
    Qt.MouseButton.RightButton,
)
NONE, ALT, CTRL = (
    Qt.KeyboardModifier.NoModifier,
    Qt.KeyboardModifier.AltModifier,
    Qt.KeyboardModifier.ControlModifier,
)
WIDTH, HEIGHT = 600, 400
MIDDLE_OF_IT = QPoint(450, 120)
"""A place without a handle."""


class Bench:
    """A viewport that shows a first picture, its viewer and its session."""

    def __init__(self) -> None:
        self.session = FakeSession()
        self.viewer = Viewer(self.session)
        self.viewport = Viewport(self.viewer)
        self.viewport.resize(WIDTH, HEIGHT)
        self.viewport.show()
        wait_until(lambda: self.viewer.state.size == (WIDTH, HEIGHT))
        self.viewer.opened(OPENED)
        self.show()

    def show(self) -> None:
        """A picture of what was asked for comes."""
        picture = picture_of(self.viewer.state)
        self.viewer.shown(picture)
        self.viewport.show_picture(picture)

    @property
    def camera(self) -> FreeCamera:
        """That the session was told of last."""
        camera = self.session.states[-1].camera
        assert isinstance(camera, FreeCamera)
        return camera

    def start(self) -> FreeCamera:
        """What the next move begins with."""
        camera = self.viewer.free_camera()
        assert camera is not None
        return camera

    def drag(
        self,
        way: QPoint,
        button: Qt.MouseButton = LEFT,
        modifiers: Qt.KeyboardModifier = NONE,
        *,
        at: QPoint = MIDDLE_OF_IT,
    ) -> None:
        """Press, move in four steps and let go."""
        QTest.mousePress(self.viewport, button, modifiers, at)
        for part in (0.25, 0.5, 0.75, 1.0):
            self.move(at + way * part, button, modifiers)
        QTest.mouseRelease(self.viewport, button, modifiers, at + way)

    def move(
        self, to: QPoint, button: Qt.MouseButton = LEFT, modifiers: Qt.KeyboardModifier = NONE
    ) -> None:
        """Move the pointer with a button down, which QTest.mouseMove forgets."""
        place = QPointF(to)
        event = QMouseEvent(
            QEvent.Type.MouseMove,
            place,
            self.viewport.mapToGlobal(place),
            Qt.MouseButton.NoButton,
            button,
            modifiers,
        )
        QApplication.sendEvent(self.viewport, event)

    def turn_wheel(self, units: int) -> None:
        """Turn the wheel over the middle."""
        place = QPointF(MIDDLE_OF_IT)
        event = QWheelEvent(
            place,
            self.viewport.mapToGlobal(place),
            QPoint(),
            QPoint(0, units),
            Qt.MouseButton.NoButton,
            NONE,
            Qt.ScrollPhase.NoScrollPhase,
            False,
        )
        QApplication.sendEvent(self.viewport, event)


@pytest.fixture
def bench(application: QApplication) -> Iterator[Bench]:
    """Closed in the end."""
    made = Bench()
    yield made
    made.viewport.close()


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
    bench.turn_wheel(240)
    wait_until(lambda: bench.session.states[-1].is_moving)
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


def test_a_click_picks_and_moves_nothing(bench: Bench) -> None:
    """Oracle: the signal, in pixels of the viewport; a hand that trembles still clicks."""
    picks = QSignalSpy(bench.viewport.pick_requested)
    told = len(bench.session.states)
    bench.drag(QPoint(2, 1))
    assert picks.count() == 1
    assert picks.at(0) == [MIDDLE_OF_IT.x(), MIDDLE_OF_IT.y()]
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
    """Oracle: what the document is asked for the bounds of."""
    bench.viewer.select(("/Ball",))
    for key, modifiers, paths in (
        (Qt.Key.Key_F, NONE, ("/Ball",)),
        (Qt.Key.Key_F, Qt.KeyboardModifier.ShiftModifier, ()),
        (Qt.Key.Key_A, NONE, ()),
    ):
        bench.session.document.asked.clear()
        QTest.keyClick(bench.viewport, key, modifiers)
        assert bench.session.document.asked == [paths]
    assert bench.camera.target == pytest.approx((0.0, 0.5, 0.0))


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


def pixels_of(viewport: Viewport) -> np.ndarray:
    """What is seen, shape (h, w, 3)."""
    image = viewport.grab().toImage().convertToFormat(QImage.Format.Format_RGB888)
    rows = np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), -1)
    return rows[:, : 3 * image.width()].reshape(image.height(), image.width(), 3).copy()


def test_a_picture_is_shown_to_the_pixel(bench: Bench) -> None:
    """Oracle: the picture's own bytes, away from what is painted over it."""
    noise = np.random.default_rng(1).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    bench.viewport.show_picture(picture_of(bench.viewer.state, image=noise))
    seen = pixels_of(bench.viewport)
    assert (seen[80:300, 300:560] == noise[80:300, 300:560]).all()


def test_a_coarse_picture_fills_the_viewport_and_says_so(bench: Bench) -> None:
    """Oracle: its colour everywhere; the mark, in the colour that says that."""
    image = np.full((HEIGHT // 2, WIDTH // 2, 3), (40, 80, 120), np.uint8)
    bench.viewport.show_picture(picture_of(bench.viewer.state, image=image, scale=2.0))
    seen = pixels_of(bench.viewport)
    assert (seen[80:300, 300:560] == (40, 80, 120)).all()
    corner = seen[HEIGHT - 40 :, WIDTH // 2 :].astype(int)
    bench.viewport.show_picture(picture_of(bench.viewer.state, image=image))
    plain = pixels_of(bench.viewport)[HEIGHT - 40 :, WIDTH // 2 :]
    assert (corner[..., 0] - corner[..., 2]).max() > 60, "amber"
    assert (plain[..., 0].astype(int) - plain[..., 2]).max() < 10


def test_boxes_of_what_is_selected_are_painted_where_they_are_seen(bench: Bench) -> None:
    """Oracle: the projection of a corner: bright there, and the picture's grey without a box."""
    projection = bench.viewport.projection
    assert projection is not None
    box = corners((np.array((-0.4, 0.1, -0.4)), np.array((0.4, 0.9, 0.4))))
    bench.viewport.show_picture(picture_of(bench.viewer.state, boxes=(box,)))
    seen = pixels_of(bench.viewport)
    for x, y in projection.pixels(box):
        around = seen[int(y) - 1 : int(y) + 3, int(x) - 1 : int(x) + 3]
        assert around.max() > 150
    assert pixels_of(bench.viewport)[HEIGHT // 2, -20].max() == 90


def test_before_a_picture_the_viewport_says_what_to_do(application: QApplication) -> None:
    """Oracle: it is painted, and a drag of nothing does nothing."""
    session = FakeSession()
    viewport = Viewport(Viewer(session))
    viewport.resize(300, 200)
    viewport.show()
    assert len(np.unique(pixels_of(viewport))) > 3
    told = len(session.states)
    QTest.mousePress(viewport, LEFT, ALT, QPoint(50, 50))
    QTest.mouseRelease(viewport, LEFT, ALT, QPoint(90, 50))
    assert len(session.states) == told
    viewport.close()


def test_the_numbers_say_what_was_drawn(bench: Bench) -> None:
    """Oracle: the picture's own."""
    state = replace(bench.viewer.state, time=12.0)
    picture = picture_of(
        state,
        splats=182404,
        total=1204331,
        scale=2.0,
        is_final=False,
        milliseconds={"sort": 1.25, "blend": 8.0, "total": 9.5},
        megabytes=812.4,
        warnings=("one",),
    )
    rows = dict(hud.rows_of(picture, rate=31.4))
    assert rows["splats"] == "182\u2009404 / 1\u2009204\u2009331"
    assert (rows["frame"], rows["fps"], rows["quality"]) == ("12", "31", "1 : 2")
    assert (rows["draw"], rows["  blend"], rows["memory"]) == ("9.5 ms", "8.0", "812 MB")
    assert (rows["device"], rows["warnings"]) == ("cpu", "1")


def test_names_say_what_is_compared() -> None:
    """Oracle: by hand."""
    assert hud.look_names(ViewState()) == ("color", "")
    compared = ViewState(other=Look(time=7.0))
    assert hud.look_names(compared) == ("color", "color · frame 7")


def test_the_viewport_does_not_outlive_its_viewer_in_secret(application: QApplication) -> None:
    """Oracle: a viewer that changes after its viewport is gone tells nobody who is dead."""
    viewer = Viewer(FakeSession())
    viewport = Viewport(viewer)
    viewport.deleteLater()
    gone = QSignalSpy(viewport.destroyed)
    wait_until(lambda: gone.count() > 0)
    viewer.set_wipe(0.3)
    assert viewer.state.wipe == 0.3


def test_an_orbit_over_the_height_is_half_a_turn(bench: Bench) -> None:
    """Oracle: the closed form, by a drag of the whole height."""
    start = bench.start()
    bench.drag(QPoint(-HEIGHT, 0), LEFT, ALT)
    assert math.pi == ORBIT
    assert np.dot(bench.camera.axes[0], start.axes[0]) == pytest.approx(-1.0)
