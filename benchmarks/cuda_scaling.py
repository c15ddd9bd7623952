"""Measure how a frame on the GPU scales with visible and with stored splats.

    python -m benchmarks.cuda_scaling [--json FILE] [MILLIONS]

The garden is tiled until it has the given number of splats, 50 million by default. Tiles are added
either around the camera, so that more and more splats are visible, or behind it, so that no more
are. 1920x1080, degree 0, as floats and packed; times as in `benchmarks.cuda_frame`.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
from rich.table import Table

from benchmarks.cuda_frame import memory, timed
from benchmarks.cuda_scenes import Scene, group_of, tiled
from benchmarks.report import Report
from usdsplat.core.cloud import SplatCloud
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.frame.picture import FramePicture

SIZE = (1920, 1080)
GRIDS = (1, 3, 5, 7, 9, 13, 17, 21)
PERIOD = 4.0
"""Distance between tiles [scene unit]."""


def behind(count: int) -> Scene:
    """Return the garden with copies behind the camera, in rows."""
    one = tiled(1, 0)
    back = -one.matrix[2, :3] / np.linalg.norm(one.matrix[2, :3])
    across = one.matrix[0, :3]
    numbers = np.arange(count)
    far = 20.0 + PERIOD * (numbers // 32)[:, None]
    shifts = far * back + PERIOD * (numbers % 32 - 15.5)[:, None] * across
    shifts = np.concatenate([np.zeros((1, 3)), shifts]).astype(np.float32)
    cloud = one.cloud
    copies = len(shifts)
    return replace(
        one,
        name="most behind the camera",
        cloud=SplatCloud(
            positions=(cloud.positions[None] + shifts[:, None]).reshape(-1, 3),
            scales=np.tile(cloud.scales, (copies, 1)),
            rotations=np.tile(cloud.rotations, (copies, 1)),
            opacities=np.tile(cloud.opacities, copies),
            sh=np.tile(cloud.sh, (copies, 1, 1)),
        ),
    )


def main() -> None:
    """Print the table."""
    with Report("scaling", sys.argv[1:]) as report:
        most = 1e6 * float(report.arguments[0] if report.arguments else 50)
        device = CudaDevice()
        table = Table(title="one frame on the GPU, 1920×1080: event ms, median (least–most)")
        for name in ("scene", "form", "splats", "seen", "pairs", "ms", "frames/s", "MiB"):
            table.add_column(name, justify="right")
        for grid in GRIDS:
            for make in (lambda g=grid: tiled(g, 0), lambda g=grid: behind(g * g - 1)):
                scene = make()
                if len(scene.cloud) > most:
                    continue
                if scene.name != "most behind the camera":
                    scene = replace(scene, name="garden tiled around the camera")
                for packed in (False, True):
                    one_size(report, table, device, scene, packed)
        report.show(table, 160)


def one_size(report: Report, table: Table, device: CudaDevice, scene: Scene, packed: bool) -> None:
    """Add one line to the table."""
    group, view = group_of(device, scene.cloud, packed=packed), scene.view(*SIZE)
    picture = FramePicture(device)

    def draw() -> float:
        picture.draw([group], view)
        return 0.0

    ms, low, high, _ = timed(device, draw)
    taken = memory(device, group, picture)
    form = "packed" if packed else "float"
    report.add(
        device="cuda, packed" if packed else "cuda", scene=scene.name, splats=len(scene.cloud),
        visible=picture.visible, size="{}x{}".format(*SIZE), ms=ms, low=low, high=high,
        pairs=picture.pairs, bytes=taken,
    )  # fmt: skip
    cells = (
        scene.name, form, f"{len(scene.cloud):,}", f"{picture.visible:,}", f"{picture.pairs:,}",
        f"{ms:.3f} ({low:.3f}–{high:.3f})", f"{1e3 / ms:.0f}", f"{taken / 2**20:,.0f}",
    )  # fmt: skip
    print(*cells, flush=True)
    table.add_row(*cells)


if __name__ == "__main__":
    main()
