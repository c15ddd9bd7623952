"""Measure the peak memory of a frame, each in a separate process, and compare it with the estimate.

    python -m benchmarks.memory

A frame is drawn band by band and discarded, as by a file writer. The table compares the peak with
the memory of the process before drawing (Python, the libraries, the splats); with the estimates of
`render.memory`, without a limit and with a limit halfway between those of its largest and its
smallest bands; and with the size of the whole picture, which is never in memory.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from rich.table import Table

from benchmarks.report import Report
from benchmarks.scenes import CAPTURES, capture, garden, lens_of, scaled, scene_of, view_of
from usdsplat.render.memory import Estimate

SIZES = ((1920, 1080), (3840, 2160), (7680, 4320))
AOVS = ("color", "depth", "primId", "elementId")
SCENES = ("garden 1", "garden 7", *CAPTURES)


def resident(kind: str, process: int | str = "self") -> float:
    """Return VmRSS or VmHWM of a process [MiB], as reported by Linux."""
    for line in Path(f"/proc/{process}/status").read_text().splitlines():
        if line.startswith(kind):
            return int(line.split()[1]) / 1024
    raise LookupError(kind)


def one(name: str, size: tuple[int, int], *, is_limited: bool) -> None:
    """Draw one frame in this process; print splats, and [MiB] before, estimate, limit and peak."""
    from usdsplat.kernels.bins import TILE
    from usdsplat.kernels.devices import open_device
    from usdsplat.render.band import BAND_PIXELS
    from usdsplat.render.memory import PictureRequest, estimate, fitting
    from usdsplat.render.renderer import Renderer
    from usdsplat.render.settings import RenderSettings

    if name in CAPTURES:
        scene, view_matrix, k = capture(name)
        view = view_of(view_matrix, scaled(k, size[1] / 480), size)
    else:
        cloud, view_matrix, k = garden(int(name.rpartition(" ")[2]))
        scene, view = scene_of(cloud), view_of(view_matrix, lens_of(k, size), size)
    device = open_device()
    renderer = Renderer(device)
    before = resident("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")  # resets the peak
    settings = RenderSettings(sorting="zDepth", color_mode="scene")

    def needed(tiles: int) -> Estimate:
        return estimate(
            scene,
            view,
            settings,
            PictureRequest(aovs=AOVS),
            band_pixels=tiles * TILE * size[0],
            threads=device.threads,
        )

    tiles = max(1, min(BAND_PIXELS // size[0] // TILE, -(-size[1] // TILE)))
    said, limit = needed(tiles), 0.0
    if is_limited:
        limit = (said.total + needed(1).total) / 2
        tiles, said = fitting(needed, tiles, int(limit))
    for _ in renderer.render(scene, view, settings, AOVS, band_pixels=tiles * TILE * size[0]):
        pass
    mib = 1 << 20
    peak = resident("VmHWM")
    print(f"{scene.splat_count} {before} {said.total / mib} {limit / mib} {peak}")


def main(report: Report) -> None:
    """Print the table."""
    table = Table(title="highest memory of a frame with depth and ids [MiB]")
    titles = ("scene", "size", "splats", "before", "limit", "said", "peak", "said/peak", "picture")
    for column in titles:
        table.add_column(column, justify="right")
    for name in SCENES:
        for size in SIZES:
            for words in ((), ("limited",)):
                text = f"{size[0]}x{size[1]}"
                command = [sys.executable, "-m", "benchmarks.memory", "--one", name, text, *words]
                run = subprocess.run(command, capture_output=True, text=True, check=True)
                splats, *numbers = run.stdout.split()
                before, said, limit, peak = map(float, numbers)
                table.add_row(
                    name, text, f"{int(splats):,}", f"{before:.0f}",
                    f"{limit:.0f}" if limit else "none", f"{said:.0f}", f"{peak:.0f}",
                    f"{said / peak:.2f}", f"{size[0] * size[1] * 28 / 2**20:.0f}",
                )  # fmt: skip
    report.show(table)


if __name__ == "__main__":
    if "--one" in sys.argv:
        _, _, name, size, *limited = sys.argv
        width, _, height = size.partition("x")
        one(name, (int(width), int(height)), is_limited=bool(limited))
    else:
        with Report("memory", sys.argv[1:]) as report:
            main(report)
