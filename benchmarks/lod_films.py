"""Measure how much pictures of splat trees jump while a camera orbits, or moves away.

    python -m benchmarks.lod_films [--size WIDTHxHEIGHT] [--frames N] [--samples N]
                                   [--moves MOVE,...] [--plot PICTURE.svg] [--sheets FOLDER]
                                   [--json FILE] [SCENE ...]

A scene is a capture, or "merged", copies of a capture side by side. Each frame is drawn three
times: the tree; the tree with the cut of the frame before; and the leaves alone.

"jump" is the change of a pixel by the change of the cut alone: the difference of the first two
pictures, which has no motion in it. "tree − leaves" is the change of the difference of tree and
leaves from one frame to the next. It is also due to the motion: where the leaves of a classic
capture are too dense and the tree is not, their difference moves with the camera. Columns are the
largest over all frames, in 1/255: of 99.9 % of the pixels that show something in either picture,
and of all pixels of a square of 5x5 at once. "cuts" is the number of frames in which a jump occurs.

"least" is a bound of the jump of a dolly for any way of fading: a pixel that changes by a
difference d, from a picture with the coarser nodes of the fading ones to one with their children,
over the n frames in which a node fades, changes by d / n in one of them at least.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import OpenImageIO as oiio
from numpy.lib.stride_tricks import sliding_window_view
from rich.table import Table

from benchmarks import lod_build
from benchmarks.lod_quality import tree_to_capture
from benchmarks.minification import Framing
from benchmarks.plot import COLOURS, save
from benchmarks.report import Report
from benchmarks.scenes import DATA, looking_at, view_of
from usdsplat import formats
from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.delegate.engine import Engine
from usdsplat.interchange.files import open_stage
from usdsplat.interchange.lod import build_tree
from usdsplat.render.lod import nodes
from usdsplat.render.lod.cut import FADE, Cut
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import View

SCENES = (
    "pod.spz", "playbot_lod2.sog", "flowers_lod2_0.sog", "statue_trumpet.sog", "statue_massa.sog",
    "merged",
)  # fmt: skip
MERGED = 400_000
"""Number of splats of the merged scene."""
MOVES = ("orbit", "dolly")
ORBIT, DOLLY = 3.0, (1.0, 8.0)
"""Distances of the camera, relative to the framing one."""
BAR = 2 / 255
"""Bar for 99.9 % of the pixels."""
SQUARE = 5
SHOWN = 8
"""Frames of a contact sheet."""
AMPLIFIED = 16


class Film:
    """Pictures of a tree, whose cuts may be those of other views.

    Args:
        engine: Engine of the stage of the tree.
        samples: `RenderSettings.lod_samples`; None for the default.
    """

    def __init__(self, engine: Engine, samples: int | None = None) -> None:
        self._engine = engine
        self._settings = RenderSettings(sorting="zDepth", color_mode="display", node_lifetime=1e6)
        if samples is not None:
            self._settings = replace(self._settings, lod_samples=samples)
        self._held: Any = None
        self._last: Any = None

    def draw(
        self, view: View, cut: Any = None, *, error: float = 1.0, fade: float | None = None
    ) -> tuple[F32, Any]:
        """Return a picture, and its cut for other pictures.

        Args:
            view: The view.
            cut: Second result for another view; None for the view's own cut.
            error: `RenderSettings.lod_error` [pixel]; 0 draws the leaves.
            fade: 1 draws all fading nodes without their children, 0 the children without them, None
                both.
        """
        choose, refined, self._held = nodes.choose, Cut.refined, cut

        def chosen(trees: Any, screens: Any, **options: Any) -> Any:
            self._last = screens
            return choose(trees, self._held or screens, **options)

        def faded(cut: Cut, errors: Any, fades: tuple[float, float]) -> Any:
            return refined(cut, errors, fades if fade is None else (fade, fade))

        settings = replace(self._settings, lod_error=error)
        with patch.object(nodes, "choose", chosen), patch.object(Cut, "refined", faded):
            bands = [band.arrays["color"].copy() for band in self._engine.render(view, settings)]
        return np.concatenate(bands), self._last


def views(
    move: str, where: Framing, frames: int, size: tuple[int, int], to_capture: F64
) -> Iterator[View]:
    """Yield the views of a move around a capture.

    Args:
        move: One of MOVES.
        where: Sphere around the capture.
        frames: Number of views.
        size: Resolution [pixel].
        to_capture: Matrix from the stage to the capture.
    """
    for part in (np.arange(frames) / max(1, frames - 1)).tolist():
        turn = 0.4 + (0.5 * np.pi * part if move == "orbit" else 0.0)
        far = ORBIT if move == "orbit" else DOLLY[0] * (DOLLY[1] / DOLLY[0]) ** part
        matrix, k = looking_at(where.center, turn, far * where.radius * 2.4, size)
        yield view_of(matrix @ to_capture, k, size)


class Changes:
    """Statistics of a film, frame by frame, and a contact sheet of it."""

    def __init__(self, frames: int) -> None:
        self.jump: list[float] = []
        self.jump_together: list[float] = []
        self.change: list[float] = []
        self.change_together: list[float] = []
        self.least: list[float] = []
        self._every = max(1, frames // SHOWN)
        self._strips: list[F32] = []
        self._before: F32 | None = None

    def add(self, tree: F32, held: F32, leaves: F32) -> None:
        """Add a frame.

        Args:
            tree: Picture of the tree, RGBA.
            held: The same with the cut of the frame before.
            leaves: Picture of the leaves.
        """
        shown = (tree[..., 3] > 1 / 255) | (leaves[..., 3] > 1 / 255)
        now = tree - leaves
        if len(self.jump) % self._every == 0:
            apart = np.abs(now[..., :3]) * AMPLIFIED
            self._strips.append(np.concatenate([tree[..., :3], leaves[..., :3], apart]))
        moved = np.zeros_like(now) if self._before is None else now - self._before
        self._before = now
        for values, single, together in (
            (tree - held, self.jump, self.jump_together),
            (moved, self.change, self.change_together),
        ):
            worst = np.abs(values).max(axis=-1)
            single.append(float(np.quantile(worst[shown], 0.999)))
            together.append(float(smallest(worst, SQUARE).max()))

    def add_ends(self, coarse: F32, fine: F32, frames: float) -> None:
        """Add the ends of the fades of a frame, which take a number of frames."""
        shown = (coarse[..., 3] > 1 / 255) | (fine[..., 3] > 1 / 255)
        worst = np.abs(fine - coarse).max(axis=-1)[shown]
        self.least.append(float(np.quantile(worst, 0.999)) / frames)

    def sheet(self) -> F32:
        """Return some frames side by side: the tree, the leaves, and their difference."""
        return np.concatenate(self._strips, axis=1)


def smallest(values: F32, edge: int) -> F32:
    """Return the minimum over each square of `edge` pixels."""
    across = sliding_window_view(values, edge, axis=1).min(axis=-1)
    return np.asarray(sliding_window_view(across, edge, axis=0).min(axis=-1), np.float32)


def film(
    engine: Engine, shots: Sequence[View], samples: int | None = None, fading: float | None = None
) -> Changes:
    """Return the statistics of a film.

    Args:
        engine: Engine of the stage of the tree.
        shots: The views.
        samples: See `Film`.
        fading: Number of frames in which a node is faded; None if they differ.
    """
    drawing, found, cut = Film(engine, samples), Changes(len(shots)), None
    for view in shots:
        tree, own = drawing.draw(view)
        held, _ = drawing.draw(view, cut)
        leaves, _ = drawing.draw(view, error=0.0)
        found.add(tree, held, leaves)
        if fading is not None:
            coarse, fine = (drawing.draw(view, fade=end)[0] for end in (1.0, 0.0))
            found.add_ends(coarse, fine, fading)
        cut = own
    return found


def source_of(scene: str, folder: Path) -> tuple[Path, SplatCloud]:
    """Return the input of a tree, and its splats."""
    if scene != "merged":
        path = DATA / "splats" / scene
        return path, formats.read(path).cloud
    path, cloud = folder / "merged.ply", lod_build.world("pod.spz", 0, MERGED)
    formats.write(cloud, path)
    return path, cloud


def main(report: Report) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="lod_films", description=__doc__.partition("\n")[0])
    parser.add_argument("--size", default="480x360")
    parser.add_argument("--frames", type=int, default=240)
    parser.add_argument("--samples", type=int)
    parser.add_argument("--moves", default=",".join(MOVES))
    parser.add_argument("--plot", type=Path)
    parser.add_argument("--sheets", type=Path)
    parser.add_argument("scenes", nargs="*", default=SCENES)
    options = parser.parse_args(report.arguments)
    width, height = map(int, options.size.split("x"))
    table = Table(title=f"{width}x{height}, {options.frames} frames: largest of all [1/255]")
    for column in (
        "scene", "move", "cuts", "jump, 99.9 %", "least", f"jump, {SQUARE}x{SQUARE}",
        "tree − leaves, 99.9 %", f"tree − leaves, {SQUARE}x{SQUARE}",
    ):  # fmt: skip
        table.add_column(column, justify="right")
    found: dict[tuple[str, str], Changes] = {}
    moves = options.moves.split(",")
    pace = math.log(DOLLY[1] / DOLLY[0]) / max(1, options.frames - 1)
    for scene in options.scenes:
        with tempfile.TemporaryDirectory() as folder:
            path, cloud = source_of(scene, Path(folder))
            build_tree(path, Path(folder) / "tree.usda")
            stage = open_stage(Path(folder) / "tree.usda")
            where, to_capture = Framing.of(cloud), tree_to_capture(stage)
            with Engine(stage) as engine:
                for move in moves:
                    fading = math.log(FADE) / pace if move == "dolly" else None
                    shots = list(views(move, where, options.frames, (width, height), to_capture))
                    found[scene, move] = film(engine, shots, options.samples, fading)
        for move in moves:
            _add(table, report, scene, move, found[scene, move])
            if options.sheets:
                options.sheets.mkdir(parents=True, exist_ok=True)
                write(found[scene, move].sheet(), options.sheets / f"{Path(scene).stem}_{move}.png")
    report.show(table, 130)
    if options.plot:
        plot(found, options.plot)


def write(picture: F32, path: Path) -> None:
    """Write RGB as a PNG."""
    pixels = np.round(255 * np.clip(picture, 0, 1)).astype(np.uint8)
    buffer = oiio.ImageBuf(np.ascontiguousarray(pixels))
    if not buffer.write(str(path)):
        raise OSError(buffer.geterror())


def _add(table: Table, report: Report, scene: str, move: str, changes: Changes) -> None:
    """Add the row of one film."""
    values = {
        name: 255 * max(getattr(changes, name))
        for name in ("jump", "jump_together", "change", "change_together")
    }
    cuts = sum(each > 0 for each in changes.jump)
    jump, *others = (f"{value:.2f}" for value in values.values())
    least = 255 * max(changes.least, default=0.0)
    bound = f"{least:.2f}" if changes.least else "–"
    table.add_row(scene, move, str(cuts), jump, bound, *others)
    report.add(scene=f"{scene} {move}", cuts=cuts, least=least, **values)
    verdict = "met" if values["jump"] <= 255 * BAR else "missed"
    if least > 255 * BAR:
        verdict += f", as by any fade of this length: {least:.2f}"
    report.say(f"{scene}, {move}: jump {jump}/255, bar {255 * BAR:g}/255: {verdict}")


def plot(found: dict[tuple[str, str], Changes], path: Path) -> None:
    """Write the change of 99.9 % of the pixels over the frames, as an SVG."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.2, 5.0), layout="constrained")
    figure.suptitle("Change of 99.9 % of the pixels from frame to frame [1/255]")
    scenes = list(dict.fromkeys(scene for scene, _ in found))
    moves = list(dict.fromkeys(move for _, move in found))
    panels = figure.subplots(2, len(moves), sharex=True, sharey=True, squeeze=False)
    for axes_row, (name, label) in zip(
        panels, (("jump", "by the cut alone"), ("change", "of tree − leaves")), strict=True
    ):
        for axes, move in zip(axes_row, moves, strict=True):
            for number, scene in enumerate(scenes):
                values = 255 * np.array(getattr(found[scene, move], name))
                axes.plot(values, color=COLOURS[number], linewidth=1, label=scene)
            axes.axhline(255 * BAR, color="gray", linestyle=":")
            axes.set_title(f"{move}, {label}", fontsize="medium")
            axes.grid(alpha=0.3)
    for axes in panels[-1]:
        axes.set_xlabel("frame")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(scenes), frameon=False)
    save(figure, path)


if __name__ == "__main__":
    with Report("lod_films", sys.argv[1:]) as report:
        main(report)
