"""Measure splat trees of growing worlds: the building, and pictures of a camera that moves slowly.

    python -m benchmarks.lod_scale [--splats N] [--degree N] [--only] [--folder DIR] [--cores N]
                                   [--steps STEP,...] [--seconds N]
                                   [--devices cpu,cuda] [--views VIEW,...] [--lod-error PIXELS]
                                   [--splat-budget N] [--plot PICTURE.svg] [--json FILE]

The worlds are procedural cities without instances, of 1 M, 10 M, ... up to N splats (100 M), and
10 and 160 instances of the largest one. Each world is drawn at 1920x1080 in two views that are the
same for all worlds. "block" looks down at one block of the middle tile, so that all worlds have
nearly the same cut; "horizon" looks across the whole world. Splats have degree 0, or that of
`--degree`; `--only` leaves out the worlds below N.

Files of DIR that exist are used: tiles and trees are made once, and a building that was interrupted
continues. After `--seconds`, tiles and buildings are ended with status 3, and the same command
continues them; the costs of all parts of a building are added up. Steps are "tiles", "build" and
"frames"; all by default. Measurements of buildings are kept beside the trees. `--cores` limits the
processors of buildings and frames, but not of tiles. Each building and each row of frames has a
process of its own, whose highest memory is shown; it includes mapped files. The first picture is
drawn with kernels that are compiled, but not loaded. "CPU" is the processor time of a frame,
"outside stages" its time before and between the stages of the renderer: to choose the cut, to read
and to lay out its nodes. A GPU is waited for in a stage.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from rich.table import Table

from benchmarks import lod_world
from benchmarks.memory import resident
from benchmarks.report import Report, Row, spread
from benchmarks.scenes import view_of
from usdsplat.core.cloud import F64
from usdsplat.core.progress import silent
from usdsplat.render.specs import View

STEPS = ("tiles", "build", "frames")
SIZE = (1920, 1080)
INSTANCES = (10, 160)
FRAMES, WARM, LEAST = 12, 2, 3
"""Measured pictures, pictures before them, and measured pictures if they are slow."""
SLOW = 60.0
"""Time after which no more than LEAST pictures are measured [s]."""
STRIDE = 0.02
"""Motion of the camera from picture to picture [m]."""
VIEWS = ("block", "horizon")

BUILD_CPU, BUILD_PEAK, BUILD_RATIO = {0: 9.0, 3: 18.0}, 4096.0, 1.6
"""Bars of a building: CPU time [us/splat] by degree, memory [MiB], bytes relative to packed
leaves."""
ENDED = 3
"""Exit status if the time of `--seconds` is over."""
SPREAD_MS, SPREAD_PEAK = 1.3, 1.5
"""Bars of the view "block" over all worlds: the largest over the smallest time and memory."""
LARGEST_MS = {"cpu": 3000.0, "cuda": 8.0}
"""Bars of the view "horizon" of the largest world [ms]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """A stage to draw."""

    name: str
    path: Path
    splats: int
    """Number of splats; each instance counts."""


# --- in a process of its own --------------------------------------------------------------


def build(sources: list[Path], target: Path) -> Row:
    """Build a tree and return its costs."""
    from usdsplat.interchange.lod import build_tree

    began = time.perf_counter()
    report = build_tree(sources, target, progress=silent)
    used = resource.getrusage(resource.RUSAGE_SELF)
    return {
        "splats": report.splats, "nodes": report.nodes, "levels": report.levels,
        "wall": time.perf_counter() - began, "cpu": used.ru_utime + used.ru_stime,
        "peak": resident("VmHWM"), "bytes": report.size, "ratio": report.size / report.leaf_size,
        "continued": report.continued,
    }  # fmt: skip


def frames(stage: Path, name: str, device: str, error: float, budget: int) -> Row:
    """Draw a view of a stage while its camera moves, and return the costs.

    Args:
        stage: The stage.
        name: One of VIEWS.
        device: Name of the device.
        error: `RenderSettings.lod_error` [pixel].
        budget: `RenderSettings.splat_budget`.
    """
    from usdsplat.delegate.engine import Engine
    from usdsplat.interchange.files import open_stage
    from usdsplat.render.lod.nodes import view_cut
    from usdsplat.render.settings import RenderSettings

    settings = RenderSettings(
        sorting="zDepth", color_mode="display", node_lifetime=1e6, lod_error=error,
        splat_budget=budget,
    )  # fmt: skip
    times: list[float] = []
    spent: list[float] = []
    outside: list[float] = []
    began = time.perf_counter()
    with Engine(open_stage(stage), device=device) as engine:
        for number in range(WARM + FRAMES):
            start, cpu = time.perf_counter() if number else began, time.process_time()
            if start - began > SLOW and number >= WARM + LEAST:
                break
            picture = engine.picture(camera(name, number), settings)["color"]
            times.append(1e3 * (time.perf_counter() - start))
            spent.append(1e3 * (time.process_time() - cpu))
            outside.append(times[-1] - sum(engine.stats.wall_ms.values()))
            if not np.asarray(picture)[..., 3].mean() > 0.1:
                sys.exit(f"{stage} {name}: the picture is empty")
        scene = engine.render_scene
        peak = resident("VmHWM")
        cut = view_cut(scene, camera(name, 0), settings)
        found = {
            "cut": cut.splats, "limit": cut.limit, "visible": engine.stats.visible,
            "first": times[0], "nodes": sum(len(tree.fields) for _, tree in scene.drawn_trees()),
            "cache": scene.node_cache.bytes / 2**20, "peak": peak, "device": engine.device,
        }  # fmt: skip
    medians = {
        "cpu_ms": float(np.median(spent[WARM:])),
        "outside": float(np.median(outside[WARM:])),
    }
    return {**found, **spread(times[WARM:]), **medians}


def camera(name: str, number: int) -> View:
    """Return a view of a city, moved along x."""
    eye, tilt = {"block": ((6.0, 150.0, 0.0), 90.0), "horizon": ((0.0, 70.0, 100.0), 12.0)}[name]
    focal = {"block": 3.0, "horizon": 1.0}[name]
    return looking((eye[0] + STRIDE * number, *eye[1:]), tilt, focal, SIZE)


def looking(eye: Sequence[float], tilt: float, focal: float, size: tuple[int, int]) -> View:
    """Return a view from `eye` [m] along -z, turned downwards by `tilt` [degree], with a focal
    length in heights of the picture."""
    width, height = size
    k = np.array([[focal * height, 0, width / 2], [0, focal * height, height / 2], [0, 0, 1.0]])
    return view_of(_matrix(np.asarray(eye, np.float64), np.radians(tilt)), k, size)


def _matrix(eye: F64, tilt: float) -> F64:
    """Return an OpenCV world-to-camera matrix that looks along -z, turned downwards."""
    ahead = np.array([0, -np.sin(tilt), -np.cos(tilt)])
    right = np.array([1.0, 0, 0])
    matrix = np.eye(4)
    matrix[:3, :3] = right, np.cross(ahead, right), ahead
    matrix[:3, 3] = -matrix[:3, :3] @ eye
    return matrix


# --- of all worlds ------------------------------------------------------------------------


def alone(*arguments: object) -> Row:
    """Measure in a new process of this module, and return the result."""
    command = [sys.executable, "-m", "benchmarks.lod_scale", "--one", *map(str, arguments)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    if run.returncode:
        sys.exit(f"lod_scale: {' '.join(command)} failed:\n{run.stderr}")
    found: Row = json.loads(run.stdout)
    return found


def short(splats: float) -> str:
    """Return a number of splats such as "10 M"."""
    for unit, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if splats >= unit:
            return f"{splats / unit:.3g} {letter}"
    return f"{splats:g}"


class Timer:
    """Ends this process with the status ENDED after some time.

    Args:
        seconds: The time [s]; None for ever.
    """

    def __init__(self, seconds: float | None) -> None:
        self._end = None if seconds is None else time.monotonic() + seconds

    def left(self) -> float | None:
        """Return the time that is left [s]."""
        return None if self._end is None else max(0.0, self._end - time.monotonic())

    def start(self) -> None:
        """Begin to count for work in this process and its pools."""
        if (left := self.left()) is not None:
            signal.signal(signal.SIGALRM, lambda *_: end("tiles"))
            signal.setitimer(signal.ITIMER_REAL, max(left, 1e-3))

    def stop(self) -> None:
        """Stop counting."""
        signal.setitimer(signal.ITIMER_REAL, 0)


def end(what: str) -> NoReturn:
    """End this process and all that it began."""
    print(f"lod_scale: {what}: time is over; the same command continues", flush=True)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    for child in multiprocessing.active_children():
        child.terminate()
    os._exit(ENDED)


def built_in_parts(target: Path, tiles: list[Path], timer: Timer) -> Row:
    """Build a tree in a new process, and return its costs, with those of the parts before it that
    ran out of time."""
    record = target.with_suffix(".parts.json")
    parts: list[Row] = json.loads(record.read_text("utf-8")) if record.exists() else []
    command = [sys.executable, "-m", "benchmarks.lod_scale", "--one", "build", str(target)]
    began = time.perf_counter()
    with tempfile.TemporaryFile("w+") as said, tempfile.TemporaryFile("w+") as problems:
        run = subprocess.Popen([*command, *map(str, tiles)], stdout=said, stderr=problems)
        try:
            status = run.wait(timer.left())
        except subprocess.TimeoutExpired:
            peak = resident("VmHWM", run.pid)
            run.kill()
            run.wait()
            used = resource.getrusage(resource.RUSAGE_CHILDREN)
            wall, cpu = time.perf_counter() - began, used.ru_utime + used.ru_stime
            parts.append({"wall": wall, "cpu": cpu, "peak": peak})
            record.write_text(json.dumps(parts), encoding="utf-8")
            print(f"{target.name}: {wall:.0f} s, CPU {cpu:.0f} s, peak {peak:,.0f} MiB")
            end(target.name)
        for file in (said, problems):
            file.seek(0)
        if status:
            sys.exit(f"lod_scale: building {target} failed:\n{problems.read()}")
        found: Row = json.loads(said.read())
    record.unlink(missing_ok=True)
    for key in ("wall", "cpu"):
        found[key] += sum(part[key] for part in parts)
    found["peak"] = max(each["peak"] for each in (found, *parts))
    return {**found, "continued": found["continued"] and not parts, "parts": 1 + len(parts)}


def sizes_to(splats: int) -> list[int]:
    """Return 1 M, 10 M, ... below a number of splats, and the number."""
    powers = [10**power for power in range(6, 12)]
    return [*(size for size in powers if size < splats), splats]


def built(report: Report, folder: Path, sizes: list[int], degree: int, timer: Timer) -> None:
    """Build the trees that do not exist, and show what all of them took."""
    table = Table(title="trees")
    for column in (
        "splats", "wall s", "CPU s", "CPU µs/splat", "peak MiB", "bytes MB",
        "/ packed leaves", "nodes", "levels",
    ):  # fmt: skip
        table.add_column(column, justify="right")
    rows = []
    for size in sizes:
        target = tree_path(folder, size, degree)
        record = target.with_suffix(".json")
        if not (target.exists() and record.exists()):
            tiles = lod_world.write_tiles(folder / "tiles", size, processes=1, degree=degree)
            found = built_in_parts(target, tiles, timer)
            record.write_text(json.dumps(found), encoding="utf-8")
        row = json.loads(record.read_text(encoding="utf-8"))
        rows.append(row)
        mark = " (continued)" if row["continued"] else ""
        table.add_row(
            short(row["splats"]), f"{row['wall']:.0f}{mark}", f"{row['cpu']:.0f}",
            f"{1e6 * row['cpu'] / row['splats']:.2f}", f"{row['peak']:,.0f}",
            f"{row['bytes'] / 1e6:,.0f}", f"{row['ratio']:.3f}", f"{row['nodes']:,}",
            str(row["levels"]),
        )  # fmt: skip
        report.add(scene=f"tree {short(size)}", **row)
    report.show(table)
    last = rows[-1]
    if not last["continued"] and degree in BUILD_CPU:
        measured = 1e6 * last["cpu"] / last["splats"]
        said(report, "CPU µs/splat of the largest tree", measured, BUILD_CPU[degree])
    said(report, "peak MiB of the largest tree", last["peak"], BUILD_PEAK)
    said(report, "bytes of the largest tree over packed leaves", last["ratio"], BUILD_RATIO)


def tree_path(folder: Path, size: int, degree: int) -> Path:
    """Return the path of the tree of a city of a number of splats."""
    kind = f"_sh{degree}" if degree else ""
    return folder / f"city_{short(size).replace(' ', '')}{kind}.usda"


def worlds(folder: Path, sizes: list[int], degree: int) -> list[World]:
    """Return the stages to draw; those with instances are written."""
    found = [
        World(name=short(size), path=path, splats=size)
        for size in sizes
        if (path := tree_path(folder, size, degree)).exists()
    ]
    if not found or found[-1].splats != sizes[-1]:
        sys.exit(f"lod_scale: found no tree of {short(sizes[-1])} in {folder}, expected one: build")
    largest = found[-1]
    for copies in INSTANCES:
        path = folder / f"{largest.path.stem}_times_{copies}.usda"
        edge = lod_world.city_edge(largest.splats)
        lod_world.write_instances(path, largest.path, copies, edge)
        name = f"{largest.name} × {copies}"
        found.append(World(name=name, path=path, splats=copies * largest.splats))
    return found


def drawn(report: Report, scenes: list[World], options: argparse.Namespace) -> list[Row]:
    """Draw all worlds on all devices, show the costs, and return them."""
    how = options.lod_error, options.splat_budget
    every: list[Row] = []
    table = Table(title=f"{SIZE[0]}×{SIZE[1]}, {len(os.sched_getaffinity(0))} cores")
    for column in (
        "device", "view", "world", "splats", "cut", "error px", "visible", "nodes",
        "cache MiB", "first ms", "median ms", "least–most", "CPU ms", "outside stages",
        "peak MiB",
    ):  # fmt: skip
        table.add_column(column, justify="right")
    for device in options.devices.split(",") if options.devices else available():
        for view in options.views.split(","):
            alone("frames", scenes[0].path, view, device, *how)  # compiles
            rows = []
            for world in scenes:
                row = alone("frames", world.path, view, device, *how)
                if row["device"] != device:
                    sys.exit(f"lod_scale: found the device {row['device']}, expected {device}")
                rows.append(row)
                table.add_row(
                    device, view, world.name, short(world.splats), f"{row['cut']:,}",
                    f"{row['limit']:.2f}", f"{row['visible']:,}", f"{row['nodes']:,}",
                    f"{row['cache']:.0f}", f"{row['first']:.0f}", f"{row['ms']:.1f}",
                    f"{row['low']:.1f}–{row['high']:.1f}", f"{row['cpu_ms']:.1f}",
                    f"{row['outside']:.1f}",
                    f"{row['peak']:.0f}", end_section=world is scenes[-1],
                )  # fmt: skip
                every.append({"view": view, "splats": world.splats, **row})
                size = f"{SIZE[0]}x{SIZE[1]}"
                report.add(scene=f"{view} {world.name}", size=size, **every[-1])
            judge(report, device, view, scenes, rows)
    report.show(table, 180)
    return every


def judge(
    report: Report, device: str, view: str, scenes: list[World], rows: list[dict[str, Any]]
) -> None:
    """Compare the frames of all worlds with the bars."""
    if view == "block":
        kept = [row for row, world in zip(rows, scenes, strict=True) if world is not scenes[-1]]
        name = f"{device} {view}, {scenes[0].name} to {short(scenes[-2].splats)}"
        clock = "cpu_ms" if device == "cpu" else "ms"  # others may use the processor too
        for what, key, bar in (("time", clock, SPREAD_MS), ("memory", "peak", SPREAD_PEAK)):
            values = [row[key] for row in kept]
            said(report, f"{name}: largest over smallest {what}", max(values) / min(values), bar)
        return
    name = f"{device} {view}, {short(scenes[-1].splats)}"
    said(report, f"{name}: ms", rows[-1]["ms"], LARGEST_MS.get(device, np.inf))
    said(report, f"{name}: peak MiB", rows[-1]["peak"], BUILD_PEAK)


def said(report: Report, what: str, value: float, bar: float) -> None:
    """Print a figure and its bar."""
    verdict = "met" if value <= bar else "missed"
    report.say(f"{what}: {value:.2f}, bar {bar:g}: {verdict}")


def plot(rows: list[Row], path: Path) -> None:
    """Write time and memory of a picture over the splats of the world, as an SVG."""
    from matplotlib.figure import Figure

    from benchmarks.plot import COLOURS, OURS, save

    figure = Figure(figsize=(9.2, 4.4), layout="constrained")
    figure.suptitle(f"Pictures of splat trees, {SIZE[0]}×{SIZE[1]}, while the camera moves slowly")
    for axes, key, label in zip(
        figure.subplots(1, 2), ("ms", "peak"), ("ms", "peak memory [MiB]"), strict=True
    ):
        for number, device in enumerate(dict.fromkeys(row["device"] for row in rows)):
            for view, dash in zip(VIEWS, ("-", "--"), strict=True):
                some = [row for row in rows if (row["device"], row["view"]) == (device, view)]
                if not some:
                    continue
                axes.plot(
                    [row["splats"] for row in some],
                    [row[key] for row in some],
                    "o" + dash,
                    color=COLOURS[number],
                    markersize=4,
                    label=f"{OURS.get(device, device)}: {view}",
                )
        axes.set(xscale="log", yscale="log", xlabel="splats of the world", ylabel=label)
        axes.grid(alpha=0.3)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    save(figure, path)


def main(report: Report) -> None:
    """Run the steps."""
    parser = argparse.ArgumentParser(prog="lod_scale", description=__doc__.partition("\n")[0])
    parser.add_argument("--splats", type=float, default=100e6)
    parser.add_argument("--degree", type=int, default=0)
    parser.add_argument("--only", action="store_true")
    parser.add_argument("--folder", type=Path, default=Path("lod_scale"))
    parser.add_argument("--cores", type=int)
    parser.add_argument("--steps", default=",".join(STEPS))
    parser.add_argument("--seconds", type=float)
    parser.add_argument("--devices")
    parser.add_argument("--views", default=",".join(VIEWS))
    parser.add_argument("--lod-error", type=float, default=1.0)
    parser.add_argument("--splat-budget", type=int, default=0)
    parser.add_argument("--plot", type=Path)
    options = parser.parse_args(report.arguments)
    steps, sizes = options.steps.split(","), sizes_to(int(options.splats))
    if unknown := set(steps) - set(STEPS):
        parser.error(f"--steps: found {', '.join(unknown)}, expected some of {', '.join(STEPS)}")
    if options.only:
        sizes = sizes[-1:]
    processors, timer = sorted(os.sched_getaffinity(0)), Timer(options.seconds)
    if "tiles" in steps:
        began = time.perf_counter()
        tiles, degree = options.folder / "tiles", options.degree
        timer.start()
        for size in sizes:
            lod_world.write_tiles(tiles, size, processes=len(processors), degree=degree)
        timer.stop()
        report.say(f"tiles: {time.perf_counter() - began:.0f} s")
    os.sched_setaffinity(0, processors[: options.cores])
    if "build" in steps:
        built(report, options.folder, sizes, options.degree, timer)
    if "frames" in steps:
        rows = drawn(report, worlds(options.folder, sizes, options.degree), options)
        if options.plot:
            plot(rows, options.plot)


def available() -> list[str]:
    """Return the devices of this machine."""
    from usdsplat.kernels.cuda.support import obstacle

    return ["cpu"] if obstacle() else ["cpu", "cuda"]


if __name__ == "__main__":
    if sys.argv[1:3] == ["--one", "build"]:
        print(json.dumps(build([Path(each) for each in sys.argv[4:]], Path(sys.argv[3]))))
    elif sys.argv[1:3] == ["--one", "frames"]:
        stage, view, device, error, budget = sys.argv[3:]
        print(json.dumps(frames(Path(stage), view, device, float(error), int(budget))))
    else:
        with Report("lod_scale", sys.argv[1:]) as report:
            main(report)
