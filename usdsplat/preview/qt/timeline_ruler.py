"""The timeline ruler: ticks, baked and simulated frames, and the current frame."""

from __future__ import annotations

import math

from PySide6.QtCore import QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QMouseEvent, QPainter, QPaintEvent, QPolygonF
from PySide6.QtWidgets import QSizePolicy, QWidget

from usdsplat.preview.qt import style

MARGIN = 14
"""Margins at the ends of the range [pixel], so that labels there are not cut."""
NEAREST_LABELS = 58
"""Minimum distance of labels [pixel]."""


class TimelineRuler(QWidget):
    """A ruler of time codes; press or drag to scrub."""

    scrubbed = Signal(float)
    """Time code under the pointer, an integer unless Ctrl is held."""
    released = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._range = (0.0, 0.0)
        self._current: float | None = None
        self.cached: tuple[float, float] | None = None
        """First and last simulated frame."""
        self.baked: tuple[float, float] | None = None
        """First and last frame of the stage's bake."""
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.setCursor(Qt.CursorShape.PointingHandCursor)
        self.show_baked(None)

    def sizeHint(self) -> QSize:
        return QSize(400, 34)

    def show_range(self, start: float, end: float) -> None:
        """Set the range of the ruler [time code]."""
        self._range = (start, max(start, end))
        self.update()

    def show_current(self, time: float | None) -> None:
        """Set the current frame; None for no time."""
        self._current = time
        self.update()

    def show_cached(self, frames: tuple[float, float] | None) -> None:
        """Set the first and last simulated frame."""
        self.cached = frames
        self.update()

    def show_baked(self, frames: tuple[float, float] | None) -> None:
        """Set the first and last frame of the stage's bake."""
        self.baked = frames
        told = "" if frames is None else f"\nBaked: frames {frames[0]:g} to {frames[1]:g}"
        self.setToolTip(f"Drag to scrub; with Ctrl between frames{told}")
        self.update()

    def position(self, time: float) -> float:
        """Return the position of a time code [pixel]."""
        start, end = self._range
        width = max(self.width() - 2 * MARGIN, 1)
        return MARGIN + (time - start) / (end - start or 1.0) * width

    def time_at(self, x: float, *, whole: bool = True) -> float:
        """Return the time code at a pixel, within the range."""
        start, end = self._range
        part = (x - MARGIN) / max(self.width() - 2 * MARGIN, 1)
        time = start + min(max(part, 0.0), 1.0) * (end - start)
        return min(max(float(round(time)), start), end) if whole else time

    # --- Qt's -------------------------------------------------------------------------------

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if event.button() == Qt.MouseButton.LeftButton:
            self._scrub(event)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if event.buttons() & Qt.MouseButton.LeftButton:
            self._scrub(event)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if event.button() == Qt.MouseButton.LeftButton:
            self.released.emit()

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.fillRect(self.rect(), style.SUNK)
        self._paint_band(painter, self.baked, style.ACCENT)
        self._paint_band(painter, self.cached, style.CACHED)
        self._paint_ticks(painter)
        if self._current is not None:
            self._paint_current(painter, self._current)

    # --- private ----------------------------------------------------------------------------

    def _scrub(self, event: QMouseEvent) -> None:
        whole = not event.modifiers() & Qt.KeyboardModifier.ControlModifier
        self.scrubbed.emit(self.time_at(event.position().x(), whole=whole))

    def _paint_band(
        self, painter: QPainter, frames: tuple[float, float] | None, color: QColor
    ) -> None:
        """Paint a band below the ticks, of the frames within the range."""
        start, end = self._range
        if frames is None or frames[1] < start or frames[0] > end:
            return
        left, right = self.position(max(frames[0], start)), self.position(min(frames[1], end))
        painter.fillRect(QRectF(left - 1.0, self.height() - 4.0, right - left + 2.0, 4.0), color)

    def _paint_ticks(self, painter: QPainter) -> None:
        start, end = self._range
        step = tick_step(end - start, self.width() - 2 * MARGIN)
        painter.setFont(style.digits())
        first = math.ceil(start / step)
        for index in range(first, math.floor(end / step) + 1):
            x = self.position(index * step)
            painter.setPen(style.OFF)
            painter.drawLine(QPointF(x, self.height() - 12.0), QPointF(x, self.height() - 5.0))
            painter.setPen(style.QUIET)
            label = QRectF(x - 40.0, 2.0, 80.0, 16.0)
            painter.drawText(label, Qt.AlignmentFlag.AlignCenter, f"{index * step:g}")
        fine = step / 5
        if fine >= 1 and self.position(fine) - self.position(0.0) >= 4.0:
            painter.setPen(style.RAISED)
            for index in range(math.ceil(start / fine), math.floor(end / fine) + 1):
                x = self.position(index * fine)
                painter.drawLine(QPointF(x, self.height() - 9.0), QPointF(x, self.height() - 5.0))

    def _paint_current(self, painter: QPainter, time: float) -> None:
        x = min(max(self.position(time), 2.0), self.width() - 2.0)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(style.ANIMATED)
        painter.drawLine(QPointF(x, 5.0), QPointF(x, self.height()))
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(style.ANIMATED)
        corners = ((-5.0, 0.0), (5.0, 0.0), (5.0, 4.0), (0.0, 9.0), (-5.0, 4.0))
        painter.drawPolygon(QPolygonF([QPointF(x + dx, dy) for dx, dy in corners]))


def tick_step(length: float, pixels: float) -> float:
    """Return the step of labels: 1, 2 or 5 times a power of ten, `NEAREST_LABELS` apart.

    Args:
        length: Length of the range [time code].
        pixels: Width of the range [pixel].
    """
    least = max(length / max(pixels / NEAREST_LABELS, 1.0), 1.0)
    power = 10.0 ** math.floor(math.log10(least))
    return next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= least - 1e-9)
