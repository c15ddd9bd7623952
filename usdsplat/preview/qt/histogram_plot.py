"""Plot a histogram: one curve per channel, blended additively."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPolygonF
from PySide6.QtWidgets import QSizePolicy, QWidget

from usdsplat.preview.qt import style

COLORS = {
    "R": QColor(214, 74, 66, 190),
    "G": QColor(86, 186, 90, 190),
    "B": QColor(84, 130, 224, 190),
}
OTHER = QColor(190, 190, 190, 190)
MARGIN = 6


class HistogramPlot(QWidget):
    """A plot of counts by value; the highest bars may be clipped, so that others are visible."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._curves: list[tuple[str, list[float]]] = []
        self._ends = ("", "")
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)

    def sizeHint(self) -> QSize:
        return QSize(300, 130)

    def show_counts(
        self, curves: Sequence[tuple[str, Sequence[int]]], *, lowest: str, highest: str
    ) -> None:
        """Show counts.

        Args:
            curves: Channel and counts by value, from the lowest.
            lowest, highest: Labels of the ends of the axis.
        """
        top = _top([count for _, counts in curves for count in counts])
        self._curves = [
            (name, [min(count / top, 1.0) for count in counts]) for name, counts in curves
        ]
        self._ends = (lowest, highest)
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.fillRect(self.rect(), style.SUNK)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setFont(style.digits())
        text = painter.fontMetrics().height()
        area = QRectF(self.rect()).adjusted(MARGIN, MARGIN, -MARGIN, -text - 3)
        painter.setPen(style.RAISED)
        for quarter in range(5):
            x = area.left() + quarter / 4 * area.width()
            painter.drawLine(QPointF(x, area.top()), QPointF(x, area.bottom()))
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setCompositionMode(QPainter.CompositionMode.CompositionMode_Plus)
        for name, heights in self._curves:
            painter.setBrush(COLORS.get(name[-1:], OTHER))
            painter.drawPolygon(_outline(heights, area))
        painter.setCompositionMode(QPainter.CompositionMode.CompositionMode_SourceOver)
        painter.setPen(style.QUIET)
        foot = QRectF(area.left(), area.bottom() + 1, area.width(), text + 2)
        painter.drawText(foot, Qt.AlignmentFlag.AlignLeft, self._ends[0])
        painter.drawText(foot, Qt.AlignmentFlag.AlignRight, self._ends[1])


def _outline(heights: Sequence[float], area: QRectF) -> QPolygonF:
    """Return the area under a curve of bars."""
    step = area.width() / max(len(heights), 1)
    points = [QPointF(area.left(), area.bottom())]
    for number, height in enumerate(heights):
        y = area.bottom() - height * area.height()
        points.append(QPointF(area.left() + number * step, y))
        points.append(QPointF(area.left() + (number + 1) * step, y))
    points.append(QPointF(area.right(), area.bottom()))
    return QPolygonF(points)


def _top(counts: Sequence[int]) -> float:
    """Return the count at the upper edge: above 99 % of the bars, because one bar of a plain
    background would flatten all others."""
    filled = sorted(count for count in counts if count)
    return 1.1 * filled[int(0.99 * (len(filled) - 1))] if filled else 1.0
