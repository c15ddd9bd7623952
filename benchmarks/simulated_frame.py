"""Measure a frame of a simulation, from a stage to a bake, by stage of the solver.

    python -m benchmarks.simulated_frame [SPLATS] [FRAMES]

A ball passes a garden and touches a twentieth of it, splats settle behind it, and a labyrinth
pattern grows: 4 substeps and 8 reaction steps per frame, baked dense. Times of a frame are medians
without the first frame; `end` is the time to close the bake, divided by the number of frames. Each
scene has a separate process, so that its peak memory can be measured.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Usd, UsdGeom
from rich.table import Table

from benchmarks.report import Report
from benchmarks.scenes import garden
from usdsplat import schema
from usdsplat.core import edit
from usdsplat.sim.stage.authoring import author
from usdsplat.sim.stage.simulating import simulate

RATE = 24
RADIUS, REACH = 0.5, 2.4
"""Radius of the ball, and its distance to either side [unit]."""
CASES = ((0, "carrier"), (0, "self"), (3, "carrier"))
"""Degree of the harmonics, and domain of the reaction."""


class Frames:
    """Wall and CPU seconds at the end of each frame."""

    def __init__(self) -> None:
        self.ends: list[tuple[float, float]] = []

    def step(self, label: str, done: int, total: int) -> None:
        """Record the time, when called by `simulate`."""
        if label == "simulating" and done > len(self.ends):
            self.ends.append(now())


def now() -> tuple[float, float]:
    """Return the wall and CPU clocks [s]."""
    return time.perf_counter(), time.process_time()


def shot(folder: Path, count: int, degree: int, domain: str, frames: int) -> Usd.Stage:
    """Return the stage to simulate."""
    cloud = garden(3, degree=degree)[0]
    stage = Usd.Stage.CreateNew(str(folder / "capture.usdc"))
    schema.author(stage, "/Garden", edit.take(cloud, np.arange(len(cloud)) < count))
    stage.Save()
    low, high = np.percentile(cloud.positions, (10, 90), axis=0)
    stage = Usd.Stage.CreateNew(str(folder / "shot.usda"))
    stage.GetRootLayer().subLayerPaths.append("./capture.usdc")
    stage.SetTimeCodesPerSecond(RATE)
    sim = stage.DefinePrim("/Sim", "SplatSim")
    sim.CreateRelationship("collection:splats:includes", custom=False).SetTargets(["/Garden"])
    sim.CreateRelationship("collection:affectors:includes", custom=False).SetTargets(["/Ball"])
    author(
        sim,
        {"sim:substeps": 4, "rd:enabled": True, "rd:preset": "labyrinth", "rd:substeps": 8,
         "rd:domain": domain, "settle:omega": 6.0, "bake:mode": "dense"},
    )  # fmt: skip
    ball = UsdGeom.Sphere.Define(stage, "/Ball")
    ball.CreateRadiusAttr(RADIUS)
    author(ball.GetPrim(), {"affector:role": "collide", "affector:blend": 0.02})
    move = ball.AddTranslateOp()
    middle = 0.5 * (low + high)
    for frame, way in ((1, -REACH), (2 * frames, REACH)):
        move.Set(Gf.Vec3d(float(middle[0] + way), *middle[1:].tolist()), frame)
    stage.Save()
    return stage


def measure(count: int, degree: int, domain: str, frames: int) -> dict[str, Any]:
    """Simulate one case."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        stage = shot(folder, count, degree, domain, frames)
        times = [1.0 + step for step in range(frames)]
        progress = Frames()
        report = simulate(stage, folder / "bake.usda", times, progress=progress)
        done = now()
        baked = Usd.Stage.Open(str(folder / "bake.usda"))
        field = baked.GetPrimAtPath("/Garden")
        first, last = (schema.fetch(field, time).positions for time in (times[0], times[-1]))
        size = sum(path.stat().st_size for path in (folder / "bake_data").iterdir())
    steps = np.diff(progress.ends, axis=0)
    end = np.subtract(done, progress.ends[-1]) / frames
    return {
        "splats": len(first),
        "moved": float((first != last).any(axis=1).mean()),
        "frame": np.median(steps, axis=0).tolist(),
        "end": end.tolist(),
        "stages": report.stages,
        "megabytes": report.megabytes,
        "bake": size / frames / 1e6,
    }


def child(*arguments: object) -> dict[str, Any]:
    """Measure in a separate process."""
    command = [sys.executable, "-m", "benchmarks.simulated_frame", "--one", *map(str, arguments)]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    found: dict[str, Any] = json.loads(text.splitlines()[-1])
    return found


def main(report: Report, count: int = 1_000_000, frames: int = 8) -> None:
    """Print the table."""
    child(10_000, 3, "carrier", 3)  # compiles kernels that are not compiled yet
    child(10_000, 0, "self", 3)
    table = Table(title=f"{count:,} splats, {frames} frames: wall s / CPU s a frame")
    for name in (
        "degree",
        "reaction on",
        "moved",
        "frame",
        "end",
        "total",
        "MB a frame",
        "peak MB",
    ):
        table.add_column(name, justify="right")
    notes = []
    for degree, domain in CASES:
        found = child(count, degree, domain, frames)
        (wall, cpu), (wall_end, cpu_end) = found["frame"], found["end"]
        table.add_row(
            str(degree), domain, f"{found['moved']:.1%}", f"{wall:.2f} / {cpu:.2f}",
            f"{wall_end:.2f} / {cpu_end:.2f}", f"{wall + wall_end:.2f} / {cpu + cpu_end:.2f}",
            f"{found['bake']:.1f}", f"{found['megabytes']:,.0f}",
        )  # fmt: skip
        stages = ", ".join(f"{name} {spent:.2f}" for name, spent in found["stages"].items())
        notes.append(f"degree {degree}, {domain}: wall s of the whole run: {stages}")
    report.show(table)
    for note in notes:
        report.say(note)


if __name__ == "__main__":
    if "--one" in sys.argv:
        number, degree, domain, last = sys.argv[2:]
        print(json.dumps(measure(int(number), int(degree), domain, int(last))))
    else:
        with Report("simulated_frame", sys.argv[1:]) as report:
            main(report, *map(int, report.arguments))
