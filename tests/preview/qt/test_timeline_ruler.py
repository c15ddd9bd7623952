"""Tests of the timeline ruler: positions of times, and dragging."""

from __future__ import annotations

import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from usdsplat.preview.qt import style
from usdsplat.preview.qt.timeline_ruler import MARGIN, NEAREST_LABELS, TimelineRuler, tick_step


@pytest.fixture
def ruler(application: QApplication) -> TimelineRuler:
    ruler = TimelineRuler()
    ruler.resize(200 + 2 * MARGIN, 34)
    ruler.show_range(100, 200)
    ruler.show()
    return ruler


def test_a_drag_scrubs_by_whole_frames_within_the_range(ruler: TimelineRuler) -> None:
    """Oracle: two pixels to a frame."""
    times: list[float] = []
    ruler.scrubbed.connect(times.append)
    QTest.mousePress(ruler, Qt.MouseButton.LeftButton, pos=QPoint(MARGIN + 41, 10))
    for x in (MARGIN + 100, MARGIN + 500, -50):
        QTest.mouseMove(ruler, QPoint(x, 10))
    QTest.mouseRelease(ruler, Qt.MouseButton.LeftButton, pos=QPoint(-50, 10))
    assert times == [120, 150, 200, 100]


def test_with_control_it_scrubs_between_frames(ruler: TimelineRuler) -> None:
    """Oracle: two pixels to a frame."""
    times: list[float] = []
    ruler.scrubbed.connect(times.append)
    control = Qt.KeyboardModifier.ControlModifier
    QTest.mousePress(ruler, Qt.MouseButton.LeftButton, control, QPoint(MARGIN + 41, 10))
    assert times == [120.5]


def test_what_a_simulation_has_made_is_drawn_under_it(ruler: TimelineRuler) -> None:
    """Oracle: the colour at its frames, and not beside them."""
    ruler.show_cached((120, 150))
    image = ruler.grab().toImage()
    y = image.height() - 2
    assert image.pixelColor(MARGIN + 60, y) == style.CACHED
    assert image.pixelColor(MARGIN + 20, y) == style.SUNK
    assert image.pixelColor(MARGIN + 150, y) == style.SUNK


@pytest.mark.parametrize("length", [0, 1, 7, 24, 100, 240, 12345, 1e6])
@pytest.mark.parametrize("pixels", [1, 100, 900, 3000])
def test_labels_stand_apart(length: float, pixels: float) -> None:
    """Oracle: the definition, with the next finer step tried."""
    step = tick_step(length, pixels)
    assert step >= 1
    room = step / length * pixels if length else pixels
    assert room >= min(NEAREST_LABELS, pixels) * (1 - 1e-9) or step >= length
    if step > 1:
        assert step / 2.5 / length * pixels < NEAREST_LABELS
