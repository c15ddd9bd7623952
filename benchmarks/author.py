"""Measure the time from a .ply to a saved stage, in each form.

    python -m benchmarks.author [SPLATS]

The floor is the time in which this machine reads the source's bytes and writes the stage's bytes
without any format.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.report import Report
from usdsplat import formats
from usdsplat.core.cloud import SplatCloud
from usdsplat.interchange import import_capture
from usdsplat.interchange.options import ImportOptions
from usdsplat.schema import Form

FORMS: tuple[Form, ...] = ("float", "half", "packed")
REPEATS = 3


def capture(count: int) -> SplatCloud:
    """Return random splats of degree 3 with a fixed seed."""
    rng = np.random.default_rng(0)
    q = rng.normal(size=(count, 4)).astype(np.float32)
    return SplatCloud(
        positions=rng.normal(size=(count, 3)).astype(np.float32),
        scales=np.exp(rng.normal(-5, 1, (count, 3))).astype(np.float32),
        rotations=q / np.linalg.norm(q, axis=1, keepdims=True),
        opacities=rng.random(count, dtype=np.float32),
        sh=rng.normal(0, 0.1, (count, 16, 3)).astype(np.float32),
    )


def seconds(action: object, *args: object) -> tuple[float, float]:
    """Return the median wall and CPU seconds of a call."""
    assert callable(action)
    spent = []
    for _ in range(REPEATS):
        wall, cpu = time.perf_counter(), time.process_time()
        action(*args)
        spent.append((time.perf_counter() - wall, time.process_time() - cpu))
    wall, cpu = np.median(spent, axis=0)
    return float(wall), float(cpu)


def copy(source: Path, target: Path, size: int) -> None:
    """Read the source and write `size` bytes: the floor."""
    data = source.read_bytes()
    target.write_bytes((data * (size // len(data) + 1))[:size] if size > len(data) else data[:size])


def main(report: Report, count: int = 1_000_000) -> None:
    """Print the table."""
    table = Table(title=f"{count:,} splats of degree 3, .ply to .usdc: median of {REPEATS}")
    for name in ("form", "wall s", "CPU s", "floor s", "× floor", "MB", "bytes a splat"):
        table.add_column(name, justify="right")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        source = folder / "capture.ply"
        formats.write(capture(count), source)
        for form in FORMS:
            target = folder / f"{form}.usdc"

            def run(target: Path = target, form: Form = form) -> None:
                import_capture(source, target, options=ImportOptions(form=form))

            wall, cpu = seconds(run)
            size = target.stat().st_size
            floor, _ = seconds(copy, source, folder / "floor", size)
            table.add_row(
                form, f"{wall:.2f}", f"{cpu:.2f}", f"{floor:.2f}", f"{wall / floor:.1f}",
                f"{size / 1e6:.0f}", f"{size / count:.0f}",
            )  # fmt: skip
    report.show(table)


if __name__ == "__main__":
    with Report("author", sys.argv[1:]) as report:
        main(report, *map(int, report.arguments))
