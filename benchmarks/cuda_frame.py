"""Measure a frame on the GPU, with gsplat in the same run, and compare the pictures.

    python -m benchmarks.cuda_frame [--quick] [--peers FOLDER] [--json FILE]

Times are those of CUDA events around the whole frame, from resident splats to a resident image: the
median of 20 frames and its spread. "host" is the time that the two launches take in this thread.
gsplat is timed by `gsplat_cuda.py` of FOLDER, if this file and gsplat are available, packed and
unpacked; the faster one counts. dB compares our picture with gsplat's.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.cuda_scenes import NEAR, Scene, captured, group_of, tiled
from benchmarks.report import Report
from benchmarks.scenes import CAPTURES, SHARED
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.frame.groups import FrameGroup, FrameView
from usdsplat.kernels.cuda.frame.picture import FramePicture

SIZES = ((1920, 1080), (3840, 2160))
RUNS = 20
WARM = 3


def timed(device: CudaDevice, call: Callable[[], Any]) -> tuple[float, float, float, float]:
    """Return median, minimum and maximum of the GPU's milliseconds, and the median of the
    host's."""
    from numba import cuda

    for _ in range(WARM):
        call()
    spent, host = [], []
    for _ in range(RUNS):
        begin, end = cuda.event(), cuda.event()
        begin.record(device.stream)
        host.append(call())
        end.record(device.stream)
        end.synchronize()
        spent.append(cuda.event_elapsed_time(begin, end))
    return (*(float(f(spent)) for f in (np.median, min, max)), float(np.median(host)))


def ours(device: CudaDevice, group: FrameGroup, view: FrameView) -> tuple[Any, dict[str, Any]]:
    """Return our picture and its measurements."""
    picture = FramePicture(device)

    def draw() -> float:
        waited = picture.waited
        begin = time.perf_counter()
        picture.draw([group], view)
        return 1e3 * (time.perf_counter() - begin - (picture.waited - waited))

    ms, low, high, host = timed(device, draw)
    image = device.fetch(picture.draw([group], view))
    numbers = {
        "ms": ms, "low": low, "high": high, "host_ms": host, "visible": picture.visible,
        "pairs": picture.pairs, "bytes": memory(device, group, picture),
    }  # fmt: skip
    return image, numbers


def memory(device: CudaDevice, group: FrameGroup, picture: FramePicture) -> int:
    """Return the GPU memory of a frame [byte]: splats, buffers, the image and scratch of the
    sort."""
    splats = sum(int(array.nbytes) for array in (*group.splats, group.boxes))
    return splats + picture.bytes + int(device.primitives.bytes)


class Peer:
    """gsplat, timed by the script in the folder of peers."""

    def __init__(self, script: Path) -> None:
        import torch
        from gsplat import __version__, rasterization

        self._torch, self._draw, self.version = torch, rasterization, __version__
        spec = importlib.util.spec_from_file_location("gsplat_cuda", script)
        assert spec is not None and spec.loader is not None
        self._script = importlib.util.module_from_spec(spec)
        sys.modules["gsplat_cuda"] = self._script
        spec.loader.exec_module(self._script)

    def time(self, scene: Scene, width: int, height: int) -> tuple[Any, dict[str, Any]]:
        """Return its picture (height, width, 3) and its row."""
        cloud = scene.cloud
        arrays = {
            "means": cloud.positions, "quats": cloud.rotations, "scales": cloud.scales,
            "opacities": cloud.opacities,
        }  # fmt: skip
        k, view = scene.k(width, height).astype(np.float32), scene.matrix.astype(np.float32)
        degree = cloud.sh_degree or None
        colors = cloud.sh if degree else np.maximum(0.5 + 0.28209479177387814 * cloud.sh[:, 0], 0)
        colors = colors.astype(np.float32)
        torch = self._torch
        with torch.no_grad():
            row = self._script.time_scene(
                scene.name, arrays, colors, degree, view, k, width, height
            )
            on = [
                torch.from_numpy(np.ascontiguousarray(each)).cuda()
                for each in (*arrays.values(), colors, view[None], k[None])
            ]
            image = self._draw(
                *on, width, height, sh_degree=degree, packed=row["packed"], near_plane=NEAR
            )[0][0]
            return image.cpu().numpy(), row


def scenes(quick: bool) -> list[tuple[str, Callable[[], Scene]]]:
    """Return the scenes by name, as functions that create them when needed."""
    grids = (1,) if quick else (1, 3, 7)
    found: list[tuple[str, Callable[[], Scene]]] = []
    for degree in (0, 3):
        for grid in grids:
            found.append((f"SH {degree}", lambda g=grid, d=degree: tiled(g, d)))
    for name in CAPTURES[:1] if quick else CAPTURES:
        found.append(("", lambda n=name: captured(n)))
    return found


def keep(report: Report, row: dict[str, Any], scene: Scene) -> None:
    """Add the rows of our renderer and the peer to the report."""
    picture = {
        "scene": scene.name, "splats": len(scene.cloud), "visible": row["visible"],
        "size": "{}x{}".format(*row["size"]), "sh": row["sh"],
    }  # fmt: skip
    numbers = {name: row[name] for name in ("ms", "low", "high", "host_ms", "pairs", "bytes")}
    report.add(
        device="cuda" if row["form"] == "float" else "cuda, packed",
        **picture,
        **numbers,
        db_to_gsplat=row["dB"],
    )
    if row["gsplat"] and row["form"] == "float":
        peer = row["gsplat"]
        report.add(
            device=peer["peer"],
            **picture,
            ms=peer["ms"],
            low=peer["ms_min"],
            high=peer["ms_max"],
            is_packed=peer["packed"],
            bytes=1e9 * peer["peak_GB"],
        )


def main(report: Report) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--peers", type=Path, default=SHARED / "peers")
    options = parser.parse_args(report.arguments)
    device = CudaDevice()
    script = options.peers / "gsplat_cuda.py"
    try:
        peer = Peer(script) if script.is_file() else None
    except ImportError:
        peer = None
    table = Table(title="one frame on the GPU: event ms, median (least–most)")
    for name in ("scene", "SH", "size", "form", "seen", "pairs", "ours", "host", "gsplat", "×",
                 "dB", "MiB"):  # fmt: skip
        table.add_column(name, justify="right")
    for _, make in scenes(options.quick):
        scene = make()
        for width, height in SIZES:
            theirs, peer_row = (None, None)
            if peer is not None:
                theirs, peer_row = peer.time(scene, width, height)
            for packed in (False, True):
                group = group_of(device, scene.cloud, packed=packed)
                image, row = ours(device, group, scene.view(width, height))
                decibels = float("nan")
                if theirs is not None:
                    error = np.mean((image[..., :3].astype(np.float64) - theirs) ** 2)
                    decibels = float(-10 * np.log10(error))
                row |= {
                    "scene": scene.name, "sh": scene.cloud.sh_degree, "splats": len(scene.cloud),
                    "size": [width, height], "form": "packed" if packed else "float",
                    "gsplat": peer_row, "dB": decibels,
                }  # fmt: skip
                keep(report, row, scene)
                show(table, row)
                del group
    report.show(table, 160)


def show(table: Table, row: dict[str, Any]) -> None:
    """Add one line to the table, and print it at once."""
    peer = row["gsplat"]
    cells = [
        row["scene"], str(row["sh"]), "{}×{}".format(*row["size"]), row["form"],
        f"{row['visible']:,}", f"{row['pairs']:,}",
        f"{row['ms']:.3f} ({row['low']:.3f}–{row['high']:.3f})", f"{row['host_ms']:.3f}",
        f"{peer['ms']:.3f} ({peer['ms_min']:.3f}–{peer['ms_max']:.3f})" if peer else "",
        f"{peer['ms'] / row['ms']:.2f}" if peer else "", f"{row['dB']:.1f}",
        f"{row['bytes'] / 2**20:.0f}",
    ]  # fmt: skip
    print(*cells, flush=True)
    table.add_row(*cells)


if __name__ == "__main__":
    with Report("cuda_frame", sys.argv[1:]) as report:
        main(report)
