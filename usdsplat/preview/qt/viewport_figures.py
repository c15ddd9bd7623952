"""Paint figures of the stage over a picture: lights at their places, and edges of meshes.

Lengths are in viewport pixels; `ratio` is viewport pixels per window pixel.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

from PySide6.QtCore import QLineF, QPointF, Qt
from PySide6.QtGui import QColor, QPainter, QPen

from usdsplat.core.cloud import F64
from usdsplat.preview.overlays import LightMark, MeshEdges
from usdsplat.preview.projection import Pixel, Projection

LAMP = QColor(236, 206, 120)
CHOSEN = QColor(255, 255, 255)
SEAM = QColor(0, 0, 0, 150)
EDGE = QColor(150, 190, 220, 170)
LAMP_RADIUS = 5.0
"""Radius of the icon of a light [pixel of the window]."""
LAMP_REACH = 11.0
"""Maximum distance from the icon for a hit."""
LENGTH = 42.0
"""Length on the screen of what has none of its own, such as a direction."""
RAYS = 8


def light_at(
    lights: Iterable[LightMark], pixel: Pixel, projection: Projection, *, ratio: float
) -> str:
    """Return the path of the nearest light whose icon is under a pixel; "" for none."""
    found = [
        (math.dist(place, pixel), mark.path)
        for mark, place in _placed(lights, projection)
        if math.dist(place, pixel) <= LAMP_REACH * ratio
    ]
    return min(found)[1] if found else ""


def paint_lights(
    painter: QPainter,
    lights: Sequence[LightMark],
    projection: Projection,
    *,
    ratio: float,
    chosen: tuple[str, ...],
    hot: str,
) -> None:
    """Paint an icon for each light, and the lines of its shape."""
    painter.setBrush(Qt.BrushStyle.NoBrush)
    for mark, place in _placed(lights, projection):
        color = CHOSEN if mark.path in chosen else LAMP
        wide = 1.5 if mark.path == hot else 1.0
        length = LENGTH * ratio * projection.unit(mark.place)
        for tint, width in ((SEAM, 3.0), (color, 1.2 * wide)):
            painter.setPen(QPen(tint, width * ratio))
            for line in mark.figure(length):
                _paint_line(painter, line, projection)
        _paint_lamp(painter, QPointF(*place), color, ratio * wide)


def paint_edges(
    painter: QPainter, edges: Sequence[MeshEdges], projection: Projection, *, ratio: float
) -> None:
    """Paint the edges of meshes; those that reach behind the camera are left out."""
    painter.setPen(QPen(EDGE, ratio))
    for each in edges:
        points = each.segments.reshape(-1, 3) @ each.to_world[:3, :3].T + each.to_world[:3, 3]
        is_ahead = (projection.depths(points) > projection.near).reshape(-1, 2).all(axis=1)
        pixels = projection.pixels(points).reshape(-1, 4)[is_ahead]
        painter.drawLines([QLineF(*line) for line in pixels.tolist()])


def _placed(
    lights: Iterable[LightMark], projection: Projection
) -> Iterable[tuple[LightMark, Pixel]]:
    """Yield the lights in front of the camera, with their places in the viewport."""
    for mark in lights:
        if projection.depths(mark.place)[0] > projection.near:
            x, y = projection.pixels(mark.place)[0].tolist()
            yield mark, (x, y)


def _paint_line(painter: QPainter, line: F64, projection: Projection) -> None:
    for start, end in pairwise(line):
        seen = projection.line(start, end)
        if seen is not None:
            painter.drawLine(QPointF(*seen[0]), QPointF(*seen[1]))


def _paint_lamp(painter: QPainter, place: QPointF, color: QColor, ratio: float) -> None:
    """Paint a small sun."""
    radius = LAMP_RADIUS * ratio
    ways = [QPointF(math.cos(angle), math.sin(angle)) for angle in _angles()]
    for tint, width in ((SEAM, 3.2), (color, 1.4)):
        painter.setPen(QPen(tint, width * ratio))
        for way in ways:
            painter.drawLine(place + way * (1.5 * radius), place + way * (2.1 * radius))
    painter.setPen(QPen(SEAM, ratio))
    painter.setBrush(color)
    painter.drawEllipse(place, radius, radius)
    painter.setBrush(Qt.BrushStyle.NoBrush)


def _angles() -> list[float]:
    return [2.0 * math.pi * number / RAYS for number in range(RAYS)]
