"""Tests of what a viewport paints: pictures to the pixel, boxes, numbers and text."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF, QRectF
from PySide6.QtGui import QImage, QPainter
from PySide6.QtTest import QSignalSpy, QTest
from PySide6.QtWidgets import QApplication

from tests.preview.fakes import FakeSession, picture_of
from tests.preview.qt.bench import (
    ALT,
    HEIGHT,
    LEFT,
    WIDTH,
    Bench,
)
from tests.preview.qt.conftest import wait_until
from usdsplat.preview.boxes import corners
from usdsplat.preview.qt import viewport_hud as hud
from usdsplat.preview.qt.viewport import Viewport
from usdsplat.preview.values import Look, ViewState
from usdsplat.preview.viewer import Viewer
from usdsplat.render.settings import RenderSettings


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


def test_the_drag_of_a_handle_says_its_numbers_as_long_as_it_lasts(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the distance that the prim was moved by; the pane is within the viewport."""
    painted: list[tuple[str, QRectF]] = []
    paint_label = hud.paint_label

    def noted(painter: QPainter, text: str, top: QPointF, place: QRectF) -> QRectF:
        painted.append((text, paint_label(painter, text, top, place)))
        return painted[-1][1]

    monkeypatch.setattr(hud, "paint_label", noted)
    bench.viewer.select(("/Ball",))
    manipulator, projection = bench.viewport.manipulator, bench.viewport.projection
    assert manipulator is not None
    assert projection is not None
    shape = next(each for each in manipulator.shapes(projection) if each.handle == "x")
    at = QPoint(*(round(value) for value in shape.points.mean(axis=0)))
    pixels_of(bench.viewport)
    assert painted == []
    QTest.mousePress(bench.viewport, LEFT, pos=at)
    bench.move(at + QPoint(30, 10))
    pixels_of(bench.viewport)
    moved = bench.session.document.edits.moves[-1][1][3] - 0.5
    text, pane = painted[-1]
    assert text == f"X {moved:+.4g}"
    assert QRectF(bench.viewport.rect()).contains(pane)
    QTest.mouseRelease(bench.viewport, LEFT, pos=at + QPoint(30, 10))
    painted.clear()
    pixels_of(bench.viewport)
    assert painted == []


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
        missing=1200,
        scale=2.0,
        is_final=False,
        milliseconds={"sort": 1.25, "blend": 8.0, "total": 9.5},
        megabytes=812.4,
        warnings=("one",),
    )
    rows = dict(hud.rows_of(picture, rate=31.4))
    assert (rows["splats"], rows["  of"]) == ("182\u2009404", "1\u2009204\u2009331")
    assert (rows["frame"], rows["fps"], rows["quality"]) == ("12", "31", "1 : 2")
    assert (rows["draw"], rows["  blend"], rows["memory"]) == ("9.5 ms", "8.0", "812 MB")
    assert (rows["device"], rows["warnings"]) == ("cpu", "1")
    assert rows["reading"] == "1\u2009200 nodes"


def test_names_say_what_is_compared() -> None:
    """Oracle: by hand."""
    assert hud.look_names(ViewState()) == ("color", "")
    compared = ViewState(other=Look(time=7.0))
    assert hud.look_names(compared) == ("A · color", "B · color · frame 7")
    relit = Look(settings=RenderSettings(lighting="relit", self_shadows=True))
    names = ("A · color · captured · self shadows off", "B · color · relit · self shadows on")
    assert hud.look_names(ViewState(other=relit)) == names


def test_the_viewport_does_not_outlive_its_viewer_in_secret(application: QApplication) -> None:
    """Oracle: a viewer that changes after its viewport is gone tells nobody who is dead."""
    viewer = Viewer(FakeSession())
    viewport = Viewport(viewer)
    viewport.deleteLater()
    gone = QSignalSpy(viewport.destroyed)
    wait_until(lambda: gone.count() > 0)
    viewer.set_wipe(0.3)
    assert viewer.state.wipe == 0.3
