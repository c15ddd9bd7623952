"""Measure a simulation that plays in a window: frames per second without the picture, and memory.

    python -m benchmarks.live [SPLATS] [FRAMES]

Each case has a separate process and runs unpaced. `frame` is the median of all frames but the
first; CPU seconds count all threads. `handed over` is the time to keep a frame as a value, and
`authored` that to author one on the stage, as each frame was before. `values` and `samples` are the
memory of all frames before and after they are authored, and `process` is that of the process before
the run, while it plays, and after it paused. Stages are those of the solver, in wall time of a
frame.
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
from rich.table import Table

from benchmarks.report import Report
from benchmarks.scenes import garden
from usdsplat.core import edit

CASES = ("push", "push rubber", "grow", "dissolve")


def measure(count: int, case: str, frames: int) -> dict[str, Any]:
    """Play one case."""
    from usdsplat import formats
    from usdsplat.core.progress import silent
    from usdsplat.interchange.files import open_stage
    from usdsplat.kernels.devices import open_device
    from usdsplat.preview.simulating.live_layer import LiveLayer
    from usdsplat.products.presets import make_stage
    from usdsplat.render.memory import resident
    from usdsplat.sim.stage.report import Clock
    from usdsplat.sim.stage.simulation import Simulation, baked_fields

    preset, _, material = case.partition(" ")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cloud = garden(3, degree=3)[0]
        chosen = np.random.default_rng(0).random(len(cloud)) < count / len(cloud)
        formats.write(edit.take(cloud, chosen), folder / "a.ply")
        del cloud
        make_stage(
            preset, folder / "a.ply", folder / "shot.usda", axes=None, progress=silent,
            options={"material": material} if material else {},
        )  # fmt: skip
        stage = open_stage(folder / "shot.usda")
        memory = [resident()]
        clock = Clock()
        times = [1.0 + number for number in range(frames)]
        simulation = Simulation(stage, times, device=open_device(), lap=clock.lap)
        layer = LiveLayer(simulation.stage, baked_fields(simulation))
        simulation.begin()
        spent, kept = [], []
        clock.spent.clear()
        for number, frame in enumerate(times):
            began, cpu = time.perf_counter(), time.process_time()
            if number:
                simulation.advance()
            found = {path: simulation.frame(path) for path in simulation.recipes}
            put = time.perf_counter()
            layer.put(frame, found)
            ended = time.perf_counter()
            kept.append(ended - put)
            spent.append((ended - began, time.process_time() - cpu))
            if not number:
                layer.author()
                clock.spent.clear()
                clock.lap("")
        values = layer.size
        memory.append(resident())
        began = time.perf_counter()
        layer.author()
        authored = (time.perf_counter() - began) / (frames - 1)
        memory.append(resident())
        return {
            "splats": sum(len(each.state) for each in simulation.solvers.values()),
            "frame": np.median(spent[1:], axis=0).tolist(),
            "kept": float(np.median(kept[1:])),
            "authored": authored,
            "values": values,
            "samples": layer.size,
            "memory": memory,
            "stages": {k: v / (frames - 1) for k, v in clock.spent.items() if k},
        }


def child(*arguments: object) -> dict[str, Any]:
    """Measure in a separate process."""
    command = [sys.executable, "-m", "benchmarks.live", "--one", *map(str, arguments)]
    text = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
    found: dict[str, Any] = json.loads(text.splitlines()[-1])
    return found


def main(report: Report, count: int = 100_000, frames: int = 12) -> None:
    """Print the table."""
    table = Table(title=f"{count:,} splats of degree 3, {frames} frames, without the picture")
    for name in (
        "case",
        "splats",
        "frame wall / CPU s",
        "frames/s",
        "handed over ms",
        "authored ms",
        "values MB",
        "samples MB",
        "process MB",
    ):
        table.add_column(name, justify="left" if name == "case" else "right")
    notes = []
    for case in CASES:
        child(5_000, case, 3)  # compiles
        found = child(count, case, frames)
        wall, cpu = found["frame"]
        table.add_row(
            case, f"{found['splats']:,}", f"{wall:.3f} / {cpu:.3f}", f"{1 / wall:.1f}",
            f"{1e3 * found['kept']:.1f}", f"{1e3 * found['authored']:.1f}",
            f"{1e-6 * found['values']:,.0f}", f"{1e-6 * found['samples']:,.0f}",
            ", ".join(f"{1e-6 * each:,.0f}" for each in found["memory"]),
        )  # fmt: skip
        long = sorted(found["stages"].items(), key=lambda item: -item[1])[:5]
        notes.append(f"{case}: " + ", ".join(f"{name} {spent:.3f} s" for name, spent in long))
    report.show(table)
    for note in notes:
        report.say(note)


if __name__ == "__main__":
    if "--one" in sys.argv:
        number, case, last = sys.argv[2:]
        print(json.dumps(measure(int(number), case, int(last))))
    else:
        with Report("live", sys.argv[1:]) as report:
            main(report, *map(int, report.arguments))
