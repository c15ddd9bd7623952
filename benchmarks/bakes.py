"""Measure size and time of a bake in each mode, if a part of a capture moves.

    python -m benchmarks.bakes [SPLATS] [FRAMES]

Frames are made beforehand, so the simulation takes no time. The floor is the time in which this
machine writes as many bytes as the samples have. Reading is `schema.fetch` of all frames from a new
stage, with every number used.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from pxr import Usd
from rich.table import Table

from benchmarks.author import capture
from benchmarks.report import Report
from usdsplat import schema
from usdsplat.core import quaternion
from usdsplat.core.cloud import SplatCloud
from usdsplat.sim.parameters import BakeParameters
from usdsplat.sim.stage.bake import Bake
from usdsplat.sim.stage.plan import BakedField
from usdsplat.sim.stage.provenance import Provenance, input_hash, parameter_hash
from usdsplat.sim.state import Frame

Mode = Literal["dense", "clips", "packed", "edit"]
PATH = "/Splats"
MOVING = 0.05
WRITES = frozenset({"positions", "rotations"})


def frame(rest: SplatCloud, step: int) -> Frame:
    """Return a frame in which the first splats rotate by two degrees per frame and drift."""
    rows = slice(0, int(MOVING * len(rest)))
    positions, rotations = rest.positions.copy(), rest.rotations.copy()
    positions[rows, 1] += np.float32(0.01 * step)
    angle = math.radians(1.0 * step)
    turn = np.array([math.cos(angle), 0, math.sin(angle), 0], np.float32)
    rotations[rows] = quaternion.multiply(turn, rest.rotations[rows])
    n = len(rest)
    cloud = replace(rest, positions=positions, rotations=rotations, ids=np.arange(n))
    zeros = np.zeros((n, 2), np.float32)
    return Frame(time=1.0 + step, cloud=cloud, uv=zeros, births=zeros[:, 0])


def spent(action: Callable[[], object]) -> tuple[float, float]:
    """Return the wall and CPU seconds of a call."""
    wall, cpu = time.perf_counter(), time.process_time()
    action()
    return time.perf_counter() - wall, time.process_time() - cpu


def bake(stage: Usd.Stage, rest: SplatCloud, mode: Mode, target: Path, frames: int) -> float:
    """Bake, and return the wall seconds without the time to make the frames."""
    times = [1.0 + step for step in range(frames)]
    parameters = BakeParameters(mode=mode)
    memory = Provenance(
        param_hash=parameter_hash(stage, times),
        parameters=(),
        input_hash=input_hash(stage),
        seed=0,
        substeps=1,
        dt=1 / 24,
        frame_range=(times[0], times[-1]),
        mode=mode,
        threads=1,
    )
    field = BakedField(path=PATH, rest=rest, writes=WRITES, is_fixed=True)
    total = 0.0
    with Bake.open(stage, target, [field], times, parameters, memory) as opened:
        for step in range(frames):
            made = frame(rest, step)
            total += spent(lambda made=made: opened.write(PATH, made))[0]
        total += spent(opened.close)[0]
    return total


def read(target: Path, frames: int) -> None:
    """Read every number of every frame."""
    stage = Usd.Stage.Open(str(target))
    for step in range(frames):
        cloud = schema.fetch(stage.GetPrimAtPath(PATH), 1.0 + step)
        for array in (cloud.positions, cloud.rotations, cloud.scales, cloud.opacities):
            array.sum()


def main(report: Report, count: int = 1_000_000, frames: int = 24) -> None:
    """Print the table."""
    title = f"{count:,} splats of degree 3, {MOVING:.0%} moving and turning, {frames} frames"
    table = Table(title=title)
    for name in ("mode", "MB a frame", "ms a frame", "floor ms", "× floor", "read ms a frame"):
        table.add_column(name, justify="right")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        stage = Usd.Stage.CreateNew(str(folder / "shot.usdc"))
        schema.author(stage, PATH, capture(count))
        stage.Save()
        rest = schema.fetch(stage.GetPrimAtPath(PATH))
        for mode in get_args(Mode):
            target = folder / f"{mode}.usda"
            wall = bake(stage, rest, mode, target, frames)
            data = target.with_name(f"{mode}_data")
            size = sum(path.stat().st_size for path in data.iterdir())
            floor, _ = spent(lambda size=size: (folder / "floor").write_bytes(bytes(size)))
            reading, _ = spent(lambda target=target: read(target, frames))
            table.add_row(
                mode, f"{size / frames / 1e6:.1f}", f"{wall / frames * 1e3:.0f}",
                f"{floor / frames * 1e3:.1f}", f"{wall / floor:.1f}",
                f"{reading / frames * 1e3:.0f}",
            )  # fmt: skip
            for path in (*data.iterdir(), folder / "floor"):
                path.unlink()
    report.show(table)


if __name__ == "__main__":
    with Report("bakes", sys.argv[1:]) as report:
        main(report, *map(int, report.arguments))
