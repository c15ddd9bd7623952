"""Measure the cost of each AOV or setting relative to plain colour, and of a deep file to a flat
one.

    python -m benchmarks.passes [plain | deep] [--device cpu | cuda] [--json FILE] [scene ...]

1920x1080, all in one run, with pictures taking turns; medians. Times are those of whole pictures,
including everything: splats are projected again for each, and pixels are copied to the host.
`plain` prints only the first table, `deep` the second. Scenes are SCENES, without those that the
test data lack, and `noise`, which needs no data.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.report import Report
from benchmarks.scenes import DATA, afresh, capture, garden, scaled, scene_of, view_of
from usdsplat.core.cloud import SplatCloud
from usdsplat.images import open_writer
from usdsplat.images.deep import DeepBand, DeepWriter
from usdsplat.images.layout import ImageLayout
from usdsplat.kernels.devices import open_device
from usdsplat.render.renderer import AOVS, Renderer
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import InstanceSpec, MeshSpec, View

SIZE = (1920, 1080)
SCENES = ("garden", "statue_angel.sog", "playbot_lod2.sog", "flowers_lod2_0.sog")
REPEATS = 3
PLAIN = RenderSettings(sorting="zDepth", color_mode="scene")
ERRORS = (0.0, 0.001, 0.01)
LAYOUT = ImageLayout(resolution=SIZE)
NUMBERS = itertools.count()
"""Numbers of pictures, so that no picture reuses results of the one before."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Spent:
    """Time of a picture [ms]."""

    wall: float
    cpu: float


def measured(actions: dict[str, Callable[[], object]]) -> dict[str, Spent]:
    """Return the medians of actions that take turns, after one call of each."""
    spent: dict[str, list[tuple[float, float]]] = {name: [] for name in actions}
    for turn in range(REPEATS + 1):
        for name, action in actions.items():
            wall, cpu = time.perf_counter(), time.process_time()
            action()
            if turn:
                passed = time.perf_counter() - wall, time.process_time() - cpu
                spent[name].append(passed)
    medians = {name: 1e3 * np.median(times, axis=0) for name, times in spent.items()}
    return {name: Spent(wall=float(wall), cpu=float(cpu)) for name, (wall, cpu) in medians.items()}


def is_there(name: str) -> bool:
    """Return whether the test data have a scene."""
    return (DATA / ("garden/scene.npz" if name == "garden" else f"splats/{name}")).is_file()


def noise() -> tuple[RenderScene, View]:
    """Return as many splats as the garden has, at random positions in front of the camera."""
    rng = np.random.default_rng(0)
    n = 138_766
    turns = rng.normal(size=(n, 4))
    cloud = SplatCloud(
        positions=rng.normal(0, 1, (n, 3)).astype(np.float32),
        scales=np.exp(rng.normal(-4.6, 0.6, (n, 3))).astype(np.float32),
        rotations=(turns / np.linalg.norm(turns, axis=1, keepdims=True)).astype(np.float32),
        opacities=rng.uniform(0.02, 1, n).astype(np.float32),
        sh=rng.normal(0, 0.3, (n, 1, 3)).astype(np.float32),
    )
    matrix, k = np.eye(4), np.diag([1100.0, 1100.0, 1.0])
    matrix[2, 3] = 3.5
    k[:2, 2] = SIZE[0] / 2, SIZE[1] / 2
    return scene_of(cloud), view_of(matrix, k, SIZE)


def opened(name: str) -> tuple[RenderScene, View]:
    """Return one of SCENES, or noise, with its view."""
    if name == "noise":
        return noise()
    if name == "garden":
        cloud, matrix, k = garden()
        return scene_of(cloud), view_of(matrix, k, SIZE)
    scene, matrix, k = capture(name)
    return scene, view_of(matrix, scaled(k, SIZE[1] / 480), SIZE)


def add_wall(scene: RenderScene, view: View, renderer: Renderer) -> None:
    """Add a wall of 20,000 triangles through the middle of the visible scene."""
    depth = np.concatenate(
        [band.arrays["depth"].copy() for band in renderer.render(scene, view, PLAIN, ("depth",))]
    )
    middle = float(np.median(depth[np.isfinite(depth)]))
    n = 100
    side = np.linspace(-0.5, 0.5, n + 1)
    x, y = (middle * axis.ravel() for axis in np.meshgrid(side, side))
    at = np.arange(n)[:, None] * (n + 1) + np.arange(n)
    a, b, c, d = at, at + 1, at + n + 2, at + n + 1
    corners = np.stack([a, b, c, a, c, d], axis=-1)
    to_world = np.linalg.inv(np.reshape(view.camera.world_to_camera, (4, 4)))
    local = np.stack([x, y, np.full_like(x, -middle), np.ones_like(x)])
    triangles = corners.reshape(-1, 3).astype(np.int32)
    spec = MeshSpec(
        points=(to_world @ local)[:3].T.astype(np.float32),
        triangles=triangles,
        faces=np.arange(len(triangles), dtype=np.int32),
    )
    scene.set_mesh("/wall", spec)
    scene.set_instances("/wall", (InstanceSpec(path="/wall"),))


def draw(
    renderer: Renderer,
    scene: RenderScene,
    view: View,
    settings: RenderSettings,
    aovs: tuple[str, ...],
) -> None:
    """Draw a picture and discard it, each with a slightly different camera."""
    for _ in renderer.render(scene, afresh(view, next(NUMBERS)), settings, aovs):
        pass


def show_passes(device: str, scenes: Sequence[str], report: Report) -> None:
    """Print the cost of each AOV and setting."""
    title = f"{SIZE[0]}x{SIZE[1]}, median of {REPEATS}: wall ms, CPU ms, CPU ÷ plain's"
    rows: dict[str, list[str]] = {}
    name_of_device = ""
    for name in scenes:
        renderer = Renderer(open_device(device))
        name_of_device = renderer.device
        scene, view = opened(name)
        walled, _ = opened(name)
        add_wall(walled, view, renderer)
        of_plain = partial(draw, renderer, scene, view)
        by_camera = replace(PLAIN, sorting="cameraDistance")
        by_ray_hit = replace(PLAIN, sorting="rayHitDistance")
        spent = measured(
            {
                "plain: zDepth, colour": partial(of_plain, PLAIN, ("color",)),
                "cameraDistance": partial(of_plain, by_camera, ("color",)),
                "rayHitDistance": partial(of_plain, by_ray_hit, ("color",)),
                "a mesh through it": partial(draw, renderer, walled, view, PLAIN, ("color",)),
                "+ Z and ids": partial(
                    of_plain, PLAIN, ("color", "depth", "primId", "instanceId", "elementId")
                ),
                "+ N": partial(of_plain, PLAIN, ("color", "Neye")),
                "+ albedo": partial(of_plain, PLAIN, ("color", "albedo")),
                "+ CryptoObject": partial(of_plain, PLAIN, ("color", "cryptoObject")),
                "+ motion": partial(of_plain, PLAIN, ("color", "motionForward")),
                "16 samples": partial(of_plain, replace(PLAIN, samples=16), ("color",)),
                "all AOVs": partial(of_plain, PLAIN, AOVS),
                "all AOVs, mesh, rayHitDistance": partial(
                    draw, renderer, walled, view, by_ray_hit, AOVS
                ),
            }
        )
        plain = next(iter(spent.values()))
        for what, now in spent.items():
            ratio = now.cpu / plain.cpu
            rows.setdefault(what, []).append(f"{now.wall:.1f}  {now.cpu:.0f}  {ratio:.2f}")
    table = Table(title=f"{name_of_device}, {title}")
    table.add_column("")
    for name in scenes:
        table.add_column(name, justify="right")
    for what, cells in rows.items():
        table.add_row(what, *cells)
    report.show(table, 110)


def write_flat(renderer: Renderer, scene: RenderScene, view: View, path: Path) -> None:
    """Draw a picture into an EXR."""
    with open_writer(path, LAYOUT) as writer:
        for band in renderer.render(scene, afresh(view, next(NUMBERS)), PLAIN, ("color",)):
            writer.write_band(band.y0, band.arrays)


def write_deep(
    renderer: Renderer, scene: RenderScene, view: View, path: Path, settings: RenderSettings
) -> None:
    """Draw a deep picture into an EXR."""
    with DeepWriter(path, LAYOUT, merged=settings.deep_error > 0) as writer:
        for y0, _, samples in renderer.render_deep(scene, afresh(view, next(NUMBERS)), settings):
            band = DeepBand(
                counts=samples.counts,
                depth=samples.depth,
                depth_back=samples.depth_back,
                color=samples.color,
            )
            writer.write_band(y0, band)


def draw_deep(renderer: Renderer, scene: RenderScene, view: View, settings: RenderSettings) -> int:
    """Draw a deep picture without writing it. Return its samples."""
    return sum(
        len(samples.depth)
        for _, _, samples in renderer.render_deep(scene, afresh(view, next(NUMBERS)), settings)
    )


def show_deep(device: str, scenes: Sequence[str], report: Report) -> None:
    """Print the cost of a deep file."""
    table = Table(title=f"{SIZE[0]}x{SIZE[1]}, median of {REPEATS} [wall s], and CPU ÷ flat's")
    for name in (
        "scene", "file", "draw", "÷ flat", "CPU ÷", "draw and write", "÷ flat", "samples a pixel",
        "MiB",
    ):  # fmt: skip
        table.add_column(name, justify="right")
    with tempfile.TemporaryDirectory() as folder:
        for name in scenes:
            renderer = Renderer(open_device(device))
            scene, view = opened(name)
            flat = Path(folder) / "flat.exr"
            drawing = partial(draw, renderer, scene, view, PLAIN, ("color",))
            actions: dict[str, Callable[[], object]] = {"flat": drawing}
            actions["flat file"] = partial(write_flat, renderer, scene, view, flat)
            paths = {"flat": flat}
            samples: dict[str, int] = {}

            for error in ERRORS:
                settings = replace(PLAIN, deep_error=error)
                what = f"deep, error {error:g}"
                paths[what] = Path(folder) / f"{error:g}.exr"
                actions[what] = partial(draw_deep, renderer, scene, view, settings)
                samples[what] = draw_deep(renderer, scene, view, settings)
                actions[f"{what} file"] = partial(
                    write_deep, renderer, scene, view, paths[what], settings
                )
            spent = measured(actions)
            for what, path in paths.items():
                drawn, written = spent[what].wall, spent[f"{what} file"].wall
                table.add_row(
                    name, what, f"{drawn / 1e3:.3f}", f"{drawn / spent['flat'].wall:.1f}",
                    f"{spent[what].cpu / spent['flat'].cpu:.1f}",
                    f"{written / 1e3:.3f}", f"{written / spent['flat file'].wall:.1f}",
                    f"{samples[what] / (SIZE[0] * SIZE[1]):.1f}" if what in samples else "",
                    f"{path.stat().st_size / 2**20:.0f}",
                )  # fmt: skip
            table.add_section()
    report.show(table, 110)


def main(arguments: list[str]) -> None:
    """Print both tables, or the second one."""
    with Report("passes", arguments) as report:
        options = argparse.ArgumentParser()
        options.add_argument("--device", default="auto")
        options.add_argument("what", nargs="*")
        given = options.parse_intermixed_args(report.arguments)
        tables = {"plain": show_passes, "deep": show_deep}
        asked = [name for name in given.what if name not in tables]
        there = asked or [name for name in SCENES if is_there(name)] or ["noise"]
        for name in [name for name in tables if name in given.what] or tables:
            tables[name](given.device, there, report)


if __name__ == "__main__":
    main(sys.argv[1:])
