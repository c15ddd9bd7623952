"""Tests of a viewport with a real session: user input leads to pictures and edits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from pxr import Usd, UsdGeom
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from tests.delegate.stages import random_cloud
from tests.preview.qt.conftest import wait_until
from usdsplat import schema
from usdsplat.preview.document import Document
from usdsplat.preview.picking import Picked, pick
from usdsplat.preview.qt.session_proxy import SessionProxy
from usdsplat.preview.qt.viewport import Viewport
from usdsplat.preview.session import Session
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.stage_model.placing import transform
from usdsplat.preview.values import Look, Picture
from usdsplat.preview.viewer import Viewer

LEFT, NONE = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier


class Room:
    """A session on a ball and a few splats, with a viewport."""

    def __init__(self) -> None:
        self.stage = Usd.Stage.CreateInMemory()
        schema.author(self.stage, "/Splats", random_cloud(3, n=40, spread=0.3))
        ball = UsdGeom.Sphere.Define(self.stage, "/Ball")
        ball.CreateRadiusAttr(0.5)
        ball.AddTranslateOp().Set((1.5, 0.0, 0.0))
        self.problems: list[object] = []
        self.pictures: list[Picture] = []
        self.picked: list[Picked | None] = []
        self.session = Session(self._open)
        self.proxy = SessionProxy(self.session)
        self.viewer = Viewer(self.proxy)
        self.viewport = Viewport(self.viewer)
        self.viewport.resize(320, 240)
        self.proxy.opened.connect(self.viewer.opened)
        self.proxy.picture.connect(self._show)
        self.proxy.stage_changed.connect(self.viewer.stage_changed)
        self.proxy.problem.connect(self.problems.append)
        self.viewport.pick_requested.connect(
            lambda x, y, _: self.proxy.ask(
                lambda document: pick(document, x, y), self.picked.append
            )
        )
        self.viewport.show()

    def close(self) -> None:
        """End the session, then the viewport."""
        self.session.close()
        self.proxy.close()
        self.viewport.close()
        assert self.problems == []

    def settle(self) -> Picture:
        """The final picture of what was asked for."""
        wait_until(lambda: self.pictures and self._is_settled(self.pictures[-1]))
        return self.pictures[-1]

    def place_of(self, point: tuple[float, float, float]) -> QPoint:
        """Where a point of the world is seen."""
        projection = self.viewport.projection
        assert projection is not None
        x, y = projection.pixels(point)[0] / self.viewport.devicePixelRatioF()
        return QPoint(round(x), round(y))

    def ask(self, task: Callable[[Document], Any]) -> Any:
        """What the session answers."""
        answers: list[Any] = []
        self.proxy.ask(task, answers.append)
        wait_until(lambda: answers)
        return answers[0]

    def drag(self, start: QPoint, end: QPoint, modifiers: Qt.KeyboardModifier = NONE) -> None:
        """Press, move and let go of the left button."""
        QTest.mousePress(self.viewport, LEFT, modifiers, start)
        for part in (0.5, 1.0):
            QTest.mouseMove(self.viewport, start + (end - start) * part)
            QApplication.processEvents()
        QTest.mouseRelease(self.viewport, LEFT, modifiers, end)

    def _open(self, publish: object) -> Document:
        document = Document(self.stage, publish=publish)
        document.edits = Edits(self.stage)
        return document

    def _show(self, picture: Picture) -> None:
        self.pictures.append(picture)
        self.viewer.shown(picture)
        self.viewport.show_picture(picture)

    def _is_settled(self, picture: Picture) -> bool:
        return picture.is_final and picture.state == self.viewer.state


@pytest.fixture
def room(application: QApplication) -> Iterator[Room]:
    """Settled at first, closed in the end."""
    made = Room()
    made.settle()
    yield made
    made.close()


def test_a_drag_turns_the_picture_about_what_was_framed(room: Room) -> None:
    """Oracle: the middle of the picture, at the depth of the middle of everything, stays where it
    was seen, and the picture is another."""
    before = room.settle()
    wait_until(lambda: room.viewer.subject is not None)
    camera = room.viewer.free_camera()
    assert camera is not None
    place = room.place_of(camera.target)
    assert place == QPoint(160, 120)
    room.drag(QPoint(200, 40), QPoint(260, 60), Qt.KeyboardModifier.AltModifier)
    after = room.settle()
    assert room.place_of(camera.target) == place
    assert after.scale == 1.0
    assert np.abs(after.image.astype(int) - before.image).max() > 30


def test_a_click_finds_the_prim_and_framing_fills_the_viewport_with_it(room: Room) -> None:
    """Oracle: the ball is where its centre is seen, and after F it is as high as its margin."""
    QTest.mouseClick(room.viewport, LEFT, NONE, room.place_of((1.5, 0.0, 0.0)))
    wait_until(lambda: room.picked)
    found = room.picked[0]
    assert found is not None
    assert (found.path, found.kind) == ("/Ball", "mesh")
    assert np.linalg.norm(np.subtract(found.position, (1.5, 0.0, 0.0))) == pytest.approx(
        0.5, rel=0.03
    )
    room.viewer.select((found.path,))
    QTest.keyClick(room.viewport, Qt.Key.Key_F)
    wait_until(lambda: room.viewer.state.camera is not None)
    room.settle()
    middle = room.place_of((1.5, 0.0, 0.0)) - QPoint(160, 120)
    assert max(abs(middle.x()), abs(middle.y())) <= 4  # a ball is no ellipse around its centre
    top, bottom = room.place_of((1.5, 0.5, 0.0)), room.place_of((1.5, -0.5, 0.0))
    assert 80 < bottom.y() - top.y() < 240


def test_a_handle_moves_the_ball_on_the_stage_and_its_box_with_it(room: Room) -> None:
    """Oracle: the stage's own transform; one undo takes the whole drag back."""
    room.viewer.select(("/Ball",))
    room.settle()
    wait_until(lambda: room.viewport.manipulator is not None)
    manipulator, projection = room.viewport.manipulator, room.viewport.projection
    assert manipulator is not None
    assert projection is not None
    shapes = {shape.handle: shape for shape in manipulator.shapes(projection)}
    start, tip = (QPoint(round(x), round(y)) for x, y in shapes["y"].points)
    first = room.settle().boxes[0]
    room.drag((start + tip) / 2, tip)

    def height() -> float:
        return room.ask(lambda document: transform(document.stage, "/Ball"))[7]

    wait_until(lambda: height() > 0.1)
    wait_until(lambda: room.pictures[-1].boxes and room.pictures[-1].boxes[0] != first)
    wait_until(
        lambda: (
            room.viewer.placement is not None
            and room.viewer.placement.matrix[7] == pytest.approx(height())
        )
    )
    moved = room.settle().boxes[0]
    assert np.subtract(moved, first)[:, 1] == pytest.approx(height(), abs=1e-6)
    room.ask(lambda document: document.edits.undo())
    wait_until(lambda: height() == 0.0)


def test_the_wipe_shows_another_look_at_its_right(room: Room) -> None:
    """Oracle: left of the wipe nothing changes, right of it the picture is the depth's."""
    before = room.settle().image
    room.viewer.set_other(Look(aov="depth"))
    room.settle()
    room.drag(QPoint(160, 30), QPoint(80, 30))
    compared = room.settle()
    assert compared.state.wipe == pytest.approx(0.25)
    assert (compared.image[:, :78] == before[:, :78]).all()
    right = compared.image[:, 82:].astype(int)
    assert np.abs(right[..., 0] - right[..., 2]).max() == 0, "depths are grey"
