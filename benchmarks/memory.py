"""The highest memory of a frame, each in a process of its own.

    python -m benchmarks.memory

A frame is taken band by band and thrown away, as a file writer takes it. Beside the peak stand what
the process holds before it draws (Python, the libraries, the splats) and what the whole picture
would take, which is never held.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks.scenes import CAPTURES, capture, garden, lens_of, scaled, scene_of, view_of

SIZES = ((960, 720), (1920, 1080), (3840, 2160))
AOVS = ("color", "depth", "primId", "elementId")


def resident(kind: str) -> float:
    """VmRSS or VmHWM of this process [MiB], as Linux counts them."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(kind):
            return int(line.split()[1]) / 1024
    raise LookupError(kind)


def one(name: str, size: tuple[int, int]) -> None:
    """Draw one frame in this process and print what it held before and at most [MiB]."""
    from usdsplat.delegate.render_settings import RenderSettings
    from usdsplat.delegate.renderer import Renderer
    from usdsplat.kernels.device import open_device

    if name in CAPTURES:
        scene, view_matrix, k = capture(name)
        view = view_of(view_matrix, scaled(k, size[1] / 480), size)
    else:
        cloud, view_matrix, k = garden(int(name.rpartition(" ")[2]))
        scene, view = scene_of(cloud), view_of(view_matrix, lens_of(k, size), size)
    renderer = Renderer(open_device())
    before = resident("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")  # the peak counts from here
    settings = RenderSettings(sorting="zDepth", color_mode="scene")
    for _ in renderer.render(scene, view, settings, AOVS):
        pass
    print(f"{scene.splat_count} {before} {resident('VmHWM')}")


def main() -> None:
    """Print the table."""
    table = Table(title="highest memory of a frame with depth and ids [MiB]")
    for column in ("scene", "size", "splats", "before", "peak", "frame", "whole picture"):
        table.add_column(column, justify="right")
    for name in ("garden 1", "garden 7", *CAPTURES):
        for size in SIZES:
            text = f"{size[0]}x{size[1]}"
            command = [sys.executable, "-m", "benchmarks.memory", name, text]
            run = subprocess.run(command, capture_output=True, text=True, check=True)
            splats, before, peak = run.stdout.split()
            table.add_row(
                name, text, f"{int(splats):,}", f"{float(before):.0f}", f"{float(peak):.0f}",
                f"{float(peak) - float(before):.0f}", f"{size[0] * size[1] * 28 / 2**20:.0f}",
            )  # fmt: skip
    Console(width=120).print(table)


if __name__ == "__main__":
    if len(sys.argv) == 3:
        width, _, height = sys.argv[2].partition("x")
        one(sys.argv[1], (int(width), int(height)))
    else:
        main()
