"""Paint overlays: boxes of the selection, handles, the wipe and the axes.

All lines have a dark outline, so that they are visible on any picture. Colours are few and muted,
so that they do not affect the judgement of a picture's. Lengths are in viewport pixels; `ratio` is
viewport pixels per window pixel.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QFont, QPainter, QPen, QPolygonF

from usdsplat.core.cloud import F64
from usdsplat.preview.boxes import Corners
from usdsplat.preview.manipulator import Handle, Manipulator, Shape
from usdsplat.preview.projection import Projection

SEAM = QColor(0, 0, 0, 130)
LINE = QColor(226, 226, 226)
HOT = QColor(228, 190, 96)
COLORS: dict[str, QColor] = {
    "x": QColor(204, 92, 84),
    "y": QColor(116, 170, 92),
    "z": QColor(92, 136, 204),
    "view": LINE,
}
COLORS |= {plane: COLORS[axis] for plane, axis in (("yz", "x"), ("zx", "y"), ("xy", "z"))}

WIDTH = 1.6
HEAD = 11.0
"""Length of an arrow's head."""
CUBE = 4.5
"""Half the size of the box at the end of a scaling axis."""
CORNER = 0.16
"""Fraction of a box edge that is bright, at each end."""
TRIPOD = 26.0
WIPE_GRIP = 14.0
_AWAY = 0.28
"""Opacity of handles that cannot be dragged, or are on the far side."""


def paint_boxes(
    painter: QPainter, boxes: Iterable[Corners], projection: Projection, *, ratio: float
) -> None:
    """Paint the edges of boxes, bright at their corners."""
    lines = []
    for corners in boxes:
        points = np.asarray(corners)
        for i in range(8):
            lines += [(points[i], points[i | bit]) for bit in (1, 2, 4) if not i & bit]
    faint = QColor(LINE)
    faint.setAlphaF(0.3)
    ends = [
        (start, start + CORNER * (end - start))
        for pair in lines
        for start, end in (pair, pair[::-1])
    ]
    shade = QColor(0, 0, 0, 60)
    for pieces, color, width in (
        (lines, shade, 2.6),
        (lines, faint, 1.0),
        (ends, SEAM, 3.0),
        (ends, LINE, 1.3),
    ):
        painter.setPen(_pen(color, width * ratio))
        for start, end in pieces:
            seen = projection.line(start, end)
            if seen is not None:
                painter.drawLine(QPointF(*seen[0]), QPointF(*seen[1]))


def paint_manipulator(
    painter: QPainter, manipulator: Manipulator, projection: Projection, *, hot: Handle | None
) -> None:
    """Paint handles, with the one under the pointer highlighted."""
    for shape in manipulator.shapes(projection):
        _paint_shape(painter, shape, manipulator.ratio, is_hot=shape.handle == hot)
    painter.setOpacity(1.0)


def paint_box(painter: QPainter, box: tuple[float, float, float, float], *, ratio: float) -> None:
    """Paint the box of a selection in progress."""
    left, top, right, bottom = box
    fill = QColor(LINE)
    fill.setAlphaF(0.1)
    place = QRectF(left, top, right - left, bottom - top)
    painter.fillRect(place, fill)
    painter.setBrush(Qt.BrushStyle.NoBrush)
    for tint, width, style in (
        (SEAM, 2.4, Qt.PenStyle.SolidLine),
        (LINE, 1.0, Qt.PenStyle.DashLine),
    ):
        pen = _pen(tint, width * ratio)
        pen.setStyle(style)
        painter.setPen(pen)
        painter.drawRect(place)


def paint_wipe(
    painter: QPainter, x: float, height: float, middle: QPointF, *, ratio: float, is_hot: bool
) -> None:
    """Paint the wipe of a comparison, and its handle around `middle`."""
    radius = WIPE_GRIP * ratio * (1.2 if is_hot else 1.0)
    color = HOT if is_hot else LINE
    for tint, width in ((SEAM, 4.0), (color, 2.0 if is_hot else 1.4)):
        painter.setPen(_pen(tint, width * ratio))
        painter.drawLine(QPointF(x, 0.0), QPointF(x, height))
    painter.setPen(_pen(color, 1.2 * ratio))
    painter.setBrush(QColor(24, 24, 24, 220))
    painter.drawEllipse(middle, radius, radius)
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(color)
    for side in (-1.0, 1.0):
        tip = middle + QPointF(0.62 * side * radius, 0.0)
        base = middle + QPointF(0.18 * side * radius, 0.0)
        up = QPointF(0.0, 0.34 * radius)
        painter.drawPolygon(QPolygonF([tip, base + up, base - up]))


def paint_tripod(
    painter: QPainter, projection: Projection, middle: QPointF, *, ratio: float
) -> None:
    """Paint the world's axes in the camera's orientation, nearest last."""
    right, up, back = projection.axes
    font = QFont(painter.font())
    font.setPixelSize(round(10 * ratio))
    font.setBold(True)
    painter.setFont(font)
    for i in np.argsort(back):
        way = QPointF(right[i], -up[i]) * TRIPOD * ratio
        color = QColor(COLORS["xyz"[i]])
        color.setAlphaF(0.55 + 0.45 * (0.5 + 0.5 * float(back[i])))
        for tint, width in ((SEAM, 4.0), (color, 2.0)):
            painter.setPen(_pen(tint, width * ratio))
            painter.drawLine(middle, middle + way)
        place = middle + way * 1.32
        box = QRectF(place.x() - 9 * ratio, place.y() - 9 * ratio, 18 * ratio, 18 * ratio)
        painter.setPen(SEAM)
        painter.drawText(box.translated(ratio, ratio), Qt.AlignmentFlag.AlignCenter, "XYZ"[i])
        painter.setPen(color)
        painter.drawText(box, Qt.AlignmentFlag.AlignCenter, "XYZ"[i])


# --- private ---------------------------------------------------------------------------------


def _paint_shape(painter: QPainter, shape: Shape, ratio: float, *, is_hot: bool) -> None:
    color = HOT if is_hot else COLORS[shape.handle]
    painter.setOpacity(1.0 if shape.can_be_hit else _AWAY)
    width = WIDTH * ratio * (1.35 if is_hot else 1.0)
    if shape.kind == "ring":
        _paint_ring(painter, shape, color, width)
        return
    if shape.kind in ("plane", "center"):
        fill = QColor(color)
        fill.setAlphaF(0.55 if is_hot else 0.28 if shape.kind == "plane" else 0.12)
        outline = QPolygonF([QPointF(x, y) for x, y in shape.points])
        for tint, wide in ((SEAM, width + 1.6 * ratio), (color, 0.75 * width)):
            painter.setPen(_pen(tint, wide))
            painter.setBrush(fill if tint is color else Qt.BrushStyle.NoBrush)
            painter.drawPolygon(outline)
        return
    start, end = (QPointF(x, y) for x, y in shape.points)
    for tint, wide in ((SEAM, width + 2.0 * ratio), (color, width)):
        painter.setPen(_pen(tint, wide))
        painter.drawLine(start, end)
    way = end - start
    long = max((way.x() ** 2 + way.y() ** 2) ** 0.5, 1e-6)
    way = way / long
    painter.setPen(_pen(SEAM, ratio))
    painter.setBrush(color)
    if shape.kind == "arrow":
        side = QPointF(-way.y(), way.x()) * 0.36 * HEAD * ratio
        base = end - way * 0.5 * HEAD * ratio
        painter.drawPolygon(QPolygonF([end + way * 0.5 * HEAD * ratio, base + side, base - side]))
    else:
        half = CUBE * ratio
        painter.drawRect(QRectF(end.x() - half, end.y() - half, 2 * half, 2 * half))


def _paint_ring(painter: QPainter, shape: Shape, color: QColor, width: float) -> None:
    """Paint the far side dim, then the near one."""
    faint = QColor(color)
    faint.setAlphaF(_AWAY)
    for tint, wide, is_front in (
        (faint, 0.7 * width, False),
        (SEAM, 2.2 * width, True),
        (color, width, True),
    ):
        painter.setPen(_pen(tint, wide))
        for run in _runs(shape.points, shape.front == is_front):
            painter.drawPolyline(QPolygonF([QPointF(x, y) for x, y in run]))


def _runs(points: F64, chosen: F64) -> list[F64]:
    """Return the runs of consecutive chosen points of a line."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    return [points[first:end] for first, end in edges.reshape(-1, 2) if end - first > 1]


def _pen(color: QColor, width: float) -> QPen:
    pen = QPen(color, width)
    pen.setCapStyle(Qt.PenCapStyle.RoundCap)
    pen.setJoinStyle(Qt.PenJoinStyle.RoundJoin)
    return pen
