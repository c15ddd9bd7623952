"""Vector icons, drawn by code, without files to install."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QIcon, QPainter, QPainterPath, QPen, QPixmap, QRadialGradient

from usdsplat.preview.qt import style

UNITS = 16.0
"""Size of the square that glyphs are drawn on."""


@cache
def glyph(name: str, color: str = "") -> QIcon:
    """Return the icon with a name from `_DRAWN`.

    Args:
        color: Colour, such as "#d69e48"; "" is the text colour.
    """
    icon = QIcon()
    for tint, mode in (
        (QColor(color) if color else style.TEXT, QIcon.Mode.Normal),
        (style.OFF, QIcon.Mode.Disabled),
        (QColor("white"), QIcon.Mode.Selected),  # else Qt mixes in the colour of the selection
    ):
        for size in (16, 32):
            icon.addPixmap(_drawn(_DRAWN[name], size, tint), mode)
    return icon


@cache
def window_icon() -> QIcon:
    """Return the window icon: a few splats on black."""
    icon = QIcon()
    for size in (16, 32, 64, 128, 256):
        icon.addPixmap(_drawn(_splats, size, QColor("white")))
    return icon


def _drawn(draw: Callable[[QPainter], None], size: int, color: QColor) -> QPixmap:
    pixmap = QPixmap(size, size)
    pixmap.fill(Qt.GlobalColor.transparent)
    painter = QPainter(pixmap)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.scale(size / UNITS, size / UNITS)
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(color)
    draw(painter)
    painter.end()
    return pixmap


def _triangle(painter: QPainter, left: float, right: float) -> None:
    """Draw a triangle that points from `left` to `right`."""
    path = QPainterPath(QPointF(left, 3.0))
    path.lineTo(right, 8.0)
    path.lineTo(left, 13.0)
    path.closeSubpath()
    painter.drawPath(path)


def _bar(painter: QPainter, x: float, width: float = 2.0) -> None:
    painter.drawRect(QRectF(x, 3.0, width, 10.0))


def _play(painter: QPainter) -> None:
    _triangle(painter, 4.0, 13.0)


def _pause(painter: QPainter) -> None:
    _bar(painter, 4.0, 3.0)
    _bar(painter, 9.0, 3.0)


def _step_back(painter: QPainter) -> None:
    _triangle(painter, 9.5, 2.5)
    _bar(painter, 11.0)


def _step_on(painter: QPainter) -> None:
    _bar(painter, 3.0)
    _triangle(painter, 6.5, 13.5)


def _to_start(painter: QPainter) -> None:
    _bar(painter, 3.0)
    _triangle(painter, 13.0, 6.0)


def _to_end(painter: QPainter) -> None:
    _triangle(painter, 3.0, 10.0)
    _bar(painter, 11.0)


def _stop(painter: QPainter) -> None:
    painter.drawRect(QRectF(4.0, 4.0, 8.0, 8.0))


def _record(painter: QPainter) -> None:
    painter.drawEllipse(QPointF(8.0, 8.0), 5.0, 5.0)


def _stroke(painter: QPainter, width: float = 1.6) -> None:
    """Switch the painter to lines."""
    pen = QPen(painter.brush().color(), width)
    pen.setCapStyle(Qt.PenCapStyle.RoundCap)
    pen.setJoinStyle(Qt.PenJoinStyle.RoundJoin)
    painter.setPen(pen)
    painter.setBrush(Qt.BrushStyle.NoBrush)


def _arrow_head(painter: QPainter, tip: QPointF, angle: float, size: float = 3.2) -> None:
    for side in (-0.6, 0.6):
        direction = angle + math.pi + side
        painter.drawLine(tip, tip + QPointF(math.cos(direction), math.sin(direction)) * size)


def _reset(painter: QPainter) -> None:
    _stroke(painter)
    painter.drawArc(QRectF(3.5, 3.5, 9.0, 9.0), 140 * 16, 290 * 16)
    _arrow_head(painter, QPointF(4.3, 5.2), math.radians(235))


def _loop(painter: QPainter) -> None:
    _stroke(painter)
    path = QPainterPath(QPointF(11.0, 4.5))
    path.lineTo(5.5, 4.5)
    path.arcTo(QRectF(2.0, 4.5, 7.0, 7.0), 90, 180)
    path.moveTo(5.0, 11.5)
    path.lineTo(10.5, 11.5)
    path.arcTo(QRectF(7.0, 4.5, 7.0, 7.0), 270, 130)
    painter.drawPath(path)
    _arrow_head(painter, QPointF(12.0, 4.5), 0.0)


def _eye(painter: QPainter) -> None:
    color = painter.brush().color()
    _stroke(painter, 1.4)
    path = QPainterPath(QPointF(1.5, 8.0))
    path.quadTo(8.0, 1.5, 14.5, 8.0)
    path.quadTo(8.0, 14.5, 1.5, 8.0)
    painter.drawPath(path)
    painter.setBrush(color)
    painter.drawEllipse(QPointF(8.0, 8.0), 1.7, 1.7)


def _eye_shut(painter: QPainter) -> None:
    _stroke(painter, 1.4)
    path = QPainterPath(QPointF(1.5, 7.0))
    path.quadTo(8.0, 13.5, 14.5, 7.0)
    painter.drawPath(path)
    for x, y, dx in ((4.0, 9.4, -1.2), (8.0, 10.3, 0.0), (12.0, 9.4, 1.2)):
        painter.drawLine(QPointF(x, y), QPointF(x + dx, y + 2.6))


def _cross(painter: QPainter) -> None:
    _stroke(painter)
    painter.drawLine(QPointF(4.5, 4.5), QPointF(11.5, 11.5))
    painter.drawLine(QPointF(11.5, 4.5), QPointF(4.5, 11.5))


def _tick(painter: QPainter) -> None:
    _stroke(painter, 2.2)
    painter.drawPolyline([QPointF(4.0, 8.4), QPointF(7.0, 11.4), QPointF(12.2, 5.0)])


def _down(painter: QPainter) -> None:
    _stroke(painter)
    painter.drawPolyline([QPointF(4.5, 6.0), QPointF(8.0, 10.0), QPointF(11.5, 6.0)])


def _right(painter: QPainter) -> None:
    _stroke(painter)
    painter.drawPolyline([QPointF(6.0, 4.5), QPointF(10.0, 8.0), QPointF(6.0, 11.5)])


def _select(painter: QPainter) -> None:
    path = QPainterPath(QPointF(4.0, 2.0))
    for x, y in ((12.5, 9.0), (8.6, 9.6), (10.6, 13.6), (8.9, 14.4), (6.9, 10.4), (4.0, 13.0)):
        path.lineTo(x, y)
    path.closeSubpath()
    painter.drawPath(path)


def _move(painter: QPainter) -> None:
    _stroke(painter, 1.4)
    for angle in (0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi):
        tip = QPointF(8.0 + 6.0 * math.cos(angle), 8.0 + 6.0 * math.sin(angle))
        painter.drawLine(QPointF(8.0, 8.0), tip)
        _arrow_head(painter, tip, angle, 2.6)


def _turn(painter: QPainter) -> None:
    _stroke(painter, 1.4)
    painter.drawEllipse(QPointF(8.0, 8.0), 5.8, 5.8)
    painter.drawEllipse(QPointF(8.0, 8.0), 2.2, 5.8)


def _scale(painter: QPainter) -> None:
    color = painter.brush().color()
    _stroke(painter, 1.4)
    painter.drawLine(QPointF(5.0, 11.0), QPointF(12.0, 4.0))
    painter.setBrush(color)
    painter.drawRect(QRectF(2.6, 9.6, 4.0, 4.0))
    painter.drawRect(QRectF(10.8, 2.6, 2.6, 2.6))


def _splats(painter: QPainter) -> None:
    painter.setBrush(QColor(22, 22, 22))
    painter.drawRoundedRect(QRectF(0.5, 0.5, 15.0, 15.0), 3.5, 3.5)
    for x, y, width, height, angle, color in (
        (5.6, 9.6, 4.6, 2.6, -35.0, "#4f8fd0"),
        (10.2, 9.8, 4.4, 2.3, 40.0, "#d8853a"),
        (8.2, 5.6, 2.6, 4.2, 12.0, "#e8e2d0"),
    ):
        painter.save()
        painter.translate(x, y)
        painter.rotate(angle)
        painter.scale(width, height)
        spread = QRadialGradient(QPointF(0.0, 0.0), 1.0)
        for stop in (0.0, 0.25, 0.5, 0.75, 1.0):
            tint = QColor(color)
            tint.setAlphaF(max(math.exp(-4.0 * stop * stop) - math.exp(-4.0), 0.0))
            spread.setColorAt(stop, tint)
        painter.setBrush(spread)
        painter.drawEllipse(QPointF(0.0, 0.0), 1.0, 1.0)
        painter.restore()


_DRAWN: dict[str, Callable[[QPainter], None]] = {
    "play": _play,
    "pause": _pause,
    "step back": _step_back,
    "step on": _step_on,
    "to start": _to_start,
    "to end": _to_end,
    "record": _record,
    "stop": _stop,
    "reset": _reset,
    "loop": _loop,
    "eye": _eye,
    "eye shut": _eye_shut,
    "cross": _cross,
    "tick": _tick,
    "down": _down,
    "right": _right,
    "none": _select,
    "translate": _move,
    "rotate": _turn,
    "scale": _scale,
}
