"""Report page as a PNG, drawn by matplotlib."""

from __future__ import annotations

import io
import warnings
from typing import TYPE_CHECKING, Any

from usdsplat.products.report.plots import draw_histogram
from usdsplat.products.report.values import Picture, Report
from usdsplat.products.report.views import SIDE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DPI = 100
_GAP = 24
_WIDTH = 3 * SIDE + 4 * _GAP
_CHART = (_WIDTH - 4 * _GAP) // 4, 170
"""[pixel] from one chart to the next, and the height of its bars."""
_TICKS = 48
"""[pixel] for the counts beside a chart."""
_PAPER, _INK = "#fafaf8", "#1e2024"
_TITLE, _TEXT = 26, 15
_LINE = 21
_LONGEST = 150
"""Maximum number of characters of a line."""


def encode(report: Report) -> bytes:
    """Draw the page and return it as PNG."""
    from matplotlib.figure import Figure

    pictures = SIDE + _LINE + _GAP if report.pictures else 0
    charts = _CHART[1] + 4 * _LINE + _GAP if report.histograms else 0
    top = _GAP + _TITLE + _GAP
    height = top + pictures + charts + _LINE * len(report.lines) + _GAP
    figure = Figure(figsize=(_WIDTH / _DPI, height / _DPI), dpi=_DPI, facecolor=_PAPER)
    _write(figure, (_GAP, _GAP), _cut(report.title), size=_TITLE)
    for i, picture in enumerate(report.pictures):
        _draw_picture(figure, picture, (_GAP + i * (SIDE + _GAP), top))
    foot = top + pictures + _LINE + _CHART[1]
    for i, histogram in enumerate(report.histograms):
        left = _GAP + _TICKS + i * _CHART[0]
        size = (_CHART[0] - _TICKS - _GAP) / _WIDTH, _CHART[1] / height
        axes = figure.add_axes((left / _WIDTH, 1 - foot / height, *size))
        draw_histogram(axes, histogram, ink=_INK)
    for i, line in enumerate(report.lines):
        _write(figure, (_GAP, top + pictures + charts + _LINE * i), _cut(line), family="monospace")
    with warnings.catch_warnings():  # a file's name may have characters that the font lacks
        warnings.filterwarnings("ignore", "Glyph", UserWarning)
        data = io.BytesIO()
        figure.savefig(data, format="png")
    return data.getvalue()


def _draw_picture(figure: Figure, picture: Picture, at: tuple[int, int]) -> None:
    """Place a picture, pixel for pixel, with a scale bar in it and its title below."""
    from matplotlib.lines import Line2D

    height = round(figure.bbox.height)
    x, y = at[0], height - at[1] - SIDE
    figure.figimage(picture.pixels, x, y, origin="upper")
    bar = [x + 14, x + 14 + picture.bar * SIDE]
    line = Line2D(bar, [y + 16] * 2, color=_PAPER, linewidth=1.5, marker="|", transform=None)
    figure.add_artist(line)
    _write(figure, (x + 14, at[1] + SIDE - 42), picture.bar_text, color=_PAPER)
    _write(figure, (x, at[1] + SIDE + 4), picture.title)


def _cut(text: str) -> str:
    """Shorten a text to what fits on a line."""
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."


def _write(
    figure: Figure, at: tuple[int, int], text: str, *, size: int = _TEXT, **style: Any
) -> None:
    """Write text, with its top left corner `at` [pixel] of the page."""
    x, y = at[0] / figure.bbox.width, 1 - at[1] / figure.bbox.height
    points = size * 72 / _DPI
    figure.text(x, y, text, fontsize=points, va="top", parse_math=False, **{"color": _INK, **style})
