"""Milliseconds of a picture over the splats of its scene, both logarithmic, as an SVG.

    python -m benchmarks.plot RESULTS.json... PICTURE.svg

On the left over the splats that are stored, on the right over those that are seen. Rows of a device
and a kind of scene are a line, whiskers reach from the fastest picture to the slowest. Only rows of
SIZE and without harmonics are drawn, and a scene alone only for who has no line.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from benchmarks.report import Row, read_results

SIZE = "1920x1080"
PANELS = {"splats": "over splats stored", "visible": "over splats seen"}
WIDTH, HEIGHT, LEFT, TOP, GAP = 370, 330, 58, 48, 66
OURS = {"cpu": "usdsplat, CPU", "cuda": "usdsplat, CUDA"}
COLOURS = ("#0969da", "#d1242f", "#8250df", "#9a6700", "#1a7f37", "#57606a")
DARK_COLOURS = ("#79c0ff", "#ff7b72", "#d2a8ff", "#e3b341", "#56d364", "#a0a8b2")
DASHES = ("none", "7 4", "2 4")
STYLE = """
svg { color: #1f2328; background: #ffffff; font: 12px sans-serif }
text { fill: currentColor }
.axis { stroke: currentColor; fill: none; opacity: .55 }
.grid { stroke: currentColor; opacity: .13 }
.line { fill: none; stroke-width: 2 }
.whisker { stroke-width: 1.2 }
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One row."""

    splats: float
    visible: float
    ms: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """A device and a kind of scene."""

    device: str
    kind: str
    points: tuple[Point, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """A logarithmic axis of `length` pixels."""

    low: float
    high: float
    length: float

    @classmethod
    def of(cls, values: Iterable[float], length: float) -> Axis:
        """From the power of ten below all values to the one above."""
        exponents = [math.log10(value) for value in values]
        low, high = math.floor(min(exponents)), math.ceil(max(exponents))
        return cls(low=10.0**low, high=10.0 ** max(high, low + 1), length=length)

    def at(self, value: float) -> float:
        """Pixels from the low end."""
        return self.length * math.log(value / self.low) / math.log(self.high / self.low)

    @property
    def ticks(self) -> list[float]:
        """Powers of ten."""
        first, last = round(math.log10(self.low)), round(math.log10(self.high))
        return [10.0**exponent for exponent in range(first, last + 1)]


def kind_of(scene: str) -> str:
    """A scene's name without what counts its splats: "garden 3×3" is a garden."""
    return re.sub(r"[\s,]*[\d.]+([×x]\d+|\s?[kM])?$", "", scene)


def lines_of(rows: Iterable[Row]) -> list[Line]:
    """Rows that can be drawn, by device and kind of scene, in the order of their first ones."""
    found: dict[tuple[str, str], list[Point]] = {}
    for row in rows:
        if not {"device", "scene", "splats", "visible", "ms"} <= row.keys():
            continue
        if row.get("size", SIZE) != SIZE or row.get("sh", 0) or not row["visible"]:
            continue
        point = Point(
            splats=row["splats"],
            visible=row["visible"],
            ms=row["ms"],
            low=row.get("low", row["ms"]),
            high=row.get("high", row["ms"]),
        )
        found.setdefault((row["device"], kind_of(row["scene"])), []).append(point)
    along = {device for (device, _), points in found.items() if len(points) > 1}
    return [
        Line(device=device, kind=kind, points=tuple(sorted(points, key=lambda p: p.splats)))
        for (device, kind), points in found.items()
        if len(points) > 1 or device not in along
    ]


def short(value: float) -> str:
    """A tick: 0.1, 10, 1 k, 10 M."""
    for size, unit in ((1e6, " M"), (1e3, " k")):
        if value >= size:
            return f"{value / size:g}{unit}"
    return f"{value:g}"


def drawing(lines: Sequence[Line]) -> str:
    """The SVG.

    Raises:
        ValueError: If there are no lines.
    """
    if not lines:
        raise ValueError("no rows to draw")
    devices = list(dict.fromkeys(line.device for line in lines))
    kinds = list(dict.fromkeys(line.kind for line in lines))
    width = LEFT + 2 * WIDTH + GAP + 24
    legend = TOP + HEIGHT + 62
    height = legend + 20 * -(-len(lines) // 2) + 4
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'width="{width}" height="{height}">',
        f"<title>Milliseconds of a picture of {SIZE}</title>",
        f"<style>{STYLE}{_colours(COLOURS, devices)}",
        f"@media (prefers-color-scheme: dark) {{ svg {{ color: #e6edf3; background: #0d1117 }}"
        f" {_colours(DARK_COLOURS, devices)} }}</style>",
        f'<text x="{LEFT}" y="24" font-weight="bold">Milliseconds of a picture of '
        f"{SIZE.replace('x', '×')}</text>",
    ]
    points = [point for line in lines for point in line.points]
    y = Axis.of((v for p in points for v in (p.low, p.high)), HEIGHT)
    for number, (what, title) in enumerate(PANELS.items()):
        x = Axis.of((getattr(p, what) for p in points), WIDTH)
        parts.append(f'<g transform="translate({LEFT + number * (WIDTH + GAP)} {TOP})">')
        parts += _frame(x, y, title)
        for line in lines:
            parts += _series(line, what, x, y, _style(line, devices, kinds))
        parts.append("</g>")
    for number, line in enumerate(lines):
        at_x, at_y = LEFT + number % 2 * (WIDTH + GAP), legend + 20 * (number // 2)
        if len(line.points) > 1:
            parts.append(f'<path {_style(line, devices, kinds)} d="M{at_x} {at_y - 4}h34"/>')
        dot = f'class="d{devices.index(line.device)}" cx="{at_x + 17}" cy="{at_y - 4}" r="3.5"'
        name = OURS.get(line.device, line.device)
        parts.append(f"<circle {dot}/>")
        parts.append(f'<text x="{at_x + 44}" y="{at_y}">{escape(name)}: {escape(line.kind)}</text>')
    return "\n".join([*parts, "</svg>", ""])


def _colours(colours: Sequence[str], devices: Sequence[str]) -> str:
    rules = []
    for number in range(len(devices)):
        colour = colours[number % len(colours)]
        rules.append(f".c{number} {{ stroke: {colour} }} .d{number} {{ fill: {colour} }}")
    return " ".join(rules)


def _style(line: Line, devices: Sequence[str], kinds: Sequence[str]) -> str:
    dashes = DASHES[kinds.index(line.kind) % len(DASHES)]
    return f'class="line c{devices.index(line.device)}" stroke-dasharray="{dashes}"'


def _frame(x: Axis, y: Axis, title: str) -> list[str]:
    parts = []
    for tick in y.ticks:
        at = HEIGHT - y.at(tick)
        parts.append(f'<path class="grid" d="M0 {at:.1f}H{WIDTH}"/>')
        parts.append(f'<text x="-7" y="{at + 4:.1f}" text-anchor="end">{short(tick)}</text>')
    for tick in x.ticks:
        at = x.at(tick)
        parts.append(f'<path class="grid" d="M{at:.1f} 0V{HEIGHT}"/>')
        parts.append(
            f'<text x="{at:.1f}" y="{HEIGHT + 17}" text-anchor="middle">{short(tick)}</text>'
        )
    parts.append(f'<path class="axis" d="M0 0V{HEIGHT}H{WIDTH}"/>')
    parts.append(f'<text x="{WIDTH / 2}" y="{HEIGHT + 36}" text-anchor="middle">{title}</text>')
    return parts


def _series(line: Line, what: str, x: Axis, y: Axis, style: str) -> list[str]:
    number = style.partition(" c")[2].partition('"')[0]
    places = [(x.at(getattr(p, what)), p) for p in line.points]
    along = " ".join(f"{at:.1f},{HEIGHT - y.at(p.ms):.1f}" for at, p in sorted(places, key=_first))
    parts = [f'<polyline {style} points="{along}"/>'] if len(places) > 1 else []
    for at, p in places:
        low, high, middle = (HEIGHT - y.at(value) for value in (p.low, p.high, p.ms))
        parts.append(f'<path class="whisker c{number}" d="M{at:.1f} {low:.1f}V{high:.1f}"/>')
        parts.append(f'<circle class="d{number}" cx="{at:.1f}" cy="{middle:.1f}" r="3.5"/>')
    return parts


def _first(place: tuple[float, Point]) -> float:
    return place[0]


def main(paths: Sequence[str]) -> None:
    """Draw the files but the last into the last."""
    if len(paths) < 2:
        sys.exit("plot: expected RESULTS.json... PICTURE.svg")
    *sources, target = map(Path, paths)
    rows = [row for source in sources for row in read_results(source).rows]
    target.write_text(drawing(lines_of(rows)), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
