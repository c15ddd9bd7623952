"""Redistribute splats evenly on their surface."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.core.progress import steps
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import relax as kernels
from usdsplat.sim import support as radii
from usdsplat.sim.neighbors import Graph, Neighbors
from usdsplat.sim.normals import FLAT, grown
from usdsplat.sim.parameters import Parameters

CONVERGED = 1e-3
"""Mean step, in spacings, below which further sweeps change almost nothing."""

Projection = Callable[[F32], tuple[F32, F32]]
"""Projects points onto a surface: returns positions and unit normals there, both shape (n, 3)."""


def relax(
    device: Device,
    positions: F32,
    normals: F32 | None,
    parameters: Parameters,
    iterations: int,
    surface: Projection | None = None,
    *,
    dimension: int = 2,
) -> tuple[F32, F32]:
    """Distribute splats evenly.

    Args:
        device: Runs the kernels.
        positions: [unit], shape (n, 3); not changed. Those that are not finite stay.
        normals: Initial unit normals, shape (n, 3); None computes them. They follow the surface;
            their signs do not matter.
        parameters: `relax:strength` and the group `neighbors`.
        iterations: Largest number of sweeps.
        surface: Surface that splats stay on; None uses the planes through neighbours.
        dimension: 2 moves splats along surfaces, 3 in all directions.

    Returns:
        Positions [unit], shape (n, 3), and radii of their neighbourhoods [unit], shape (n,).
    """
    positions = positions.copy()
    neighbors = Neighbors(device, parameters.neighbors, symmetric=True, seed=parameters.sim.seed)
    support = radii.fitted(neighbors, positions, dimension)
    if surface is not None:
        positions, normals = surface(positions)
    for _ in steps("even spacing", iterations):
        graph = neighbors.update(positions, support)
        if dimension == 3:
            normals = np.zeros_like(positions)
        elif surface is None or normals is None:
            normals = _planes(device, graph, normals)
        positions, moved = swept(device, graph, normals, parameters, dimension)
        count = radii.crowding(device, graph, dimension)
        support = radii.corrected(neighbors, support, count, dimension)
        if surface is not None:
            positions, normals = surface(positions)
        if moved < CONVERGED:
            break
    return positions, support


def swept(
    device: Device, graph: Graph, normals: F32, parameters: Parameters, dimension: int
) -> tuple[F32, float]:
    """Take one relaxation sweep.

    Args:
        device: Runs the kernels.
        graph: Symmetric neighbour lists.
        normals: Unit normals by row, shape (n, 3); splats with zeros move freely.
        parameters: `relax:strength` and `neighbors:target`.
        dimension: Dimension of the spacing, 2 or 3.

    Returns:
        Positions by row [unit], shape (n, 3), and the mean step in spacings.
    """
    n = len(graph.order)
    out: F32 = device.empty((n, 3), np.float32)
    moved = device.run(
        kernels.sweep, graph.positions, graph.support, normals[graph.order], graph.order,
        graph.rows, graph.neighbors, np.float32(spacing(parameters.neighbors.target, dimension)),
        np.float32(parameters.relax.strength), out,
    )  # fmt: skip
    return out, float(moved) / max(n, 1)


def spacing(target: float, dimension: int) -> float:
    """Return the ratio of the spacing to the radius within which each splat has `target`
    neighbours."""
    if dimension == 2:
        return math.sqrt(math.pi / target)
    return float((4 * math.pi / (3 * target)) ** (1 / 3))


def _planes(device: Device, graph: Graph, before: F32 | None) -> F32:
    """Return normals by row; zeros for splats with neighbours all around, which move freely."""
    start = np.zeros((len(graph.order), 3), np.float32) if before is None else before
    normals, surfaceness = grown(device, graph, start)
    normals[surfaceness < FLAT] = 0
    return normals
