"""Compare the time of a picture on the CPU with other renderers that need no GPU, in one run.

    python -m benchmarks.peers        installs them, once
    python -m benchmarks.renderers [--grid 1] [--size 1920x1080] [--json FILE] [--pictures FOLDER]

All renderers draw the garden from its camera 0 (with square pixels), take turns, and are warm. The
pictures are compared with our float64 reference, so that speed never hides a wrong picture. They
are also written to FOLDER, to be looked at. Our camera rotates slightly from picture to picture,
and each picture starts from the splats. The other cameras are static, so that the time of
PlayCanvas includes neither the sort, which a worker does, nor reading the picture back. Processor
times are those of all processes of a peer.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks import peers
from benchmarks.peers.server import Server
from benchmarks.report import Report, spread
from benchmarks.scenes import garden, lens_of, scene_of, view_of
from usdsplat import formats
from usdsplat.core.cloud import F64, SplatCloud
from usdsplat.kernels import reference
from usdsplat.kernels.devices import open_device
from usdsplat.render.band import Band
from usdsplat.render.renderer import Renderer
from usdsplat.render.settings import RenderSettings

SETTINGS = RenderSettings(sorting="zDepth", color_mode="display")
ROUNDS = 7
HAIR = 1e-5
"""Rotation of the camera from picture to picture [radian]: less than a fiftieth of a pixel."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shot:
    """Scene and camera of the comparison."""

    name: str
    cloud: SplatCloud
    view: F64
    """World to camera, OpenCV's axes."""
    k: F64
    """Intrinsics with square pixels and the axis in the middle [pixel]."""
    size: tuple[int, int]


@dataclass(slots=True, kw_only=True)
class Contestant:
    """A renderer and its measurements."""

    name: str
    draw: Callable[[], float]
    """Function that draws once and returns wall ms."""
    cpu: Callable[[], float]
    """Function that returns the processor seconds so far."""
    picture: Callable[[], F64]
    """Function that returns the picture of the first camera: colours on black, shape (h, w, 3)."""
    wall_ms: list[float] = field(default_factory=list)
    cpu_ms: list[float] = field(default_factory=list)

    def turn(self) -> None:
        """Draw once and record the times."""
        before = self.cpu()
        self.wall_ms.append(self.draw())
        self.cpu_ms.append(1e3 * (self.cpu() - before))


def shot_of(grid: int, size: tuple[int, int]) -> Shot:
    """Return the garden, tiled."""
    cloud, view, k = garden(grid)
    k = lens_of(k, size)
    k[0, 0] = k[1, 1]
    return Shot(
        name=f"garden {grid}×{grid}", cloud=cloud, view=view.astype(np.float64), k=k, size=size
    )


def turned(view: F64, angle: float) -> F64:
    """Return the camera after a rotation about its y axis."""
    c, s = np.cos(angle), np.sin(angle)
    about = np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]])
    return about @ view


def ours(shot: Shot) -> tuple[Contestant, Renderer]:
    """Return our renderer as a contestant, and the renderer itself for its statistics."""
    renderer = Renderer(open_device("cpu"))
    scene = scene_of(shot.cloud)
    drawn = 0

    def bands(angle: float) -> Iterator[Band]:
        view = view_of(turned(shot.view, angle), shot.k, shot.size)
        return renderer.render(scene, view, SETTINGS, ("color",))

    def picture() -> F64:
        color = np.concatenate([band.arrays["color"].copy() for band in bands(0.0)])
        return color[..., :3]

    def draw() -> float:
        nonlocal drawn
        drawn += 1
        start = time.perf_counter()
        for _ in bands(HAIR * drawn):  # not copied, as the others' pictures are not copied either
            pass
        return 1e3 * (time.perf_counter() - start)

    who = Contestant(name="usdsplat", draw=draw, cpu=time.process_time, picture=picture)
    return who, renderer


def peer(server: Server, name: str, shot: Shot, ply: Path, suffix: str, **more: str) -> Contestant:
    """Return a peer that has opened the scene."""
    size, view, k = list(shot.size), shot.view.tolist(), shot.k.tolist()
    version = server.ask(do="open", ply=str(ply), view=view, k=k, size=size, **more)["version"]
    target = ply.with_name(f"{name.split()[0]}{suffix}")

    def picture() -> F64:
        server.ask(do="save", path=str(target))
        codes = np.load(target) if suffix == ".npy" else _read(target)
        return codes[..., :3] / 255.0

    def draw() -> float:
        return float(server.ask(do="draw")["ms"])

    title = name.replace(" ", f" {version}, ", 1)
    return Contestant(name=title, draw=draw, cpu=server.cpu_seconds, picture=picture)


def contestants(shot: Shot, folder: Path, stack: ExitStack) -> tuple[list[Contestant], Renderer]:
    """Return all available contestants, ours first, each after a first picture."""
    first, renderer = ours(shot)
    all_of_them = [first]
    ply = folder / "scene.ply"
    formats.write(shot.cloud, ply)
    if server := peers.playcanvas():
        stack.callback(server.close)
        browser = {"modules": str(peers.node_modules()), "browser": str(peers.browser())}
        all_of_them.append(peer(server, "PlayCanvas SwiftShader", shot, ply, ".png", **browser))
    if server := peers.open3d():
        stack.callback(server.close)
        all_of_them.append(peer(server, "Open3D lavapipe", shot, ply, ".npy"))
    for _ in range(2):
        for who in all_of_them:
            who.draw()
    return all_of_them, renderer


def truth(shot: Shot) -> F64:
    """Return the colours of the float64 reference, shape (h, w, 3)."""
    lens = reference.Lens(
        world_to_camera=shot.view, focal=(shot.k[0, 0], shot.k[1, 1]),
        center=(shot.k[0, 2], shot.k[1, 2]), size=shot.size,
    )  # fmt: skip
    color: F64 = reference.render([(shot.cloud, np.eye(4))], lens).color
    return color[..., :3]


def _read(path: Path) -> Any:
    from PIL import Image

    return np.asarray(Image.open(path))


def _write(path: Path, picture: F64) -> None:
    from PIL import Image

    codes = np.clip(picture * 255 + 0.5, 0, 255).astype(np.uint8)
    Image.fromarray(codes).save(path)


def psnr(a: F64, b: F64) -> float:
    """Return the peak signal-to-noise ratio [dB] of two pictures for a peak of 1."""
    return float(-10 * np.log10(np.mean((a - b) ** 2)))


def compare(shot: Shot, report: Report, pictures: Path | None) -> None:
    """Let all contestants draw, and print the table."""
    expected = truth(shot)
    size = f"{shot.size[0]}x{shot.size[1]}"
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        drawing, renderer = contestants(shot, Path(name), stack)
        for _ in range(ROUNDS):
            for who in drawing:
                who.turn()
        table = Table(title=f"{shot.name}, {len(shot.cloud):,} splats, {size}: {ROUNDS} rounds")
        titles = ("wall ms", "min–max", "CPU ms", "wall × ours", "CPU × ours", "dB", "dB to ours")
        table.add_column("renderer")
        for title in titles:
            table.add_column(title, justify="right")
        drawn = {who.name: np.asarray(who.picture(), np.float64) for who in drawing}
        base_wall, base_cpu = (np.median(t) for t in (drawing[0].wall_ms, drawing[0].cpu_ms))
        for who in drawing:
            row: dict[str, Any] = spread(who.wall_ms)
            cpu, db = float(np.median(who.cpu_ms)), psnr(drawn[who.name], expected)
            apart = "" if who is drawing[0] else f"{psnr(drawn[who.name], drawn['usdsplat']):.1f}"
            table.add_row(
                who.name, f"{row['ms']:.0f}", f"{row['low']:.0f}–{row['high']:.0f}", f"{cpu:.0f}",
                f"{row['ms'] / base_wall:.1f}", f"{cpu / base_cpu:.1f}", f"{db:.1f}", apart,
            )  # fmt: skip
            report.add(
                device="cpu" if who is drawing[0] else who.name, scene=shot.name,
                splats=len(shot.cloud), visible=renderer.stats.visible, size=size, **row,
                cpu_ms=cpu, db=db,
            )  # fmt: skip
            if pictures is not None:
                pictures.mkdir(parents=True, exist_ok=True)
                _write(pictures / f"{who.name.split()[0]}.png", drawn[who.name])
    report.show(table)


def main(report: Report) -> None:
    """Print the comparison."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--grid", type=int, default=1)
    parser.add_argument("--size", default="1920x1080")
    parser.add_argument("--pictures", type=Path)
    options = parser.parse_args(report.arguments)
    for sentence in peers.missing():
        report.say(sentence)
    width, _, height = options.size.partition("x")
    compare(shot_of(options.grid, (int(width), int(height))), report, options.pictures)


if __name__ == "__main__":
    with Report("renderers", sys.argv[1:]) as report:
        main(report)
