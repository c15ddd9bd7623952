"""Plot the milliseconds of a picture over the splats of its scene, both logarithmic, as an SVG.

    python -m benchmarks.plot RESULTS.json... PICTURE.svg

The left panel is over stored splats, the right one over visible splats. Rows with the same device
and kind of scene form a line; whiskers reach from the fastest picture to the slowest. Only rows of
SIZE and without harmonics are plotted. A scene that is the only one of its kind is plotted only if
its device has no line. Plots need matplotlib: pip install usdsplat[plots].
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.report import Row, read_results

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIZE = "1920x1080"
PANELS = {"splats": "splats stored", "visible": "splats visible"}
OURS = {"cpu": "usdsplat, CPU", "cuda": "usdsplat, CUDA"}
COLOURS = ("#0969da", "#d1242f", "#8250df", "#9a6700", "#1a7f37", "#57606a")
DASHES = ("-", "--", ":", "-.")
STYLE = {"svg.fonttype": "none", "svg.hashsalt": "usdsplat", "font.family": "sans-serif"}
"""Settings of matplotlib for SVGs: text stays text, and equal plots are equal files."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """The times of one scene."""

    splats: float
    visible: float
    ms: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """The points of one device and one kind of scene."""

    device: str
    kind: str
    points: tuple[Point, ...]


def kind_of(scene: str) -> str:
    """Return a scene's name without its size: "garden 3×3" is a garden."""
    return re.sub(r"[\s,]*[\d.]+([×x]\d+|\s?[kM])?$", "", scene)


def lines_of(rows: Iterable[Row]) -> list[Line]:
    """Group rows by device and kind of scene, in the order of their first row."""
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


def draw(lines: Sequence[Line], path: Path) -> None:
    """Write the plot as an SVG.

    Raises:
        ValueError: If there are no lines.
    """
    if not lines:
        raise ValueError("no rows to draw")
    from matplotlib.figure import Figure

    devices = list(dict.fromkeys(line.device for line in lines))
    kinds = list(dict.fromkeys(line.kind for line in lines))
    figure = Figure(figsize=(9.2, 4.6 + 0.13 * len(lines)), layout="constrained")
    figure.suptitle(f"Milliseconds of a picture of {SIZE.replace('x', '×')}")
    panels = figure.subplots(1, len(PANELS), sharey=True)
    for axes, (what, title) in zip(panels, PANELS.items(), strict=True):
        for number, line in enumerate(lines):
            points = sorted(line.points, key=lambda p: getattr(p, what))
            container = axes.errorbar(
                [getattr(p, what) for p in points],
                [p.ms for p in points],
                yerr=[[p.ms - p.low for p in points], [p.high - p.ms for p in points]],
                fmt="o" + DASHES[kinds.index(line.kind) % len(DASHES)],
                color=COLOURS[devices.index(line.device) % len(COLOURS)],
                markersize=4,
                elinewidth=1,
                label=f"{OURS.get(line.device, line.device)}: {line.kind}",
            )
            container.lines[0].set_gid(f"{what}-{number}")
        axes.set(xscale="log", yscale="log", xlabel=title)
        axes.minorticks_off()
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("ms")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    save(figure, path)


def save(figure: Figure, path: Path) -> None:
    """Write a figure as an SVG without date, so that equal figures are equal files."""
    import matplotlib

    metadata: dict[str, Any] = {"Date": None, "Creator": None}
    with matplotlib.rc_context(STYLE):
        figure.savefig(path, format="svg", metadata=metadata)


def main(paths: Sequence[str]) -> None:
    """Plot the results of all paths but the last, and write the plot to the last."""
    if len(paths) < 2:
        sys.exit("plot: expected RESULTS.json... PICTURE.svg")
    *sources, target = map(Path, paths)
    rows = [row for source in sources for row in read_results(source).rows]
    draw(lines_of(rows), target)


if __name__ == "__main__":
    main(sys.argv[1:])
