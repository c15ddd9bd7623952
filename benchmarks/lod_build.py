"""Measure what building a splat tree costs, and where.

    python -m benchmarks.lod_build [CAPTURE [SPLATS]]

The world is a field of varied copies of a capture, at degree 0 and at degree 3, as a packed stage.
Cells are processor time of all threads, in microseconds for each splat of the world. Peak memory is
that of a process of its own, without the making of the world.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd
from rich.table import Table

from benchmarks.memory import resident
from benchmarks.report import Report
from benchmarks.scenes import DATA
from usdsplat import formats, schema
from usdsplat.core import edit
from usdsplat.core.cloud import SplatCloud
from usdsplat.interchange.lod import LodOptions, build_tree, nodes
from usdsplat.interchange.lod.options import MEMORY

SPLATS = 1_000_000
CAPTURE = "pod.spz"
STEPS = (
    "reading", "sorting splats", "merging", "building levels", "measuring errors", "writing", "all",
)  # fmt: skip


class Steps:
    """Progress that adds up processor time by step."""

    def __init__(self) -> None:
        self.spent: Counter[str] = Counter()
        self._label, self._since = "reading", time.process_time()

    def step(self, label: str, done: int, total: int) -> None:
        """Count the time since the last call for the step that was going on."""
        now = time.process_time()
        self.spent[self._label] += now - self._since
        self._since = now
        self._label = "reading" if label.startswith("reading") else label


def world(capture: str, degree: int, splats: int) -> SplatCloud:
    """Return turned and scaled copies of a capture, side by side."""
    cloud = edit.with_sh_degree(formats.read(DATA / "splats" / capture).cloud, degree)
    rng, copies = np.random.default_rng(0), -(-splats // len(cloud))
    side, size = int(np.ceil(np.sqrt(copies))), 2 * np.abs(cloud.positions).max(axis=0).mean()
    parts = []
    for copy in range(copies):
        turn, scale = rng.uniform(0, 2 * np.pi), rng.uniform(0.7, 1.3)
        matrix = np.eye(4)
        sine, cosine = scale * np.sin(turn), scale * np.cos(turn)
        matrix[:3, :3] = [[cosine, 0, sine], [0, scale, 0], [-sine, 0, cosine]]
        matrix[:3, 3] = size * (copy % side), 0, size * (copy // side)
        parts.append(edit.transform(cloud, matrix))
    return edit.take(edit.merge(parts), np.arange(splats))


def write_world(path: Path, capture: str, degree: int, splats: int) -> None:
    """Write a world as a packed stage."""
    stage = Usd.Stage.CreateNew(str(path))
    cloud = world(capture, degree, splats)
    stage.SetDefaultPrim(schema.author(stage, "/world", cloud, form="packed"))
    stage.GetRootLayer().Save()


def measured(world: Path, memory: int) -> dict[str, Any]:
    """Build a tree in this process, and return its costs."""
    steps, merging = Steps(), [0.0]
    merge = nodes.level

    def timed(*args: Any, **options: Any) -> Any:
        start = time.process_time()
        found = merge(*args, **options)
        merging[0] += time.process_time() - start
        return found

    nodes.level = timed
    start = time.process_time()
    options = LodOptions(memory_limit=memory)
    try:
        report = build_tree(world, world.with_name("tree.usda"), options=options, progress=steps)
    finally:
        nodes.level = merge
    total = time.process_time() - start
    steps.step("", 0, 0)
    levels = steps.spent["building levels"] - merging[0]
    spent = {**steps.spent, "building levels": levels, "merging": merging[0], "all": total}
    peak = resident("VmHWM")
    return {"spent": spent, "peak": peak, "ratio": report.size / report.leaf_size}


def main(report: Report) -> None:
    """Print the table."""
    capture = report.arguments[0] if report.arguments else CAPTURE
    splats = int(float(report.arguments[1])) if len(report.arguments) > 1 else SPLATS
    table = Table(title=f"a tree of {splats:,} splats, copies of {capture}: CPU µs/splat")
    for column in ("degree", "memory limit", *STEPS, "peak [MiB]", "bytes / leaves"):
        table.add_column(column)
    for degree in (0, 3):
        for memory in (MEMORY, 1 << 30):
            with tempfile.TemporaryDirectory() as folder:
                world = Path(folder) / "world.usdc"
                write_world(world, capture, degree, splats)
                command = [sys.executable, "-m", "benchmarks.lod_build", "--one", str(world)]
                run = subprocess.run([*command, str(memory)], capture_output=True, check=True)
            found = json.loads(run.stdout)
            cells = [1e6 * found["spent"].get(step, 0.0) / splats for step in STEPS]
            told = [f"{cell:.2f}" for cell in cells]
            row = (str(degree), f"{memory >> 30} GiB", *told, f"{found['peak']:.0f}")
            table.add_row(*row, f"{found['ratio']:.3f}")
            scene = f"{capture} degree {degree} {memory >> 30} GiB"
            report.add(scene=scene, splats=splats, cpu_ms=1e3 * found["spent"]["all"])
    report.show(table)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        sys.stdout.write(json.dumps(measured(Path(sys.argv[2]), int(sys.argv[3]))))
    else:
        with Report("lod_build", sys.argv[1:]) as report:
            main(report)
