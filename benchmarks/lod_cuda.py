"""Measure pictures of instances of a large splat tree while a camera moves, on the GPU.

    python -m benchmarks.lod_cuda [--tree STAGE] [--splats 100e6] [--leaf 65536] [--instances 160]
        [--device cuda] [--error 1] [--budget 0] [--samples 2] [--size 1920x1080] [--frames 30]
        [--json FILE]

Without a stage, the tree is made in memory: a ground that is divided into quarters down to leaves
of at most `--leaf` splats, whose splats are computed when they are read. Its instances lie side by
side, and the camera flies over them: it stands still, moves slowly, or moves fast. The first
picture reads and uploads; "static" ones follow with the same camera.

Rows are medians per picture [ms]: the whole picture; choosing the cut and reading it, which are
parts of "nodes"; laying the nodes out; and the fused picture, with its parts: the plan, which
includes the copies of new nodes to the GPU, of so many KiB, and the launches. The last column is
the slowest picture. "resident" is the median of the GPU's own time over pictures of the last
camera [ms].
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.report import Report
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.node_table import NODE_SPLATS, NodeTable
from usdsplat.core.sh import rgb_to_dc
from usdsplat.kernels.cuda.frame.picture import FramePicture
from usdsplat.kernels.cuda.frame.pool import NodePool
from usdsplat.kernels.devices import open_device
from usdsplat.render import cuda as cuda_pictures
from usdsplat.render.lod import nodes
from usdsplat.render.lod.tree import TreeSpec
from usdsplat.render.renderer import Renderer
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CameraSpec, Framing, InstanceSpec, View

MOVES = {"first": 0.0, "static": 0.0, "slow": 0.002, "fast": 0.05}
"""Move -> way of the camera in a picture, in sides of a tree."""
ERROR = 0.5
"""Error of a node of the made tree, in distances between its splats."""
ASPECT = 16 / 9


class Ground:
    """A tree over the unit square in x and y, whose splats are computed when they are read."""

    def __init__(self, splats: int, leaf: int) -> None:
        levels = 0
        while splats > leaf * 4**levels:
            levels += 1
        self.size = int(np.ceil(np.sqrt(splats / 4**levels)))
        depth = np.repeat(np.arange(levels + 1), 4 ** np.arange(levels + 1))
        corner, self.n = np.zeros((len(depth), 2)), len(depth)
        for node in range(1, self.n):
            parent, child = (node - 1) // 4, (node - 1) % 4
            corner[node] = corner[parent] + 0.5 ** depth[node] * np.array([child % 2, child // 2])
        self.corner, self.side = corner, 0.5**depth
        spacing = self.side / self.size
        is_leaf, margin = depth == levels, 3 * self.side
        low = np.column_stack([corner, np.full(self.n, -0.02)]) - 0.02 * margin[:, None]
        high = low + np.column_stack([self.side, self.side, np.full(self.n, 0.04)])
        count = self.size**2
        self.table = NodeTable(
            low=low.astype(np.float32),
            high=(high + 0.04 * margin[:, None]).astype(np.float32),
            errors=np.where(is_leaf, 0, ERROR * spacing).astype(np.float32),
            first_child=np.where(is_leaf, 0, 4 * np.arange(self.n) + 1).astype(np.int32),
            child_count=np.where(is_leaf, 0, 4).astype(np.int32),
            chunk=np.arange(self.n, dtype=np.int32),
            first_row=np.zeros(self.n, np.int64),
            proxies=np.full(self.n, count, np.int64),
            residents=np.zeros(self.n, np.int64),
        )

    def load(self, chunk: int, first: int, count: int) -> SplatCloud:
        """Return splats of a node: a jittered grid of flat dots."""
        rng, spacing = np.random.default_rng(chunk), self.side[chunk] / self.size
        rows = np.arange(first, first + count)
        places = np.stack([rows % self.size, rows // self.size], axis=1) + rng.random((count, 2))
        flat = self.corner[chunk] + spacing * places
        height = 0.01 * np.sin(40 * flat[:, :1]) * np.cos(40 * flat[:, 1:])
        return SplatCloud(
            positions=np.hstack([flat, height]).astype(np.float32),
            scales=np.full((count, 3), spacing * np.float32(0.5), np.float32),
            rotations=np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
            opacities=np.full(count, 0.9, np.float32),
            sh=rgb_to_dc(rng.random((count, 1, 3), np.float32)).astype(np.float32),
        )

    def spec(self) -> TreeSpec:
        """Return the tree."""
        return TreeSpec(table=self.table, chunks=tuple(range(self.n)), load=self.load)


def tree_of(stage: str) -> TreeSpec:
    """Return the first splat tree of a stage."""
    from pxr import Usd

    from usdsplat.delegate.engine import Engine

    with Engine(Usd.Stage.Open(stage), device="cpu") as engine:
        _, tree = engine.render_scene.drawn_trees()[0]
        return tree.spec


def placed(spec: TreeSpec, instances: int) -> RenderScene:
    """Return a scene with instances of a tree side by side, each scaled to the unit square."""
    low, high = (each[0].astype(np.float64) for each in (spec.table.low, spec.table.high))
    scale = 1 / (high - low)[:2].max()
    columns = int(np.ceil(np.sqrt(instances)))
    found = []
    for index in range(instances):
        matrix = np.diag([scale, scale, scale, 1.0])
        matrix[:3, 3] = -scale * low + (index % columns - 0.5 * columns, index // columns, 0)
        found.append(InstanceSpec(path="/tree", index=index, transform=tuple(matrix.ravel())))
    scene = RenderScene()
    scene.set_tree("/tree", spec)
    scene.set_instances("/tree", tuple(found))
    return scene


def view_from(way: float, size: tuple[int, int]) -> View:
    """Return a view along +y, slightly down, after a way."""
    eye, tilt = np.array([0.1, way - 0.3, 0.25]), np.radians(20)
    ahead = np.array([0, np.cos(tilt), -np.sin(tilt)])
    right = np.array([1.0, 0, 0])
    matrix = np.eye(4)
    matrix[:3, :3] = right, np.cross(right, ahead), -ahead
    matrix[:3, 3] = -matrix[:3, :3] @ eye
    half = np.tan(np.radians(30))
    camera = CameraSpec(
        world_to_camera=tuple(matrix.ravel()),
        window=(-half * ASPECT, -half, half * ASPECT, half),
        clipping_range=(0.001, 1e4),
    )
    return View(camera=camera, framing=Framing(resolution=size, conform="adjustPixelAspectRatio"))


class Stages:
    """Time of some functions [s], added up by label, and bytes of nodes that are copied to the
    GPU."""

    def __init__(self) -> None:
        self.spent: Counter[str] = Counter()
        self._wrap(nodes, "choose", "choose")
        self._wrap(nodes.PictureNodes, "_read", "read")
        self._wrap(nodes.PictureNodes, "__init__", "nodes")
        self._wrap(nodes.PictureNodes, "layout", "layout")
        self._wrap(cuda_pictures.ColorPicture, "draw", "draw")
        self._wrap(cuda_pictures.ColorPicture, "_planned", "plan")
        self._wrap(NodePool, "_send", "copies", size=_size_of)
        self._wrap(FramePicture, "_finish", "launch")
        self._wrap(FramePicture, "_begin", "launch")

    def _wrap(
        self, owner: Any, name: str, label: str, *, size: Callable[..., int] | None = None
    ) -> None:
        function: Callable[..., Any] = getattr(owner, name)

        def timed(*args: Any, **options: Any) -> Any:
            begin = time.perf_counter()
            try:
                return function(*args, **options)
            finally:
                self.spent[label] += time.perf_counter() - begin
                self.spent["bytes"] += size(*args) if size else 0

        setattr(owner, name, timed)

    def taken(self) -> dict[str, float]:
        """Return what was added up since the last call."""
        found, self.spent = dict(self.spent), Counter()
        return found


def _size_of(pool: NodePool, clouds: object, pages: Sequence[int]) -> int:
    return pool.page_bytes * len(pages)


def resident_ms(device: Any, draw: Callable[[], Any], runs: int) -> float:
    """Return the median of the GPU's time for a picture [ms]; NaN on the CPU."""
    if device.name != "cuda":
        return float("nan")
    from numba import cuda

    spent = []
    for _ in range(runs):
        begin, end = cuda.event(), cuda.event()
        begin.record(device.stream)
        draw()
        end.record(device.stream)
        end.synchronize()
        spent.append(cuda.event_elapsed_time(begin, end))
    return float(np.median(spent))


def main(report: Report) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tree")
    parser.add_argument("--splats", type=float, default=100e6)
    parser.add_argument("--leaf", type=int, default=NODE_SPLATS, help="most splats of a made leaf")
    parser.add_argument("--instances", type=int, default=160)
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--error", type=float, default=1.0)
    parser.add_argument("--budget", type=int, default=0, help="most splats of a cut; 0: any")
    parser.add_argument("--samples", type=int, default=2, help="of coarse levels, along an axis")
    parser.add_argument("--size", default="1920x1080")
    parser.add_argument("--frames", type=int, default=30)
    parser.add_argument("--memory", type=int, default=32768, help="host and device [MiB]")
    options = parser.parse_args(report.arguments)
    width, height = map(int, options.size.split("x"))
    spec = (
        tree_of(options.tree) if options.tree else Ground(int(options.splats), options.leaf).spec()
    )
    scene, device = placed(spec, options.instances), open_device(options.device)
    renderer, stages = Renderer(device), Stages()
    settings = RenderSettings(
        sorting="zDepth",
        color_mode="display",
        lod_error=options.error,
        lod_samples=options.samples,
        splat_budget=options.budget,
        node_memory=options.memory,
        node_lifetime=1e6,
    )
    table = Table(title=f"{spec.captured:,} splats, {options.instances} instances, ms per picture")
    columns = ("whole", "choose", "read", "nodes", "layout", "draw", "plan", "copies", "launch")
    for name in ("move", "splats", "visible", "groups", *columns, "KiB", "worst"):
        table.add_column(name, justify="right")
    way = 0.0
    for move, step in MOVES.items():
        rows = []
        for _ in range(1 if move == "first" else options.frames):
            way += step
            stages.taken()
            begin = time.perf_counter()
            for _ in renderer.render(scene, view_from(way, (width, height)), settings, ("color",)):
                pass
            spent = time.perf_counter() - begin
            found = stages.taken()
            cells = [1e3 * found.get(name, 0.0) for name in columns[1:]]
            rows.append([1e3 * spent, *cells, found.get("bytes", 0) / 1024])
        found = np.median(rows, axis=0)
        groups = sum(len(tree.fields) for _, tree in scene.drawn_trees())
        counts = [f"{n:,}" for n in (renderer.stats.splats, renderer.stats.visible, groups)]
        cells = [f"{each:.2f}" for each in found]
        row = (move, *counts, *cells, f"{np.max(rows, axis=0)[0]:.1f}")
        print(*row, flush=True)
        table.add_row(*row)
        report.add(device=device.name, scene=move, splats=spec.captured, ms=float(found[0]))
    view = view_from(way, (width, height))

    def draw() -> None:
        for _ in renderer.render(scene, view, settings, ("color",)):
            pass

    report.show(table, 160)
    report.say(f"resident: {resident_ms(device, draw, options.frames):.2f} ms between events")


if __name__ == "__main__":
    with Report("lod_cuda", sys.argv[1:]) as report:
        main(report)
