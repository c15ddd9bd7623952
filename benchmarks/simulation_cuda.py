"""Measure the simulation on a GPU, and compare it with its memory traffic and with the CPU.

    python -m benchmarks.simulation_cuda [steps | frames] [SPLATS] [--json FILE]

`steps` measures, with a million splats, a step of the reaction on the graph of a waved sheet, the
contact step of 16 capsules, and others. GPU times are those of events around each launch in a
stream of its own, with resident arrays. Launches are queued while the GPU is busy, so that it never
waits for the host: medians of 40, with quartiles. The floor is the time for the bytes that must be
read and written at 4 TB/s. The CPU runs the same kernels on the same arrays.

`frames` simulates 100 frames of a pattern, growth and affectors on both devices, and compares the
final states; on the GPU twice, with bit-identical results.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.report import Report
from benchmarks.simulation import DT, SUPPORT, capsules, sheet, state_of
from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.kernels.device import Device
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.sim import lists, settle
from usdsplat.kernels.sim import reaction as reactions
from usdsplat.sim.bodies import pack_bodies
from usdsplat.sim.contact import COUNTS, contact
from usdsplat.sim.fields import Fields
from usdsplat.sim.neighbors import Graph, Neighbors
from usdsplat.sim.parameters import NeighborsParameters, Parameters, RdParameters
from usdsplat.sim.reaction import Reaction
from usdsplat.sim.solver import Solver
from usdsplat.sim.specs import Affector, Moment, SkinBinding
from usdsplat.sim.uses import uses_over

REPEATS = 40
BANDWIDTH = 4e12
"""Approximate memory bandwidth of an H200 [B/s]."""
FRAMES = 100
FIELD = 20_000
"""Number of splats of `frames`."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Part:
    """A measured launch with arrays of the device."""

    name: str
    run: Callable[[], Any]
    bytes: float
    """Bytes that it must read and write."""
    prepare: Callable[[], Any] = lambda: None
    """Function that prepares each launch, not timed."""


# --- 1. steps ---------------------------------------------------------------------------


def reaction_part(device: Device, graph: Graph) -> Part:
    """Return a step of the Gray-Scott reaction."""
    knobs = RdParameters(enabled=True)
    reaction = Reaction(device, graph, knobs)
    n, k = len(graph.order), len(graph.neighbors)
    now = device.move(np.random.default_rng(2).random(2 * n, dtype=np.float32))
    then = device.resident(2 * n, np.float32)
    rates = [device.move(np.array([each], np.float32)) for each in (knobs.feed, knobs.kill)]
    area = np.float32(reaction.scale**2)
    numbers = np.float32(knobs.diffusion_u) * area, np.float32(knobs.diffusion_v) * area

    def run() -> None:
        device.run(
            reactions.gray_scott, *reaction.weights, now, *rates, *numbers, np.float32(1), then
        )

    return Part(name=f"Gray-Scott step, k {k / n:.1f}", run=run, bytes=8.0 * k + 24 * n)


def contact_part(device: Device, points: F32, name: str, solids: list[Affector]) -> Part:
    """Return the contact step, from the positions after its first run."""
    n = len(points)
    bodies = pack_bodies(Fields(device), solids, solids, DT)
    everyone = np.arange(len(bodies), dtype=np.int32)
    meshes = (bodies.fields.headers, bodies.fields.voxels)
    blocks = -(-n // 1024)
    scales = np.tile(np.array([0.5, 0.45, 0.05], np.float32), (n, 1))
    table, everyone, *meshes, started, flags, scales, positions, velocities, since, struck = (
        device.move(each)
        for each in (
            bodies.table, everyone, *meshes, points.copy(), np.ones(n, np.uint32), scales,
            points.copy(), np.zeros((n, 3), np.float32), np.full(n, np.inf, np.float32),
            np.zeros(n, np.uint8),
        )
    )  # fmt: skip
    inside = device.move(points.copy())

    def prepare() -> None:
        if isinstance(positions, np.ndarray):
            positions[:] = inside
        else:
            positions.copy_to_device(inside, stream=device.stream)  # type: ignore[attr-defined]

    near = device.resident((blocks, len(bodies)), np.int32)
    counts = device.resident((blocks, COUNTS), np.int64)

    def run() -> None:
        device.run(
            contact, table, everyone, *meshes, DT, bodies.blend, bodies.clearance,
            1e-7 * bodies.size, started, flags, scales, positions, velocities, since, struck, near,
            counts,
        )  # fmt: skip

    return Part(name=name, run=run, bytes=28.0 * n, prepare=prepare)


def other_parts(device: Device, points: F32) -> list[Part]:
    """Return settling, and the test whether lists must be rebuilt."""
    n = len(points)
    state = state_of(points, 0)
    here = device.move(points.copy())
    speeds, positions, velocities = (device.move(points * np.float32(s)) for s in (0, 1, 0))
    flags, weight = device.move(state.flags), device.move(state.weight)
    since = device.move(np.full(n, np.inf, np.float32))
    numbers = (np.float32(each) for each in (4.0, 0.2, np.inf, DT))
    fixed = tuple(numbers)
    far = device.resident(-(-n // 1024), np.float64)
    return [
        Part(
            name="settle",
            run=lambda: device.run(
                settle.settle, *fixed, here, here, speeds, flags, weight, positions, velocities,
                since,
            ),
            bytes=n * (12.0 * 2 + 12 * 2 * 3 + 4 * 2 + 8),
        ),
        Part(
            name="drift", run=lambda: device.run(lists.drift, here, positions, far), bytes=24.0 * n
        ),
    ]  # fmt: skip


def parts(device: Device, points: F32) -> list[Part]:
    """Return all parts that `steps` measures."""
    support = np.full(len(points), SUPPORT, np.float32)
    graph = Neighbors(device, NeighborsParameters()).update(points, support)
    side, middle = float(np.sqrt(len(points))), points.mean(axis=0)
    large = 0.03 * side
    return [
        reaction_part(device, graph),
        contact_part(
            device, points, "contact, 16 large capsules that overlap",
            capsules(16, large, large, middle, 0.1 * side),
        ),
        contact_part(
            device, points, "contact, 16 small capsules", capsules(16, 3, 3, middle, 0.4 * side)
        ),
        *other_parts(device, points),
    ]  # fmt: skip


def events(device: Any, part: Part) -> list[float]:
    """Return the time of each of many launches on the GPU [ms]."""
    from numba import cuda

    @cuda.jit
    def busy(out: Any) -> None:
        for _ in range(20):
            cuda.nanosleep(np.uint32(1_000_000))
        out[0] = 1

    for _ in range(3):
        part.prepare()
        part.run()
    marks = [(cuda.event(), cuda.event()) for _ in range(REPEATS)]
    busy[1, 1, device.stream](device.resident(1, np.int32))
    for begin, end in marks:
        part.prepare()
        begin.record(device.stream)
        part.run()
        end.record(device.stream)
    device.stream.synchronize()
    return [begin.elapsed_time(end) for begin, end in marks]


def clock(part: Part) -> list[float]:
    """Return the time of each of some launches on the CPU [ms]."""
    out = []
    for _ in range(8):
        part.prepare()
        begin = time.perf_counter()
        part.run()
        out.append(1e3 * (time.perf_counter() - begin))
    return out[1:]


def steps(report: Report, count: int) -> None:
    """Print the table of steps."""
    points = sheet(count)
    fast, slow = open_device(), open_device("cpu")
    table = Table("step", "floor, ms", "GPU, ms", "× floor", "CPU, ms", "CPU / GPU")
    if fast.name == "cpu":
        report.say("no GPU here: the CPU's alone")
    builds = [(device.name, built(device, points)) for device in dict.fromkeys((fast, slow))]
    for ours, theirs in zip(parts(fast, points), parts(slow, points), strict=True):
        cpu = float(np.median(clock(theirs)))
        floor = 1e3 * ours.bytes / BANDWIDTH
        if fast.name == "cpu":
            table.add_row(ours.name, f"{floor:.3f}", "", "", f"{cpu:.2f}", "")
            continue
        low, middle, high = np.percentile(events(fast, ours), (25, 50, 75))
        table.add_row(
            ours.name, f"{floor:.3f}", f"{middle:.3f} ({low:.3f} to {high:.3f})",
            f"{middle / floor:.1f}", f"{cpu:.2f} on {slow.threads}", f"{cpu / middle:.0f}",
        )  # fmt: skip
    report.show(table, 140)
    for name, seconds in builds:
        report.say(f"building and fetching the neighbour lists, {name}: {1e3 * seconds:.0f} ms")


def built(device: Device, points: F32) -> float:
    """Return the seconds to build lists, from host arrays to host arrays."""
    support = np.full(len(points), SUPPORT, np.float32)
    out = []
    for _ in range(4):
        begin = time.perf_counter()
        Neighbors(device, NeighborsParameters()).update(points, support)
        out.append(time.perf_counter() - begin)
    return float(np.median(out[1:]))


# --- 2. frames --------------------------------------------------------------------------


class Field:
    """Splats of a sheet on which a pattern grows, while capsules move through them."""

    selection: F32 | None = None
    binding: SkinBinding | None = None
    codes_per_second = 24.0
    path = "/Field"

    def __init__(self, points: F32) -> None:
        self._points = points
        turns = np.tile(np.array([1, 0, 0, 0], np.float32), (len(points), 1))
        self.rest: SplatCloud = replace(state_of(points, 0).cloud(), rotations=turns)
        plain = Parameters()
        self._parameters = replace(
            plain,
            rd=replace(plain.rd, enabled=True, domain="self", substeps=8),
            growth=replace(plain.growth, rate=0.5),
        )

    def at(self, time: float) -> Moment:
        """Return the capsules, which move along x, at a time."""
        side = float(np.sqrt(len(self._points)))
        middle = self._points.mean(axis=0) + np.float32([0.2 * time - 10, 0, 0])
        solids = capsules(16, 0.04 * side, 0.04 * side, middle, 0.3 * side)
        return Moment(
            time=time, parameters=self._parameters, to_world=np.eye(4), affectors=tuple(solids)
        )


def simulated(name: str, count: int, path: str) -> None:
    """Simulate on one device, and write the state with the seconds of a frame."""
    device, field = open_device(name), Field(sheet(count))
    uses = uses_over(field, [float(t) for t in range(FRAMES + 1)])
    solver = Solver(field, uses, device=device, start=0.0)
    laps = []
    for _ in range(FRAMES):
        begin = time.perf_counter()
        solver.advance()
        laps.append(time.perf_counter() - begin)
    arrays = dict(solver.state.per_splat())
    np.savez(path, **{key.replace(":", "-"): a for key, a in arrays.items()}, laps=np.array(laps))


def frames(report: Report, count: int) -> None:
    """Print the differences of the states."""
    with tempfile.TemporaryDirectory() as folder:
        names = ["cpu"] if open_device().name == "cpu" else ["cpu", "cuda", "cuda"]
        files = [str(Path(folder) / f"{k}.npz") for k in range(len(names))]
        runs = [
            subprocess.Popen([sys.executable, "-m", __spec__.name, "one", str(count), name, file])
            for name, file in zip(names, files, strict=True)
        ]
        for run in runs:
            assert run.wait() == 0
        states: list[dict[str, Any]] = [dict(np.load(file)) for file in files]
    laps = [f"{1e3 * np.median(state.pop('laps')):.1f}" for state in states]
    report.say(f"ms per frame in each run, {count} splats: " + ", ".join(
        f"{name} {lap}" for name, lap in zip(names, laps, strict=True)
    ))  # fmt: skip
    table = Table("state", "largest", "largest difference", "same bits as CPU", "same bits again")
    for key, wanted in states[0].items():
        found = states[-1].get(key, wanted)
        again = states[min(1, len(states) - 1)].get(key, wanted)
        finite = np.where(np.isfinite(wanted), wanted, 0).astype(np.float64)
        apart = np.abs(np.where(np.isfinite(found), found, 0) - finite)
        table.add_row(
            key, f"{np.abs(finite).max():.3g}", f"{apart.max():.3g}",
            "yes" if found.tobytes() == wanted.tobytes() else "no",
            "yes" if found.tobytes() == again.tobytes() else "NO",
        )  # fmt: skip
    report.show(table, 140)


def main() -> None:
    """Print the requested tables."""
    with Report("simulation_cuda", sys.argv[1:]) as report:
        what, *rest = report.arguments or ["all"]
        count = int(rest[0]) if rest else 0
        if what == "one":
            simulated(rest[1], count, rest[2])
        if what in ("steps", "all"):
            steps(report, count or 1_000_000)
        if what in ("frames", "all"):
            frames(report, count or FIELD)


if __name__ == "__main__":
    main()
