"""The heads-up display: rows of numbers on a dark pane."""

from __future__ import annotations

from dataclasses import fields

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QFontMetricsF, QPainter
from PySide6.QtWidgets import QApplication

from usdsplat.preview.qt import style
from usdsplat.preview.values import Look, Picture, ViewState

PANE = QColor(16, 16, 16, 205)
RADIUS = 5.0
MARGIN = 10.0
"""Margin from the viewport's edges [pixel of the window]."""
PAD = 8.0
GAP = 6.0
"""Distance of two badges."""
STEPS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("prepare", ("sync", "lay out", "surfaces", "nodes")),
    ("light", ("light splats",)),
    ("project", ("project", "shade", "find ray hits", "find features")),
    ("sort", ("sort", "bin")),
    ("display", ("display", "fetch")),
)
"""Steps of a picture, and the stages of the renderer that they contain; others are of "blend"."""
WIDEST = ("  prepare", "00\u2009000\u2009000 MB")
"""Label and value that the pane has room for: its width stays as numbers change."""
MOST_SETTINGS = 2
"""Number of settings that the name of a compared look says at most."""

Row = tuple[str, str]


def rows_of(picture: Picture, *, rate: float | None) -> list[Row]:
    """Return labels and values, in display order; those of every picture have the same lines."""
    times = dict(picture.milliseconds)
    total = times.pop("total", sum(times.values()))
    steps = {name: sum(times.pop(each, 0.0) for each in stages) for name, stages in STEPS}
    steps["blend"] = sum(times.values())
    quality = "full" if picture.is_final else f"1 : {picture.scale:g}"
    if picture.lacks_light and picture.scale == 1.0:
        quality = "last light"
    state = picture.state
    width, height = state.size
    warnings = len(picture.warnings)
    return [
        ("fps", "–" if rate is None else f"{rate:.0f}"),
        ("draw", f"{total:.1f} ms"),
        *(("  " + name, f"{spent:.1f}") for name, spent in steps.items()),
        ("quality", quality),
        ("size", f"{width} × {height}"),
        ("splats", _grouped(picture.splats)),
        ("  of", _grouped(picture.total)),
        ("frame", "default" if state.time is None else f"{state.time:g}"),
        ("memory", f"{_grouped(round(picture.megabytes))} MB" if picture.megabytes else "–"),
        ("device", picture.device),
        *([("warnings", str(warnings))] if warnings else []),
        *([("reading", f"{_grouped(picture.missing)} nodes")] if picture.missing else []),
    ]


def camera_name(state: ViewState) -> str:
    """Return the name of the camera."""
    if isinstance(state.camera, str):
        return state.camera
    return "Frames all" if state.camera is None else "Free camera"


def look_names(state: ViewState) -> tuple[str, str]:
    """Return names of the looks left and right of the wipe; "" on the right for no comparison."""
    if state.other is None:
        return _look_name(state.look, ()), ""
    ours, theirs = state.look.settings, state.other.settings
    names = [each.name for each in fields(ours)]
    others = tuple(name for name in names if getattr(ours, name) != getattr(theirs, name))
    others = others[:MOST_SETTINGS]
    return f"A · {_look_name(state.look, others)}", f"B · {_look_name(state.other, others)}"


def _look_name(look: Look, settings: tuple[str, ...]) -> str:
    """Return the name of a look, with its time and some of its settings."""
    parts = [look.aov, *([] if look.time is None else [f"frame {look.time:g}"])]
    for name in settings:
        value = getattr(look.settings, name)
        if isinstance(value, bool):
            value = "on" if value else "off"
        parts.append(value if name == "lighting" else f"{name.replace('_', ' ')} {value}")
    return " · ".join(parts)


def paint_rows(painter: QPainter, rows: list[Row], corner: QPointF) -> QRectF:
    """Paint a pane of rows with its top left at a corner; return its rectangle."""
    font = style.digits()
    painter.setFont(font)
    metrics = QFontMetricsF(font)
    rows_and_room = (*rows, WIDEST)
    labels = max(metrics.horizontalAdvance(label) for label, _ in rows_and_room)
    values = max(metrics.horizontalAdvance(value) for _, value in rows_and_room)
    step = metrics.height() + 1.0
    size = (2 * PAD + labels + 2 * PAD + values, 2 * PAD + step * len(rows) - 3.0)
    pane = QRectF(corner.x(), corner.y(), *size)
    _paint_pane(painter, pane)
    for i, (label, value) in enumerate(rows):
        line = QRectF(pane.left() + PAD, pane.top() + PAD - 1.0 + i * step, size[0] - 2 * PAD, step)
        is_part = label.startswith(" ")
        painter.setPen(style.QUIET.darker(112) if is_part else style.QUIET)
        painter.drawText(line, Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter, label)
        painter.setPen(style.QUIET if is_part else style.TEXT)
        painter.drawText(line, Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter, value)
    return pane


def paint_tag(
    painter: QPainter,
    text: str,
    anchor: QPointF,
    *,
    right: bool = False,
    color: QColor = style.TEXT,
) -> QRectF:
    """Paint text on a pane, with its lower left or right at a point; return its rectangle."""
    font = QApplication.font()
    font.setPointSizeF(8.5)
    painter.setFont(font)
    metrics = QFontMetricsF(font)
    width, height = metrics.horizontalAdvance(text) + 2 * PAD, metrics.height() + 6.0
    left = anchor.x() - width if right else anchor.x()
    pane = QRectF(left, anchor.y() - height, width, height)
    _paint_pane(painter, pane)
    painter.setPen(color)
    painter.drawText(pane, Qt.AlignmentFlag.AlignCenter, text)
    return pane


def paint_badge(painter: QPainter, text: str, top: QPointF) -> QRectF:
    """Paint text on a pane with its top at the middle of a point, as wide as it is with larger
    numbers; return its rectangle."""
    font = style.digits()
    font.setPointSizeF(10.0)
    painter.setFont(font)
    metrics = QFontMetricsF(font)
    width = metrics.horizontalAdvance("Lighting… 000/000") + 2 * PAD
    width = max(width, metrics.horizontalAdvance(text) + 2 * PAD)
    pane = QRectF(top.x() - 0.5 * width, top.y(), width, metrics.height() + PAD)
    _paint_pane(painter, pane)
    painter.setPen(style.ANIMATED)
    painter.drawText(pane, Qt.AlignmentFlag.AlignCenter, text)
    return pane


def paint_label(painter: QPainter, text: str, top: QPointF, place: QRectF) -> QRectF:
    """Paint text on a pane with its top at the middle of a point, moved into a place if it would
    lie outside of it; return its rectangle."""
    font = style.digits()
    font.setPointSizeF(10.0)
    painter.setFont(font)
    metrics = QFontMetricsF(font)
    width, height = metrics.horizontalAdvance(text) + 2 * PAD, metrics.height() + PAD
    inner = place.adjusted(MARGIN, MARGIN, -MARGIN - width, -MARGIN - height)
    left = min(max(top.x() - 0.5 * width, inner.left()), max(inner.right(), inner.left()))
    pane = QRectF(left, min(max(top.y(), inner.top()), inner.bottom()), width, height)
    _paint_pane(painter, pane)
    painter.setPen(style.TEXT)
    painter.drawText(pane, Qt.AlignmentFlag.AlignCenter, text)
    return pane


def _grouped(number: int) -> str:
    """Format a number with thin spaces between thousands."""
    return f"{number:,}".replace(",", "\u2009")


def _paint_pane(painter: QPainter, pane: QRectF) -> None:
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(PANE)
    painter.drawRoundedRect(pane, RADIUS, RADIUS)
