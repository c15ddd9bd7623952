"""Measure how well splat trees at their defaults are drawn from afar, and at what cost.

    python -m benchmarks.lod_quality [--size WIDTHxHEIGHT] [--lod-error PIXELS] [--samples N]
                                     [--json FILE] [CAPTURE ...]

The truth is that of `benchmarks.minification`: at k times the framing distance, the classic picture
at k times the resolution, averaged over k x k pixels in the display space. At 1x it is the classic
picture of the whole capture. Cells are dB over the pixels that it shows, the least of three views,
against this mean, which takes 4 GB of memory at 16x. "others" is the best of the whole capture,
classic and antialiased, and of a quarter of its splats, decimated as they are, drawn in either mode
with one sample a pixel. Costs are splats of the cut, and processor time of a picture, the median of
the views.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom
from rich.table import Table

from benchmarks import minification
from benchmarks.minification import DISTANCES, Framing, psnr
from benchmarks.report import Report
from benchmarks.scenes import DATA
from usdsplat import formats
from usdsplat.core.cloud import F32, F64
from usdsplat.delegate.engine import Engine
from usdsplat.interchange.decimating import decimate
from usdsplat.interchange.files import open_stage
from usdsplat.interchange.lod import build_tree
from usdsplat.kernels.devices import open_device
from usdsplat.render.lod.nodes import view_cut
from usdsplat.render.renderer import Renderer
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import View

CAPTURES = (
    "pod.spz",
    "playbot_lod2.sog",
    "flowers_lod2_0.sog",
    "statue_trumpet.sog",
    "statue_massa.sog",
)
"""The last one was not used to tune anything."""
GAIN, NEAR = 3.0, 45.0
"""Bars: gain over the others at 4x and 8x, and quality at 1x [dB]; at 2x the quality of the whole
capture."""


class TreePictures:
    """Pictures of a tree, with cameras in the coordinates of its capture.

    Args:
        stage: The stage of the tree.
        settings: Render settings.
    """

    def __init__(self, stage: Usd.Stage, settings: RenderSettings) -> None:
        self._engine = Engine(stage)
        self._settings = settings
        self._to_capture = tree_to_capture(stage)

    def draw(self, view: View) -> tuple[F32, int, float]:
        """Return a picture, the splats of its cut, and its processor time [ms]."""
        before: F64 = np.reshape(view.camera.world_to_camera, (4, 4))
        matrix = tuple(map(float, (before @ self._to_capture).ravel()))
        view = replace(view, camera=replace(view.camera, world_to_camera=matrix))
        start = time.process_time()
        picture = np.array(self._engine.picture(view, self._settings)["color"], np.float32)
        spent = 1e3 * (time.process_time() - start)
        return picture, view_cut(self._engine.render_scene, view, self._settings).splats, spent

    def close(self) -> None:
        """Release the engine."""
        self._engine.close()


def tree_to_capture(stage: Usd.Stage) -> F64:
    """Return the matrix from the world of a tree's stage to the coordinates of its capture."""
    prim = next(p for p in stage.Traverse() if p.GetTypeName() == "ParticleFieldSplatTree")
    matrix = UsdGeom.XformCache().GetLocalToWorldTransform(prim)
    return np.asarray(np.linalg.inv(np.array(matrix).T), np.float64)


def of_tree(
    pictures: TreePictures, where: Framing, distance: int, size: tuple[int, int]
) -> Iterator[tuple[F32, int, float]]:
    """Yield the picture of each view, the splats of its cut and its processor time [ms]."""
    for view in where.views(distance, 1, size):
        pictures.draw(view)  # reads the nodes
        nudged = replace(view.camera, clipping_range=(0.0100001, view.camera.clipping_range[1]))
        yield pictures.draw(replace(view, camera=nudged))


def main(report: Report) -> None:
    """Print a table for all captures."""
    parser = argparse.ArgumentParser(prog="lod_quality", description=__doc__.partition("\n")[0])
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--lod-error", type=float)
    parser.add_argument("--samples", type=int)
    parser.add_argument("captures", nargs="*", default=CAPTURES)
    options = parser.parse_args(report.arguments)
    width, height = map(int, options.size.split("x"))
    size = width, height
    settings = RenderSettings(sorting="zDepth", color_mode="display")
    if options.lod_error is not None:
        settings = replace(settings, lod_error=options.lod_error)
    if options.samples is not None:
        settings = replace(settings, lod_samples=options.samples)
    table = Table(
        title=f"{width}x{height}, errors of {settings.lod_error:g} px, "
        f"{settings.lod_samples}x{settings.lod_samples} samples of coarse levels"
    )
    columns = ("capture", "distance", "splats of the cut", "CPU ms", "tree, dB", "others, dB")
    for column in (*columns, "gain, dB", "whole, classic, dB"):
        table.add_column(column, justify="right")
    for name in options.captures:
        _add(table, report, name, settings, size)
    report.show(table)


def _add(
    table: Table, report: Report, name: str, settings: RenderSettings, size: tuple[int, int]
) -> None:
    """Add the rows of one capture."""
    cloud = formats.read(DATA / "splats" / name).cloud
    where, quarter = Framing.of(cloud), decimate(cloud, len(cloud) // 4)
    renderer = Renderer(open_device())
    with tempfile.TemporaryDirectory() as folder:
        build_tree(DATA / "splats" / name, Path(folder) / "tree.usda")
        tree = TreePictures(open_stage(Path(folder) / "tree.usda"), settings)
        for k in DISTANCES:
            truth = minification.pictures(renderer, cloud, where, k, "classic", k, size)
            others = {}
            for label, some in (("whole", cloud), ("quarter", quarter)):
                for mode in ("classic", "antialiased"):
                    if (k, label, mode) == (1, "whole", "classic"):
                        continue  # the truth
                    drawn = minification.pictures(renderer, some, where, k, mode, 1, size)
                    others[label, mode] = min(map(psnr, drawn, truth))
            whole = others.get(("whole", "classic"), -np.inf)
            best = max(others.values())
            found = list(of_tree(tree, where, k, size))
            quality = min(psnr(each[0], true) for each, true in zip(found, truth, strict=True))
            splats, spent = (float(np.median([each[i] for each in found])) for i in (1, 2))
            gain = "" if k == 1 else f"{quality - best:+.1f}"
            table.add_row(
                f"{name}, {len(cloud):,}" if k == 1 else "", f"{k}x", f"{splats:,.0f}",
                f"{spent:.0f}", f"{quality:.1f}", f"{best:.1f}", gain,
                "–" if k == 1 else f"{whole:.1f}", end_section=k == DISTANCES[-1],
            )  # fmt: skip
            report.add(
                scene=name, splats=len(cloud), size=f"{size[0]}x{size[1]}", distance=k, cut=splats,
                cpu_ms=spent, db=quality, others=best, whole=whole if k > 1 else None,
            )  # fmt: skip
            if least := bars(k, best, whole):
                verdict = "met" if quality >= least else "missed"
                report.say(f"{name}, {k}x: {quality:.1f} dB, bar {least:.1f} dB: {verdict}")
        tree.close()


def bars(distance: int, others: float, whole: float) -> float | None:
    """Return the least quality of a tree at a distance [dB]; None for no bar."""
    return {1: NEAR, 2: whole, 4: others + GAIN, 8: others + GAIN}.get(distance)


if __name__ == "__main__":
    with Report("lod_quality", sys.argv[1:]) as report:
        main(report)
