"""Write a page as PNG."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from usdsplat.products.report.values import Histogram, Picture, Report
from usdsplat.products.report.views import SIDE

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw

_GAP = 24
_WIDTH = 3 * SIDE + 4 * _GAP
_CHART = (_WIDTH - 5 * _GAP) // 4, 170
_PAPER, _INK, _FAINT = (250, 250, 248), (30, 32, 36), (140, 144, 150)
_BAR, _MARK = (70, 110, 170), (200, 80, 40)
_TITLE, _TEXT = 26, 15
_LINE = 21
_KEY = 190
"""Distance from a key to its value [pixel]."""
_LONGEST = 150
"""Maximum number of characters of a line."""


def write(report: Report, path: Path) -> None:
    """Draw the page and write it as PNG."""
    from PIL import Image, ImageDraw

    lines = [_cut(line) for line in report.lines]
    pictures = SIDE + _LINE + _GAP if report.pictures else 0
    charts = _CHART[1] + 3 * _LINE + _GAP if report.histograms else 0
    height = _GAP + _TITLE + _GAP + pictures + charts + _LINE * len(lines) + _GAP
    page = Image.new("RGB", (_WIDTH, height), _PAPER)
    draw = ImageDraw.Draw(page)
    y = _GAP
    _write(draw, (_GAP, y), _cut(report.title), size=_TITLE)
    y += _TITLE + _GAP
    for i, picture in enumerate(report.pictures):
        x = _GAP + i * (SIDE + _GAP)
        page.paste(Image.fromarray(picture.pixels), (x, y))
        _scale(draw, picture, (x, y))
        _write(draw, (x, y + SIDE + 4), picture.title)
    y += pictures
    for i, histogram in enumerate(report.histograms):
        _chart(draw, histogram, (_GAP + i * (_CHART[0] + _GAP), y))
    y += charts
    for line in lines:
        _line(draw, line, y)
        y += _LINE
    page.save(path, "PNG")


def _scale(draw: ImageDraw, picture: Picture, at: tuple[int, int]) -> None:
    """Draw the scale bar of a picture."""
    x, y = at[0] + 14, at[1] + SIDE - 16
    end = x + round(picture.bar * SIDE)
    draw.line([(x, y), (end, y)], fill=_PAPER, width=2)
    for tip in (x, end):
        draw.line([(tip, y - 4), (tip, y + 4)], fill=_PAPER, width=2)
    _write(draw, (x, y - 24), picture.bar_text, color=_PAPER)


def _chart(draw: ImageDraw, histogram: Histogram, at: tuple[int, int]) -> None:
    """Draw a histogram with title, ticks and median."""
    x, y = at
    width, height = _CHART
    _write(draw, (x, y), histogram.title)
    top, foot = y + _LINE + 4, y + _LINE + 4 + height
    most, bars = int(histogram.counts.max()), len(histogram.counts)
    for i, count in enumerate(histogram.counts.tolist()):
        left, right = x + width * i // bars, x + width * (i + 1) // bars - 2
        if count:
            draw.rectangle([left, foot - max(1, height * count // most), right, foot], fill=_BAR)
    draw.line([(x, foot), (x + width, foot)], fill=_INK)
    middle = x + round(width * min(max(histogram.place(histogram.median), 0), 1))
    draw.line([(middle, top), (middle, foot)], fill=_MARK)
    for place, text in histogram.ticks():
        tick = x + round(width * place)
        draw.line([(tick, foot), (tick, foot + 4)], fill=_INK)
        anchor = "lt" if place < 0.05 else "rt" if place > 0.95 else "mt"
        _write(draw, (tick, foot + 7), text, color=_FAINT, anchor=anchor)
    _write(draw, (x, foot + _LINE + 4), histogram.summary(), color=_MARK)


def _line(draw: ImageDraw, line: str, y: int) -> None:
    """Draw a key and its value with the indentation of the line."""
    text = line.lstrip()
    x = _GAP + 7 * (len(line) - len(text))
    key, gap, value = text.partition("  ")
    _write(draw, (x, y), key, color=_FAINT if gap else _INK)
    _write(draw, (_GAP + _KEY, y), value.strip())


def _cut(text: str) -> str:
    """Return a text shortened to fit on a line."""
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."


def _write(
    draw: ImageDraw,
    at: tuple[int, int],
    text: str,
    *,
    size: int = _TEXT,
    color: tuple[int, int, int] = _INK,
    anchor: str = "la",
) -> None:
    """Draw text in Pillow's default font."""
    from PIL import ImageFont

    draw.text(at, text, fill=color, font=ImageFont.load_default(size), anchor=anchor)
