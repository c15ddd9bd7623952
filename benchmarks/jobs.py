"""Measure sequences as jobs: processes of this machine, and Dask, against one process.

    python -m benchmarks.jobs [--frames 240] [--size 320x180] [--samples 1] [--device cpu]
        [--jobs 1,2] [--dask] [--capture FILE] [--runs 1] [--json FILE]

"alone" is `usdsplat render` with --threads, so that it stays one process; "default" has neither
that flag nor --jobs, and lets several processes go on where that saves time. Times are medians of
the runs, in which the commands take turns: wall time of the whole command, with its start, and CPU
time of all its processes; "per file" is wall time over files; "steady" is the rate from the
first file to the last, without the starts; "against alone" is the ratio of CPU times, the
overhead of the job.
Kernels and bytecode are compiled before.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from pxr import Gf, Usd, UsdGeom
from rich.table import Table

from benchmarks.report import Report
from benchmarks.scenes import DATA
from usdsplat.kernels.device import usual_threads


def turntable(capture: Path, folder: Path, frames: int) -> Path:
    """Write a stage with a capture and a camera that moves around it, and return its path."""
    scan, shot = folder / "scan.usdc", folder / "shot.usda"
    run(["convert", str(capture), str(scan)])
    stage = Usd.Stage.CreateNew(str(shot))
    stage.GetRootLayer().subLayerPaths.append(scan.name)
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(frames)
    box = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"]).ComputeWorldBound(
        stage.GetPseudoRoot()
    )
    middle = box.ComputeCentroid()
    reach = box.ComputeAlignedRange().GetSize().GetLength()
    camera = UsdGeom.Camera.Define(stage, "/Camera")
    move = camera.AddTransformOp()
    for frame in range(1, frames + 1):
        turn = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(0, 1, 0), 360 * frame / frames))
        back = Gf.Matrix4d().SetTranslate(Gf.Vec3d(0, 0, reach))
        move.Set(back * turn * Gf.Matrix4d().SetTranslate(middle), frame)
    stage.Save()
    return shot


def run(words: list[str]) -> tuple[float, float]:
    """Run a command, and return its wall time and the CPU time of all its processes [s]."""
    before, children = time.perf_counter(), os.times()
    command = [sys.executable, "-m", "usdsplat", *words]
    # without it, each process would compile all modules, as no installed program does
    kept = {name: text for name, text in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    subprocess.run(command, check=True, capture_output=True, env=kept)
    after = os.times()
    spent = after.children_user - children.children_user
    return time.perf_counter() - before, spent + after.children_system - children.children_system


def steady(folder: Path) -> float:
    """Return the pictures in a folder per second, between the first and the last [1/s]."""
    times = [each.stat().st_mtime for each in folder.glob("out.*.exr")]
    return (len(times) - 1) / max(max(times) - min(times), 1e-6)


def main(report: Report) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=240)
    parser.add_argument("--size", default="320x180")
    parser.add_argument("--samples", default="1")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--jobs", default="1,2")
    parser.add_argument("--dask", action="store_true")
    parser.add_argument("--capture", type=Path, default=DATA / "splats/statue_angel.sog")
    parser.add_argument("--runs", type=int, default=1)
    options = parser.parse_args(report.arguments)
    ways: dict[str, list[str]] = {"alone": ["--threads", str(usual_threads())], "default": []}
    ways |= {f"--jobs {count}": ["--jobs", count] for count in options.jobs.split(",")}
    if options.dask:
        ways |= {"--dask local": ["--dask", "local"]}
    title = f"{options.frames} frames of {options.size}, {options.samples} samples, EXR"
    table = Table(title=f"{options.capture.name}, {options.device}: {title}")
    for name in ("command", "wall s", "CPU s", "per file ms", "files/s", "steady", "against alone"):
        table.add_column(name, justify="right")
    alone = 0.0
    with tempfile.TemporaryDirectory() as folder:
        shot = turntable(options.capture, Path(folder), options.frames)
        words = [
            "render", str(shot), "-o", f"{folder}/out.####.exr", "--resolution", options.size,
            "--samples", options.samples, "--device", options.device,
        ]  # fmt: skip
        for flags in ways.values():
            run([*words, "--frames", "1-2", *flags])
        taken: dict[str, list[tuple[float, float, float]]] = {way: [] for way in ways}
        for _ in range(options.runs):
            for way, flags in ways.items():
                taken[way].append((*run([*words, *flags]), steady(Path(folder))))
        for way, times in taken.items():
            wall, cpu, rate = (statistics.median(each) for each in zip(*times, strict=True))
            alone = alone or cpu
            report.add(device=options.device, scene=way, ms=1e3 * wall, cpu_ms=1e3 * cpu)
            per_file = 1e3 * wall / options.frames
            cells = (
                f"{wall:.1f}",
                f"{cpu:.1f}",
                f"{per_file:.1f}",
                f"{1e3 / per_file:.2f}",
                f"{rate:.2f}",
            )
            table.add_row(way, *cells, f"{cpu / alone:.2f}")
    report.show(table)


if __name__ == "__main__":
    with Report("jobs", sys.argv[1:]) as report:
        main(report)
