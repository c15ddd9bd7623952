"""Measure the levels of a streamed SOG from afar, beside ours with as many splats.

    python -m benchmarks.streamed_levels [--size WIDTHxHEIGHT] [FOLDER ...]

The measure is that of `benchmarks.minification`: dB against the mean of the classic picture of the
finest level at k times the resolution, in the display space, the least of three views. "file" is a
level as it is in the file. "ours" are levels made by `decimating.level` from the finest one, with
the low-pass of the default pixel, each from the next finer one.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from rich.table import Table

from benchmarks.minification import (
    DISTANCES,
    LARGEST,
    SAMPLES,
    Framing,
    Way,
    asked,
    decibels,
    pictures,
    said,
)
from benchmarks.report import Report
from benchmarks.scenes import DATA
from usdsplat import formats
from usdsplat.core.cloud import SplatCloud
from usdsplat.formats.sog import lod
from usdsplat.interchange.decimating import FAR_LINES, framing_pixel, level
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.thinning.pairs import OPAQUE
from usdsplat.render.renderer import Renderer

COARSEST = 2000
"""Smallest number of splats of a level that is measured."""


def ways(folder: Path, finest: SplatCloud) -> Iterator[Way]:
    """Yield the rows of a table: each level of the file, and ours."""
    counts = lod.read_meta(folder)[1].counts
    ours, pixel = finest, framing_pixel(finest, FAR_LINES)
    yield Way("finest", finest, "classic", 1)
    yield Way("finest", finest, "antialiased", SAMPLES)
    for number, count in enumerate(counts[1:], 1):
        if count < COARSEST:
            return
        found = formats.read(folder, how=formats.ReadOptions(lod=number)).cloud
        for mode, scale in (("classic", 1), ("antialiased", 1), ("antialiased", SAMPLES)):
            yield Way(f"file {number}", found, mode, scale, is_peer=True)
        ours = level(ours, count, pixel=pixel, peak=OPAQUE)
        pixel = 0.0
        yield Way(f"ours {number}", ours, "antialiased", SAMPLES)


def main(report: Report) -> None:
    """Print a table for each folder."""
    names, size = asked(report.arguments)
    renderer = Renderer(open_device())
    for folder in map(Path, names or [DATA / "streamed" / "playbot"]):
        finest = formats.read(folder).cloud
        where = Framing.of(finest)
        distances = [k for k in DISTANCES if k * size[0] <= LARGEST]
        table = Table(title=f"{folder.name}, {size[0]}x{size[1]}: dB")
        for column in ("level", "splats", "mode", *(f"{distance}x" for distance in distances)):
            table.add_column(column)
        truth = {k: pictures(renderer, finest, where, k, "classic", k, size) for k in distances}
        for way in ways(folder, finest):
            found = decibels(renderer, way, where, truth, size)
            for k, least in found.items():
                report.add(
                    scene=folder.name,
                    way=f"{way.label} {way.mode} {way.scale}",
                    splats=len(way.cloud),
                    distance=k,
                    db=least,
                )
            kind = f"{way.mode} {way.scale}x{way.scale}"
            table.add_row(way.label, f"{len(way.cloud):,}", kind, *map(said, found.values()))
        report.show(table, 120)


if __name__ == "__main__":
    with Report("streamed_levels", sys.argv[1:]) as report:
        main(report)
