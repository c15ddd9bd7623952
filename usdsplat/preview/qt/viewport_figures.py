"""Paint figures of the stage over a picture: lights at their places, edges, and affectors.

Lengths are in viewport pixels; `ratio` is viewport pixels per window pixel.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from PySide6.QtCore import QLineF, QPointF, Qt
from PySide6.QtGui import QColor, QPainter, QPen

from usdsplat.core.cloud import F64
from usdsplat.preview.overlays import LightMark, MeshEdges, Overlays
from usdsplat.preview.placement import Placement
from usdsplat.preview.projection import Pixel, Projection
from usdsplat.preview.values import Picture

LAMP = QColor(236, 206, 120)
CHOSEN = QColor(255, 255, 255)
SEAM = QColor(0, 0, 0, 150)
EDGE = QColor(150, 190, 220, 170)
ACTING = QColor(112, 214, 196)
LAMP_RADIUS = 5.0
"""Radius of the icon of a light [pixel of the window]."""
LAMP_REACH = 11.0
"""Maximum distance from the icon for a hit."""
LINE_REACH = 5.0
"""Distance from a line of an outline up to which it is hit."""
APART = 2.0
"""Distance up to which icons are at one place."""
LENGTH = 42.0
"""Length on the screen of what has none of its own, such as a direction."""
RAYS = 8


def placed(lights: Sequence[LightMark], placement: Placement | None) -> tuple[LightMark, ...]:
    """Return the lights of a picture with the selected one at its place, which may be a new one."""
    return tuple(
        replace(mark, matrix=placement.matrix)
        if placement is not None and placement.path == mark.path
        else mark
        for mark in lights
    )


def lights_at(
    lights: Iterable[LightMark], pixel: Pixel, projection: Projection, *, ratio: float
) -> tuple[str, ...]:
    """Return the paths of the nearest light whose icon is under a pixel, and of those at its place,
    sorted.

    A dome or a distant light that was never moved is no target: its icon is at the origin, where it
    would take the clicks on what is there.
    """
    found = [
        (math.dist(place, pixel), mark.path, place)
        for mark, place in _placed(lights, projection)
        if mark.has_place and math.dist(place, pixel) <= LAMP_REACH * ratio
    ]
    if not found:
        return ()
    nearest = min(found)[2]
    return tuple(
        sorted(path for _, path, place in found if math.dist(place, nearest) <= APART * ratio)
    )


def lights_in(
    lights: Iterable[LightMark],
    box: tuple[float, float, float, float],
    projection: Projection,
) -> tuple[str, ...]:
    """Return the sorted paths of the lights whose icons are in a box: left, top, right, bottom.

    Those that `lights_at` never returns are left out.
    """
    left, top, right, bottom = box
    return tuple(
        sorted(
            mark.path
            for mark, (x, y) in _placed(lights, projection)
            if mark.has_place and left <= x <= right and top <= y <= bottom
        )
    )


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


class EdgeLines:
    """Edges as lines of a viewport, made once for a picture and a size.

    Args:
        edges: Returns the edges among the overlays of a picture.
    """

    def __init__(self, edges: Callable[[Overlays], Sequence[MeshEdges]]) -> None:
        self._edges = edges
        self._of: tuple[Picture, tuple[int, int]] | None = None
        self._lines: list[QLineF] = []

    def of(
        self, picture: Picture, size: tuple[int, int], projection: Projection
    ) -> Sequence[QLineF]:
        """Return the lines; edges that reach behind the camera are cut at its near plane.

        Args:
            picture: The displayed picture.
            size: Width and height of the viewport [pixel].
            projection: Of that picture and size.
        """
        if self._of is None or self._of[0] is not picture or self._of[1] != size:
            self._of = picture, size
            self._lines = [
                line
                for each in self._edges(picture.overlays)
                for line in _lines_of(each, projection)
            ]
        return self._lines


def paint_edges(painter: QPainter, lines: Sequence[QLineF], *, ratio: float) -> None:
    """Paint the edges of meshes."""
    painter.setPen(QPen(EDGE, ratio))
    painter.drawLines(lines)


def paint_affectors(painter: QPainter, lines: Sequence[QLineF], *, ratio: float) -> None:
    """Paint the outlines of what acts on simulations, visible on light and dark splats."""
    for color, width in ((SEAM, 2.6), (ACTING, 1.1)):
        painter.setPen(QPen(color, width * ratio))
        painter.drawLines(lines)


def outline_at(
    outlines: Iterable[MeshEdges], pixel: Pixel, projection: Projection, *, ratio: float
) -> str:
    """Return the path of the outline whose lines are nearest to a pixel; "" if none is near."""
    nearest, found = LINE_REACH * ratio, ""
    for each in outlines:
        lines = _ends_of(each, projection)
        ways = lines[:, 2:] - lines[:, :2]
        squares = np.maximum(np.sum(ways * ways, axis=1), 1e-30)
        parts = np.clip(np.sum((pixel - lines[:, :2]) * ways, axis=1) / squares, 0.0, 1.0)
        away = np.hypot(*(lines[:, :2] + parts[:, None] * ways - pixel).T)
        if away.min(initial=np.inf) < nearest:
            nearest, found = float(away.min()), each.path
    return found


def _lines_of(edges: MeshEdges, projection: Projection) -> Iterator[QLineF]:
    return (QLineF(*line) for line in _ends_of(edges, projection).tolist())


def _ends_of(edges: MeshEdges, projection: Projection) -> F64:
    """Return the edges in front of the camera as lines of the viewport, shape (n, 4)."""
    points = edges.segments.reshape(-1, 3) @ edges.to_world[:3, :3].T + edges.to_world[:3, 3]
    ahead = (projection.depths(points) - projection.near).reshape(-1, 2)
    is_seen = (ahead > 0).any(axis=1)
    ends, ahead = points.reshape(-1, 2, 3)[is_seen], ahead[is_seen]
    for one, other in ((0, 1), (1, 0)):
        is_cut = ahead[:, one] < 0
        part = ahead[is_cut, one] / (ahead[is_cut, one] - ahead[is_cut, other])
        ends[is_cut, one] += part[:, None] * (ends[is_cut, other] - ends[is_cut, one])
    return projection.pixels(ends.reshape(-1, 3)).reshape(-1, 4)


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
