"""Nuclei: where a pattern starts."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, I64
from usdsplat.kernels.device import Device
from usdsplat.kernels.points.nearest import nearest
from usdsplat.kernels.sim import reaction
from usdsplat.kernels.sim import seeds as kernels
from usdsplat.sim.neighbors import Graph
from usdsplat.sim.parameters import RdParameters

SEED_UV = (0.5, 0.25)
"""u and v in a nucleus."""

SEED_RADIUS = 5.0
"""Radius of a nucleus in lattice units; smaller ones die out."""


def nuclei(
    device: Device,
    positions: F32,
    parameters: RdParameters,
    scale: float,
    *,
    seed: int = 0,
    ids: I64 | None = None,
    selection: F32 | None = None,
    graph: Graph | None = None,
) -> F32:
    """Return the nucleus weight of each point, 0 or 1, shape (n,).

    Args:
        device: Runs the kernels.
        positions: [unit], shape (n, 3).
        parameters: `rd:seedMode` and `rd:seedDensity`. In the mode noise, the patches cover
            the same fraction of the points as separate balls of that density.
        scale: Length of a lattice unit [unit].
        seed: Seed of the random numbers.
        ids: Identities by which points are chosen, shape (n,); rows by default.
        selection: Weight of each point, shape (n,); None selects all.
        graph: Neighbours of the points. With it, every connected part whose expected number of
            nuclei is at least one half gets one, because a pattern does not spread from one part to
            another.
    """
    n, density = len(positions), parameters.seed_density
    result = np.zeros(n, np.float32)
    if parameters.seed_mode == "affectors":
        return result
    if parameters.seed_mode == "selection":
        return result + 1 if selection is None else (selection > 0.5).astype(np.float32)
    if n == 0 or density <= 0:
        return result
    drawn: F32 = device.empty(n, np.float32)
    if parameters.seed_mode == "noise":
        device.run(kernels.noise, positions, seed, 2 * SEED_RADIUS * scale, drawn)
        part = min(1.0, density * math.pi * SEED_RADIUS**2)
        result[np.argsort(-drawn, kind="stable")[: math.ceil(part * n)]] = 1
        return result
    every = np.arange(n, dtype=np.int64) if ids is None else ids
    device.run(kernels.draw, every, seed, drawn)
    chosen = drawn < density
    if graph is not None:
        _in_every_part(device, graph, density, drawn, chosen)
    if not chosen.any():  # a small capture still gets a pattern
        chosen[np.argmin(drawn)] = True
    _, distances = nearest(device, positions[chosen], positions, 1)
    result[distances[:, 0] <= SEED_RADIUS * scale] = 1
    return result


def _in_every_part(
    device: Device, graph: Graph, density: float, drawn: F32, chosen: npt.NDArray[np.bool_]
) -> None:
    """Choose the point with the lowest random number in each large part without a nucleus."""
    part = connected(device, graph)
    count = int(part.max(initial=-1)) + 1
    sizes = np.bincount(part, minlength=count)
    missing = (sizes * density >= 0.5) & (np.bincount(part, chosen, count) == 0)
    order = np.argsort(drawn, kind="stable")
    order = order[missing[part[order]]]
    _, first = np.unique(part[order], return_index=True)
    chosen[order[first]] = True


def connected(device: Device, graph: Graph) -> I32:
    """Return the number of the connected part that each point belongs to, shape (n,)."""
    n = len(graph.order)
    label, queue = np.full(n, -1, np.int32), np.empty(n, np.int32)
    device.run(kernels.parts, graph.rows, graph.neighbors, queue, label)
    return label[graph.rank]


def plant(device: Device, uv: F32, weight: F32) -> None:
    """Move u and v towards those of a nucleus, in place.

    Args:
        device: Runs the kernels.
        uv: Shape (n, 2).
        weight: Fraction of the way, 0 to 1, shape (n,).
    """
    u, v = (np.float32(each) for each in SEED_UV)
    device.run(reaction.seed, uv, weight, u, v)


def untouched(count: int) -> F32:
    """Return the initial u and v, shape (count, 2)."""
    return np.tile(np.array([1, 0], np.float32), (count, 1))
