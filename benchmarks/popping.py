"""Measure how pictures jump while a camera rotates in place or slowly orbits, for each sorting
mode.

    python -m benchmarks.popping [docs/popping.svg]

Two pictures from slightly different cameras differ by the motion, which shrinks with the step, and
by splats whose order changes. Each move is therefore drawn repeatedly, with half the step each
time. If a change halves too, the picture is continuous; if it stays, the picture pops.

With one order for all pixels, two splats change places in all pixels at once, which is visible.
With an order for each pixel, they change places along the line on which they intersect, and the
line moves. The pixel that it passes jumps, as at the edge of an object, but not all its neighbours
at the same time. In addition to the largest change of one pixel, the table therefore has the
largest change of 3x3 pixels at once, the minimum over the nine. This also excludes contributions
that cross the cutoff of 1/255, which change along lines, too.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from rich.console import Console
from rich.table import Table

from benchmarks.plot import save
from benchmarks.scenes import capture, scaled, view_of
from usdsplat.core.cloud import F32, F64
from usdsplat.kernels.devices import open_device
from usdsplat.render.renderer import Renderer
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings

Mode = Literal["zDepth", "cameraDistance", "rayHitDistance"]
MODES: tuple[Mode, ...] = ("zDepth", "cameraDistance", "rayHitDistance")
MOVES = ("yaw", "orbit")
CAPTURES = ("statue_angel.sog", "playbot_lod2.sog")
SIZE = (400, 300)
STEPS = (0.04, 0.02, 0.01)
"""Motion of the picture's centre in a step of a rotation in place [pixel]; an orbit uses the same
angle."""
SWEEP = 0.32
"""Length of a whole move for all steps [pixel], so that the same splats change places."""
JUMP = 0.02
"""Change from which a pixel counts as a jump."""
CUTOFF = 1 / 255


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """Change of RGBA from one picture to the next."""

    mean: float
    most: float
    """Largest change of 99.9 % of the pixels, by their worst channels."""
    largest: float
    together: float
    """Largest change of 3x3 pixels at once."""
    jumps: float
    """Number of jumping pixels per pixel of motion."""


def turn(angle: float) -> F64:
    """Return a rotation about the camera's y axis."""
    turned = np.eye(4)
    c, s = np.cos(angle), np.sin(angle)
    turned[0, [0, 2]], turned[2, [0, 2]] = (c, s), (-s, c)
    return turned


def moved(move: str, view_matrix: F64, angle: float, distance: float) -> F64:
    """Return the camera after a rotation in place, or about the point `distance` in front of it."""
    to, back = np.eye(4), np.eye(4)
    if move == "orbit":
        to[2, 3], back[2, 3] = -distance, distance
    return back @ turn(angle) @ to @ view_matrix.astype(np.float64)


class Camera:
    """A capture and a camera that moves."""

    def __init__(self, name: str) -> None:
        self._renderer = Renderer(open_device())
        self._scene: RenderScene
        self._scene, self._matrix, k = capture(name)
        self._k = scaled(k, SIZE[1] / 480)
        self._k[0, 2], self._k[1, 2] = SIZE[0] / 2, SIZE[1] / 2
        depth = self._draw(self._matrix, "zDepth", "depth")
        self._distance = float(np.median(depth[np.isfinite(depth)]))

    def _draw(self, matrix: F64, mode: Mode, aov: str) -> F32:
        settings = RenderSettings(sorting=mode, color_mode="display")
        view = view_of(matrix, self._k, SIZE)
        # Nothing may cross the near plane during the move, as this would be a jump, too.
        view = replace(view, camera=replace(view.camera, clipping_range=(1e-4, 1e10)))
        bands = self._renderer.render(self._scene, view, settings, (aov,))
        return np.concatenate([band.arrays[aov].copy() for band in bands])

    def change(self, move: str, mode: Mode, step: float) -> Change:
        """Return the statistics of a move with steps of a size [pixel]."""
        differences = []
        before = None
        for i in range(round(SWEEP / step) + 1):
            angle = i * step / self._k[0, 0]
            now = self._draw(moved(move, self._matrix, angle, self._distance), mode, "color")
            if before is not None:
                differences.append(np.abs(now - before).max(axis=-1))
            before = now
        worst = np.stack(differences)
        return Change(
            mean=float(worst.mean()),
            most=float(np.quantile(worst, 0.999)),
            largest=float(worst.max()),
            together=float(sliding_window_view(worst, (3, 3), axis=(1, 2)).min((-2, -1)).max()),
            jumps=float(np.sum(worst > JUMP)) / SWEEP,
        )


Found = dict[tuple[str, str, Mode], list[Change]]


def show(found: Found) -> None:
    """Print a line for each step, with the ratio to the step of twice the length."""
    table = Table(title=f"|ΔRGBA| from frame to frame, {SIZE[0]}x{SIZE[1]}, {SWEEP} pixel")
    for name in (
        "capture", "move", "order", "step [pixel]", "mean", "ratio", "99.9 %", "ratio", "largest",
        "ratio", "largest 3x3", "ratio", f"> {JUMP} a pixel of motion",
    ):  # fmt: skip
        table.add_column(name, justify="right")
    for (name, move, mode), changes in found.items():
        last: Change | None = None
        for step, change in zip(STEPS, changes, strict=True):
            cells = []
            for value in ("mean", "most", "largest", "together"):
                now = getattr(change, value)
                cells += [f"{now:.6f}", f"{getattr(last, value) / now:.2f}" if last else ""]
            table.add_row(
                Path(name).stem, move, mode, f"{step}", *cells,
                f"{change.jumps:,.0f}", end_section=step == STEPS[-1],
            )  # fmt: skip
            last = change
    Console(width=150).print(table)


COLOURS = {"zDepth": "#d1242f", "cameraDistance": "#9a6700", "rayHitDistance": "#0969da"}
DASHES = {"zDepth": "-", "cameraDistance": "--", "rayHitDistance": "-"}


def plot(found: Found, path: Path) -> None:
    """Write the largest changes over the step, both logarithmic, as an SVG."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.4, 6.2), layout="constrained")
    panels = figure.subplots(len(MOVES), len(CAPTURES), sharex=True, sharey=True)
    for row, move in zip(panels, MOVES, strict=True):
        for axes, name in zip(row, CAPTURES, strict=True):
            for mode in MODES:
                line = {"color": COLOURS[mode], "linestyle": DASHES[mode]}
                changes = found[name, move, mode]
                single = [change.largest for change in changes]
                axes.plot(STEPS, single, **line, linewidth=1, alpha=0.6)
                together = [change.together for change in changes]
                axes.plot(STEPS, together, **line, linewidth=2.5, label=mode)
            axes.axhline(CUTOFF, color="gray", linestyle=":")
            axes.set(xscale="log", yscale="log", xlim=(STEPS[0], STEPS[-1]), ylim=(1e-4, 1))
            axes.set_title(f"{Path(name).stem}, {move}", fontsize="medium")
            axes.set_xticks(STEPS, [f"{step:g}" for step in STEPS])
            axes.minorticks_off()
            axes.grid(alpha=0.3)
    figure.supxlabel(
        "Largest change from frame to frame over the step [pixel]; "
        "a jump does not shrink with it.\n"
        "Thick: of 3x3 pixels at once, thin: of one pixel, dotted: 1/255.",
        fontsize="medium",
    )
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(MODES), frameon=False)
    save(figure, path)


def main(path: str | None = None) -> None:
    """Print the table, and write the plot if a path is given."""
    found: Found = {}
    for name in CAPTURES:
        camera = Camera(name)
        for move in MOVES:
            for mode in MODES:
                found[name, move, mode] = [camera.change(move, mode, step) for step in STEPS]
    show(found)
    if path is not None:
        plot(found, Path(path))


if __name__ == "__main__":
    main(*sys.argv[1:2])
