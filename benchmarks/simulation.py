"""Measure the parts of a simulation, and compare them with their floors on this machine.

    python -m benchmarks.simulation [SPLATS]

The floor of a part is the longer of two times, with as many threads: that to copy as many bytes as
the part must at least read and write, and that of its minimum number of multiply-adds. Both probes
take turns with the parts, and medians are compared. Splats are on a slightly waved sheet in tiles
of 32 x 32, near the points of a lattice. `benchmarks.simulated_frame` measures whole frames.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import prange
from rich.table import Table

from benchmarks.report import Report, spread
from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.jit import parallel, serial
from usdsplat.kernels.points.cells import into_cells
from usdsplat.kernels.sim import grid
from usdsplat.sim.contact import Contacts
from usdsplat.sim.gradients import LocalGradients
from usdsplat.sim.neighbors import Neighbors, nearest
from usdsplat.sim.parameters import (
    AffectorParameters,
    AppearanceParameters,
    NeighborsParameters,
    RdParameters,
    SettleParameters,
)
from usdsplat.sim.reaction import Reaction
from usdsplat.sim.settle import settle_back
from usdsplat.sim.specs import Affector, Solid
from usdsplat.sim.state import State
from usdsplat.sim.transport import rotate_harmonics, transport

REPEATS = 5
TILE = 32
SUPPORT = 2.33
"""Radius with 17 neighbours on a lattice of spacing 1, including the splat itself."""
DT = 1 / 96
PROBE = 1 << 24
"""Number of copied numbers."""
CHAINS, STEPS = 32 * 1024, 16_384
"""Number of values, and multiply-adds of each."""


@parallel
def copy(source, target):
    """Read and write four bytes for each number."""
    blocks = (source.shape[0] + 4095) // 4096
    for block in prange(blocks):
        for i in range(block * 4096, min(source.shape[0], (block + 1) * 4096)):
            target[i] = source[i]


@serial
def chains(values, steps):
    """Multiply and add `steps` times."""
    one = np.float32(0.999)
    for _ in range(steps):
        for i in range(values.shape[0]):
            values[i] = values[i] * one + one


@parallel
def work(values, steps):
    """Do the same for each row of (n, 1024), which stays in the cache."""
    for row in prange(values.shape[0]):
        chains(values[row], steps)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Part:
    """A measured part of the simulation."""

    name: str
    run: Callable[[], Any]
    bytes: float
    """Bytes that it must read and write, per splat; lists and tables count once."""
    flops: float = 0.0
    goal: float | None = None
    """Goal as a multiple of the floor."""


def sheet(count: int) -> F32:
    """Return the points of a waved sheet with spacing 1, shape (count, 3)."""
    side = int(np.ceil(np.sqrt(count)))
    y, x = np.divmod(np.arange(side * side), side)
    order = np.lexsort((x, y, x // TILE, y // TILE))[:count]
    rng = np.random.default_rng(0)
    points = np.stack([x[order], y[order], np.zeros(count)], axis=1).astype(np.float32)
    points[:, :2] += rng.normal(0, 0.06, (count, 2)).astype(np.float32)
    points[:, 2] = 3 * np.sin(points[:, 0] / 40) * np.cos(points[:, 1] / 50)
    return points


def state_of(points: F32, degree: int) -> State:
    """Return a state of flat splats at points."""
    rng = np.random.default_rng(1)
    n = len(points)
    q = rng.normal(size=(n, 4)).astype(np.float32)
    scales = np.tile(np.array([0.5, 0.45, 0.05], np.float32), (n, 1))
    return State.of(
        SplatCloud(
            positions=points,
            scales=scales,
            rotations=q / np.linalg.norm(q, axis=1, keepdims=True),
            opacities=np.full(n, 0.8, np.float32),
            sh=rng.normal(0, 0.1, (n, (degree + 1) ** 2, 3)).astype(np.float32),
        )
    )


def capsules(count: int, size: float, half: float, centre: F32, spread: float) -> list[Affector]:
    """Return different capsules along z around a position."""
    rng = np.random.default_rng(3)
    out = []
    for k in range(count):
        matrix = np.eye(4)
        matrix[:3, 3] = centre + rng.uniform(-spread, spread, 3) * (1, 1, 0.02)
        solid = Solid(kind="capsule", size=(size, size, half), matrix=matrix)
        knobs = AffectorParameters(blend=0.1 * size, clearance=0.0)
        out.append(Affector(path=f"/a{k:02}", parameters=knobs, solids=(solid,)))
    return out


def contacts(device: CpuDevice, points: F32) -> Iterator[Part]:
    """Repeat one substep, with the positions to which splats were pushed at the first time."""
    side = float(np.sqrt(len(points)))
    middle = points.mean(axis=0)
    size = 0.03 * side
    cases = (
        ("contact, 16 large that overlap", capsules(16, size, size, middle, 0.1 * side), 8 * 35, 8),
        ("contact, 16 small, far from most", capsules(16, 3, 3, middle, 0.4 * side), 40, 3),
        ("contact, nothing near", capsules(16, 3, 3, middle + np.float32(1e4), 3.0), 6, 1.5),
    )
    for name, solids, flops, goal in cases:
        state, solver = state_of(points, 0), Contacts(device)
        state.positions = points.copy()

        def run(
            state: State = state, solver: Contacts = solver, solids: list[Affector] = solids
        ) -> None:
            state.positions[:] = points
            solver.step(state, points, solids, solids, DT)

        yield Part(name=name, run=run, bytes=60, flops=flops, goal=goal)


def growth(device: CpuDevice, points: F32) -> Iterator[Part]:
    """Measure grid, lists and the reaction."""
    n = len(points)
    support = np.full(n, SUPPORT, np.float32)
    cells = into_cells(device, points, SUPPORT)
    entry = np.empty(n, np.int32)
    table = 4.0 * len(cells.start) / n
    yield Part(
        name="keys",
        run=lambda: device.run(grid.keys, points, cells.inverse, cells.bits, entry),
        bytes=16, flops=9, goal=1.5,
    )  # fmt: skip
    yield Part(
        name=f"extent, keys and sort, {sum(cells.bits)} bits",
        run=lambda: into_cells(device, points, SUPPORT),
        bytes=60 + 28 + 3 * table, goal=2.5,
    )  # fmt: skip
    knobs = NeighborsParameters(skin=0.0)
    graph = Neighbors(device, knobs).update(points, support)
    k = len(graph.neighbors) / n
    yield Part(
        name=f"lists, k {k:.1f}, with their grid",
        run=lambda: Neighbors(device, knobs).update(points, support),
        bytes=60 + 28 + 3 * table + 8 * k + 20, flops=9 * 80, goal=8,
    )  # fmt: skip
    rd = RdParameters(enabled=True)
    reaction = Reaction(device, graph, rd)
    uv = np.random.default_rng(2).random((n, 2), dtype=np.float32)
    steps = 8 * reaction.subdivisions
    yield Part(
        name=f"Gray-Scott, {steps} steps",
        run=lambda: reaction.step(uv, 8),
        bytes=steps * ((k + 1) * 8 + 24), flops=steps * (8 * k + 14), goal=2,
    )  # fmt: skip


def shapes(device: CpuDevice, points: F32) -> Iterator[Part]:
    """Measure settling, gradients, covariances and harmonics."""
    n = len(points)
    state = state_of(points, 3)
    state.positions = points + np.float32(0.1)
    yield Part(
        name="settle",
        run=lambda: settle_back(device, state, points, points, SettleParameters(), DT),
        bytes=72, flops=30, goal=1.5,
    )  # fmt: skip
    found = np.ascontiguousarray(nearest(device, points, points, 13)[0][:, 1:])
    normals = np.tile(np.array([0, 0, 1], np.float32), (n, 1))
    local = LocalGradients.of(device, points, found, normals)
    bent = points.copy()
    bent[:, 2] += 0.002 * (points[:, 0] - points[:, 0].mean()) ** 2
    gradient = np.empty((n, 3, 3), np.float32)
    yield Part(
        name="gradients by moving least squares, 12",
        run=lambda: local.measure(device, bent, gradient, sizes=state.rest_scales[:, 0].copy()),
        bytes=12 * 16 + 36 + 40, flops=220, goal=1.8,
    )  # fmt: skip
    local.measure(device, bent, gradient)
    few = np.empty_like(gradient)
    few[:] = np.eye(3, dtype=np.float32)
    few[: n // 20] = gradient[: n // 20]
    for name, given, part in (("all", gradient, 1.0), ("5 %", few, 0.05)):
        yield Part(
            name=f"covariances, {name} deformed",
            run=lambda given=given: transport(
                device, given, state.rest_rotations, state.rest_scales, state.rotations,
                state.scales, AppearanceParameters(),
            ),
            bytes=36 + 28 + 28 + 16, flops=600 * part, goal=25 if part == 1 else None,
        )  # fmt: skip
        turned = np.zeros(n, np.uint8)
        out = state.rest_sh.copy()
        yield Part(
            name=f"harmonics of degree 3, {name} turned",
            run=lambda given=given, out=out, turned=turned: rotate_harmonics(
                device, given, state.rest_sh, out, turned
            ),
            bytes=36 + 32 + part * 2 * 192, flops=1900 * part, goal=3 if part == 1 else None,
        )  # fmt: skip


def spent(action: Callable[[], Any]) -> tuple[float, float]:
    """Return the wall and CPU seconds of a call."""
    wall, cpu = time.perf_counter(), time.process_time()
    action()
    return time.perf_counter() - wall, time.process_time() - cpu


def main(report: Report, count: int = 1_000_000) -> None:
    """Print the table."""
    device = open_device()
    points = sheet(count)
    source = np.random.default_rng(4).random(PROBE, dtype=np.float32)
    target, values = np.empty_like(source), np.ones((CHAINS // 1024, 1024), np.float32)
    probes = (
        lambda: device.run(copy, source, target),
        lambda: device.run(work, values, STEPS),
    )
    table = Table(title=f"{count:,} splats, {device.threads} threads: ms, medians of {REPEATS}")
    for name in ("part", "wall", "CPU", "floor wall", "floor CPU", "× wall", "× CPU", "goal"):
        table.add_column(name, justify="left" if name == "part" else "right")
    rates = []
    for group in (growth, contacts, shapes):
        for part in group(device, points):
            every = (part.run, *probes)
            for action in every:
                action()
            laps = np.array([[spent(action) for action in every] for _ in range(REPEATS)])
            own, copying, working = 1e3 * np.median(laps, axis=0)
            moved, done = (
                part.bytes * count / (8 * PROBE),
                part.flops * count / (2.0 * CHAINS * STEPS),
            )
            floor = np.maximum(copying * moved, working * done)
            report.add(
                device=device.name, scene=part.name, splats=count, **spread(1e3 * laps[:, 0, 0])
            )
            rates.append((8e-6 * PROBE / copying[0], 2e-6 * CHAINS * STEPS / working[0]))
            table.add_row(
                part.name, f"{own[0]:.1f}", f"{own[1]:.1f}", f"{floor[0]:.1f}", f"{floor[1]:.1f}",
                f"{own[0] / floor[0]:.1f}", f"{own[1] / floor[1]:.1f}",
                "" if part.goal is None else f"{part.goal:g}",
            )  # fmt: skip
    copied, computed = np.median(rates, axis=0)
    report.show(table)
    report.say(f"probes: {copied:.1f} GB/s copied, {computed:.0f} GFLOP/s of multiply and add")


if __name__ == "__main__":
    with Report("simulation", sys.argv[1:]) as report:
        main(report, *map(int, report.arguments))
