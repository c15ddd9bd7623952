"""Measure a frame by stage, with its floor and the yardstick in the same run.

    python -m benchmarks.frame [--quick] [--json FILE]

The floor is the time to blend without any search (`probe_ns`), measured in this process with as
many threads, times the number of blocks of 4x4 pixels that the frame blends.
`shared/peers/yardstick.py`, if it is available, draws the same garden in the same run; its pictures
and ours take turns.
"""

from __future__ import annotations

import importlib.util
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.report import Report, spread
from benchmarks.scenes import (
    CAPTURES,
    DATA,
    afresh,
    capture,
    garden,
    lens_of,
    scaled,
    scene_of,
    view_of,
)
from usdsplat.core.cloud import F32
from usdsplat.kernels import bins, blend, project, ray_hit, reference
from usdsplat.kernels.bins import TILE
from usdsplat.kernels.device import Device
from usdsplat.kernels.devices import open_device
from usdsplat.render.renderer import FrameStats, Renderer
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import View

STAGES = ("project", "shade", "sort", "bin", "blend")
SETTINGS = RenderSettings(sorting="zDepth", color_mode="display")
REPEATS = 9


def probe_ns(device: Device) -> float:
    """Return the CPU nanoseconds to blend a block of 4x4 pixels in tiles that many faint splats
    cover completely, so that no time goes into anything else; the median of 5."""
    tiles, splats = 128, 512
    records = np.zeros((splats, project.RECORD), np.float32)
    records[:, project.U] = records[:, project.V] = np.random.default_rng(0).uniform(0, 15, splats)
    records[:, project.A] = records[:, project.C] = -1e-9
    records[:, project.LOG_OPACITY] = np.log(0.01)
    records[:, project.HALF_WIDTH] = records[:, project.HALF_HEIGHT] = 1e4
    starts = np.arange(tiles + 1, dtype=np.int64) * splats
    lists = np.tile(np.arange(splats, dtype=np.int32), tiles)
    grid = bins.grid_of(0, 0, TILE, TILE * tiles)
    image = np.empty((TILE * tiles, TILE * 4), np.float32)
    work = np.empty(tiles, np.int64)
    nothing = np.empty((0, ray_hit.RAY_HIT), np.float32), np.empty((0, 0), np.float32)
    spent = []
    for _ in range(6):
        before = time.process_time()
        device.run(
            blend.blend, records, records, project.RED, starts, lists, grid, *nothing, False,
            image, work,
        )  # fmt: skip
        spent.append((time.process_time() - before) / work.sum())
    return 1e9 * float(np.median(spent[1:]))


def draw(renderer: Renderer, scene: RenderScene, view: View) -> tuple[F32, FrameStats]:
    """Draw one whole picture. Return it and its statistics."""
    bands = [
        band.arrays["color"].copy() for band in renderer.render(scene, view, SETTINGS, ("color",))
    ]
    return np.concatenate(bands), renderer.stats


def drawn(renderer: Renderer, scene: RenderScene, view: View, repeats: int) -> list[FrameStats]:
    """Return the statistics of pictures with slightly different cameras, without the first two,
    which prepare the scene."""
    return [draw(renderer, scene, afresh(view, k))[1] for k in range(repeats + 2)][2:]


def load_yardstick(folder: Path) -> Any | None:
    """Load the peer as a module from a copy, because its compiled code is cached beside it."""
    source = DATA.parent / "peers" / "yardstick.py"
    if not source.is_file():
        return None
    spec = importlib.util.spec_from_file_location("yardstick", shutil.copy(source, folder))
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["yardstick"] = module
    spec.loader.exec_module(module)
    return module


def psnr(a: F32, b: Any) -> float:
    """Return the peak signal-to-noise ratio [dB] of two pictures for a peak of 1."""
    return float(-10 * np.log10(np.mean((a.astype(np.float64) - b) ** 2)))


def totals(stats: list[FrameStats], kind: str) -> Any:
    """Return the median milliseconds by stage, and of the whole picture."""
    rows = [[getattr(s, kind).get(name, 0.0) for name in STAGES] for s in stats]
    rows = [[*row, sum(row)] for row in rows]
    return np.median(rows, axis=0)


class Stages:
    """Table of the times of the stages. Its rows are added to a report."""

    def __init__(self, report: Report, probe_time: float) -> None:
        self._report, self._probe = report, probe_time
        self._table = Table(
            title=f"one frame: wall ms / CPU ms by stage; probe {probe_time:.1f} ns a block"
        )
        for name in (
            "scene", "size", "splats", "visible", "pairs", "blocks", *STAGES, "total", "floor",
            "× floor",
        ):  # fmt: skip
            self._table.add_column(name, justify="right")

    def add(self, name: str, view: View, stats: list[FrameStats]) -> float:
        """Add a line, and return the total [CPU-ms]."""
        wall, cpu = totals(stats, "wall_ms"), totals(stats, "cpu_ms")
        last = stats[-1]
        floor = last.blocks * self._probe * 1e-6
        width, height = view.framing.resolution
        self._table.add_row(
            name, f"{width}×{height}", f"{last.splats:,}", f"{last.visible:,}", f"{last.pairs:,}",
            f"{last.blocks:,}", *(f"{w:.1f}/{c:.1f}" for w, c in zip(wall, cpu, strict=True)),
            f"{floor:.0f}", f"{cpu[-1] / floor:.2f}",
        )  # fmt: skip
        whole = [sum(each.wall_ms.get(stage, 0.0) for stage in STAGES) for each in stats]
        self._report.add(
            device="cpu", scene=name, splats=last.splats, visible=last.visible,
            size=f"{width}x{height}", **spread(whole), cpu_ms=float(cpu[-1]),
        )  # fmt: skip
        return float(cpu[-1])

    def show(self) -> None:
        """Print the table in its full width."""
        self._report.show(self._table, 220)


def against_yardstick(
    yardstick: Any,
    renderer: Renderer,
    report: Report,
    table: Stages,
    grid: int,
    size: tuple[int, int],
    repeats: int,
) -> None:
    """Draw the garden in turns with the peer. Print the ratio, and compare the pictures."""
    cloud, view_matrix, k = garden(grid)
    scene, view = scene_of(cloud), view_of(view_matrix, lens_of(k, size), size)
    ours, _ = draw(renderer, scene, view)
    draw(renderer, scene, afresh(view, 1))  # computes the spatial order
    stats, log = [], []
    theirs: Any = None
    if yardstick is not None:
        npz = DATA / "garden" / "scene.npz"
        peer_scene, peer_view, peer_k = yardstick.garden(npz, grid, size)
        work = yardstick.Work(len(peer_scene[0]))
        theirs = yardstick.render(work, peer_scene, peer_view, peer_k, *size)[0].copy()
    for number in range(repeats):
        stats.append(draw(renderer, scene, afresh(view, number + 2))[1])
        if yardstick is not None:
            yardstick.render(work, peer_scene, peer_view, peer_k, *size, log=log)
    name = f"garden {grid}×{grid}"
    cpu = table.add(name, view, stats)
    if yardstick is None:
        return
    peer_wall, peer_cpu = np.median(np.array(log), axis=0)[[4, 9]]
    wall = totals(stats, "wall_ms")[-1]
    report.say(
        f"{name} {size[0]}x{size[1]}: ours {wall:.1f} wall ms {cpu:.1f} CPU ms, prototype "
        f"{peer_wall:.1f} and {peer_cpu:.1f}: ratio {wall / peer_wall:.2f} and "
        f"{cpu / peer_cpu:.2f}; "
        f"PSNR {psnr(ours, theirs):.1f} dB"
    )


def against_reference(renderer: Renderer, report: Report) -> None:
    """Compare the garden at 1080p with the float64 reference. Print the signal-to-noise ratio."""
    cloud, view_matrix, k = garden()
    ours, _ = draw(renderer, scene_of(cloud), view_of(view_matrix, k, (1920, 1080)))
    lens = reference.Lens(
        world_to_camera=view_matrix.astype(np.float64), focal=(k[0, 0], k[1, 1]),
        center=(k[0, 2], k[1, 2]), size=(1920, 1080),
    )  # fmt: skip
    expected = reference.render([(cloud, np.eye(4))], lens).color
    error = np.abs(ours - expected)
    report.say(
        f"garden 1920x1080: {psnr(ours, expected):.1f} dB against float64, worst {error.max():.4f}"
    )


def main(arguments: list[str]) -> None:
    """Print all tables."""
    with Report("frame", arguments) as report:
        quick = "--quick" in report.arguments
        device = open_device("cpu")
        renderer = Renderer(device)
        repeats = 3 if quick else REPEATS
        report.say(f"{device.threads} threads, {repeats} repeats, medians")
        table = Stages(report, probe_ns(device))
        with tempfile.TemporaryDirectory() as folder:
            peer = load_yardstick(Path(folder))
            against_yardstick(peer, renderer, report, table, 1, (1920, 1080), repeats)
            if not quick:
                against_yardstick(peer, renderer, report, table, 3, (1920, 1080), repeats)
                for size in ((960, 720), (1920, 1080), (3840, 2160)):
                    against_yardstick(peer, renderer, report, table, 7, size, repeats)
        cloud, view_matrix, k = garden(degree=3)
        view = view_of(view_matrix, k, (1920, 1080))
        table.add("garden 1×1 SH 3", view, drawn(renderer, scene_of(cloud), view, repeats))
        for name in CAPTURES:
            captured, view_matrix, k = capture(name)
            for size in ((960, 720),) if quick else ((960, 720), (1920, 1080), (3840, 2160)):
                view = view_of(view_matrix, scaled(k, size[1] / 480), size)
                table.add(name, view, drawn(renderer, captured, view, repeats))
        table.show()
        against_reference(renderer, report)


if __name__ == "__main__":
    main(sys.argv[1:])
