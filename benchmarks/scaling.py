"""Measure how the time of a picture scales with stored and with visible splats.

    python -m benchmarks.scaling [--quick] [--json FILE]

The garden is tiled from 0.1 to 20 million splats and drawn at 1920x1080. The camera changes
slightly for each picture, so that no results of the last one are reused. There are two lenses: with
the garden's own, the number of visible splats grows more and more slowly; with one four times as
long, it is about constant.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass

from rich.table import Table

from benchmarks.frame import draw
from benchmarks.report import Report, spread
from benchmarks.scenes import afresh, garden, scene_of, view_of
from usdsplat.kernels.device import Device
from usdsplat.kernels.devices import open_device
from usdsplat.render.renderer import FrameStats, Renderer

SIZE = (1920, 1080)
GRIDS = (1, 3, 5, 7, 9, 13)
LENSES = {"garden": 1.0, "garden, long lens": 4.0}
REPEATS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """Measurements of one scene with one lens."""

    scene: str
    stats: FrameStats
    """Statistics of the last picture."""
    wall_ms: list[float]
    cpu_ms: list[float]


def costs(device: Device, grids: tuple[int, ...], repeats: int) -> Iterator[Cost]:
    """Draw every scene with every lens."""
    renderer = Renderer(device)
    for grid in grids:
        cloud, view_matrix, k = garden(grid)
        scene = scene_of(cloud)
        for name, factor in LENSES.items():
            lens = k.copy()
            lens[0, 0], lens[1, 1] = k[0, 0] * factor, k[1, 1] * factor
            view = view_of(view_matrix, lens, SIZE)
            wall, cpu = [], []
            for number in range(repeats + 2):  # the second picture computes the spatial order
                before = time.perf_counter(), time.process_time()
                stats = draw(renderer, scene, afresh(view, number))[1]
                wall.append(1e3 * (time.perf_counter() - before[0]))
                cpu.append(1e3 * (time.process_time() - before[1]))
            yield Cost(scene=name, stats=stats, wall_ms=wall[2:], cpu_ms=cpu[2:])


def main(arguments: list[str]) -> None:
    """Print the table."""
    with Report("scaling", arguments) as report:
        device = open_device("cpu")
        table = Table(title=f"{device.name}: a picture at {SIZE[0]}×{SIZE[1]}")
        for name in ("scene", "stored", "seen", "ms", "CPU ms", "project", "sort", "bin", "blend"):
            table.add_column(name, justify="right")
        quick = "--quick" in report.arguments
        for cost in costs(device, GRIDS[:3] if quick else GRIDS, 3 if quick else REPEATS):
            stats, wall, cpu = cost.stats, spread(cost.wall_ms), spread(cost.cpu_ms)
            stages = [stats.cpu_ms.get(each, 0.0) for each in ("project", "sort", "bin", "blend")]
            table.add_row(
                cost.scene, f"{stats.splats:,}", f"{stats.visible:,}", f"{wall['ms']:.1f}",
                f"{cpu['ms']:.1f}", *(f"{each:.1f}" for each in stages),
            )  # fmt: skip
            report.add(
                device=device.name, scene=cost.scene, splats=stats.splats, visible=stats.visible,
                size=f"{SIZE[0]}x{SIZE[1]}", cpu_ms=cpu["ms"], **wall,
            )  # fmt: skip
        report.show(table)


if __name__ == "__main__":
    main(sys.argv[1:])
