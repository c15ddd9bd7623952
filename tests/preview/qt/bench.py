"""A viewport with a session that records requests, and functions that send mouse and key events."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QMouseEvent, QWheelEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from tests.preview.fakes import OPENED, FakeSession, picture_of
from tests.preview.qt.conftest import wait_until
from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.qt.viewport import Viewport
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
