"""How far pictures jump while a camera turns in place or slowly orbits, in each order of splats.

    python -m benchmarks.popping [docs/popping.svg]

Two pictures that are a small step apart differ by the motion, which shrinks with the step, and by
splats that change places in the order. So each move is drawn again and again with half the step:
where a change halves too, the picture is continuous, and where it stays, it pops.

In one order for all pixels, two splats change places in all pixels at once: that is what an eye
sees. In an order of each pixel's own they do so along a line, where they intersect, and the line
moves; the pixel that it passes jumps, as at the edge of any thing, but never its neighbours with
it. So beside the largest change of one pixel there is the largest of 3x3 pixels at once, the least
of the nine. It also leaves out the steps of contributions that pass the cutoff of 1/255, which run
along lines too.
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
"""[pixel] that the middle of the picture moves in a yaw; an orbit turns by the same angle."""
SWEEP = 0.32
"""[pixel] of a whole move, whatever its steps: the same splats change places."""
JUMP = 0.02
"""Change that is counted as a jump."""
CUTOFF = 1 / 255


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """How much RGBA changes from one picture to the next."""

    mean: float
    most: float
    """Of 99.9 % of the pixels, each with its worst channel."""
    largest: float
    together: float
    """The largest of 3x3 pixels at once."""
    jumps: float
    """Pixels that jump, for each pixel of motion."""


def turn(angle: float) -> F64:
    """A rotation about the camera's y axis."""
    turned = np.eye(4)
    c, s = np.cos(angle), np.sin(angle)
    turned[0, [0, 2]], turned[2, [0, 2]] = (c, s), (-s, c)
    return turned


def moved(move: str, view_matrix: F64, angle: float, distance: float) -> F64:
    """The camera after it turned in place, or about the point `distance` in front of it."""
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
        # Nothing passes the near plane while the camera moves: that would be a step too.
        view = replace(view, camera=replace(view.camera, clipping_range=(1e-4, 1e10)))
        bands = self._renderer.render(self._scene, view, settings, (aov,))
        return np.concatenate([band.arrays[aov].copy() for band in bands])

    def change(self, move: str, mode: Mode, step: float) -> Change:
        """Statistics of a move with steps of a size [pixel]."""
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
    """Print a line for each step; the ratio is that to the step twice as long."""
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


# --- the plot ---------------------------------------------------------------------------

WIDTH, HEIGHT, MARGIN, GAP = 300, 190, 58, 34
LOW, HIGH = 1e-4, 1.0
STYLE = """
svg { color: #1f2328; background: #ffffff; font: 12px sans-serif }
text { fill: currentColor }
.axis { stroke: currentColor; fill: none; opacity: .55 }
.grid { stroke: currentColor; opacity: .13 }
.cutoff { stroke: currentColor; opacity: .7; stroke-dasharray: 2 4 }
.line { fill: none; stroke-width: 2.5 }
.single { stroke-width: 1; opacity: .6 }
.zDepth { stroke: #d1242f }
.cameraDistance { stroke: #9a6700; stroke-dasharray: 7 4 }
.rayHitDistance { stroke: #0969da }
@media (prefers-color-scheme: dark) {
  svg { color: #e6edf3; background: #0d1117 }
  .zDepth { stroke: #ff7b72 }
  .cameraDistance { stroke: #e3b341 }
  .rayHitDistance { stroke: #79c0ff }
}
"""


def _x(step: float) -> float:
    return WIDTH * float(np.log(STEPS[0] / step) / np.log(STEPS[0] / STEPS[-1]))


def _y(value: float) -> float:
    return HEIGHT * float(np.log(HIGH / max(value, LOW)) / np.log(HIGH / LOW))


def panel(found: Found, name: str, move: str) -> list[str]:
    """Largest change over the step, both logarithmic."""
    parts = [f'<text x="0" y="-8" font-weight="bold">{Path(name).stem}, {move}</text>']
    for tick in (1.0, 0.1, 0.01, 0.001, 0.0001):
        y = _y(tick)
        parts.append(f'<path class="grid" d="M0 {y:.1f}H{WIDTH}"/>')
        parts.append(f'<text x="-6" y="{y + 4:.1f}" text-anchor="end">{tick:g}</text>')
    for step in STEPS:
        parts.append(
            f'<text x="{_x(step):.1f}" y="{HEIGHT + 16}" text-anchor="middle">{step:g}</text>'
        )
    parts.append(f'<path class="axis" d="M0 0V{HEIGHT}H{WIDTH}"/>')
    y = _y(CUTOFF)
    parts.append(f'<path class="cutoff" d="M0 {y:.1f}H{WIDTH}"/>')
    parts.append(f'<text x="{WIDTH}" y="{y - 4:.1f}" text-anchor="end">1/255</text>')
    for mode in MODES:
        changes = found[name, move, mode]
        for kind in ("single", "together"):
            points = " ".join(
                f"{_x(step):.1f},{_y(change.largest if kind == 'single' else change.together):.1f}"
                for step, change in zip(STEPS, changes, strict=True)
            )
            parts.append(f'<polyline class="line {mode} {kind}" points="{points}"/>')
    return parts


def plot(found: Found, path: Path) -> None:
    """Write the largest changes as an SVG."""
    columns, rows = len(CAPTURES), len(MOVES)
    width = columns * (WIDTH + MARGIN) + 20
    height = rows * (HEIGHT + MARGIN) + 84
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'width="{width}" height="{height}">',
        "<title>Largest change from frame to frame, by the length of the step</title>",
        f"<style>{STYLE}</style>",
    ]
    for i, mode in enumerate(MODES):
        x = MARGIN + 170 * i
        parts.append(f'<path class="line {mode}" d="M{x} 22h30"/>')
        parts.append(f'<text x="{x + 38}" y="26">{mode}</text>')
    for row, move in enumerate(MOVES):
        for column, name in enumerate(CAPTURES):
            x = MARGIN + column * (WIDTH + MARGIN)
            y = 66 + row * (HEIGHT + MARGIN)
            parts.append(f'<g transform="translate({x} {y})">')
            parts += [*panel(found, name, move), "</g>"]
    parts.append(
        f'<text x="{MARGIN}" y="{height - 12}">Largest change from frame to frame over the step '
        "[pixel]; thick: of 3x3 pixels at once, thin: of one. What pops stays.</text>"
    )
    path.write_text("\n".join([*parts, "</svg>", ""]), encoding="utf-8")


def main(path: str | None = None) -> None:
    """Print the table; draw it if there is a path."""
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
