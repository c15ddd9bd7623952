"""Adapt radii so that each splat has about the target number of neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.kernels.device import Device
from usdsplat.kernels.points.nearest import nearest
from usdsplat.kernels.sim import support as kernels
from usdsplat.sim.neighbors import Graph, Neighbors

STEPS = 8
"""Largest number of control steps for the first radii."""
TOLERANCE, PART = 0.1, 0.99
"""Radii fit where this fraction (the second) of the counts is within this tolerance (the first) of
the target."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Neighborhood:
    """Surface and density of n splats, from their neighbours."""

    normals: F32
    """Unit normals at rest, 0 where there is no surface, shape (n, 3)."""
    crowding: F32
    """Number of neighbours relative to the target, shape (n,)."""
    dimension: int
    """2 on surfaces, 3 in volumes."""
    target: float
    """Target number of neighbours."""
    usual_support: float
    """Median radius of a neighbourhood at the beginning [unit]."""


def crowding(device: Device, graph: Graph, dimension: int) -> F32:
    """Return the smooth number of neighbours of each row, shape (n,); at even density, the number
    of splats in its circle (dimension 2) or ball (3)."""
    out: F32 = device.empty(len(graph.order), np.float32)
    device.run(
        kernels.crowding, graph.positions, graph.support, graph.order, graph.rows, graph.neighbors,
        np.float32(kernels.FACTOR[dimension]), out,
    )  # fmt: skip
    return out


def corrected(neighbors: Neighbors, support: F32, count: F32, dimension: int) -> F32:
    """Return the radii after one control step towards the target [unit], within the limits of the
    last build.

    Args:
        neighbors: Neighbour lists of which `count` is the crowding.
        support: Radii that were used for counting [unit], shape (n,).
        count: Shape (n,).
        dimension: 2 or 3.
    """
    parameters = neighbors.parameters
    least, most = neighbors.limits
    clamped = neighbors.clamped(support)
    out: F32 = neighbors.device.empty(len(support), np.float32)
    neighbors.device.run(
        kernels.control, clamped, count, np.float32(parameters.target),
        np.float32(parameters.gain / dimension), np.float32(least), np.float32(most), out,
    )  # fmt: skip
    return out


def fits(neighbors: Neighbors, support: F32, count: F32) -> bool:
    """Return whether nearly all splats whose radius is not at a limit have about the target number
    of neighbours."""
    least, most = (np.float32(each) for each in neighbors.limits)
    clamped = neighbors.clamped(support)
    judged = count[(clamped > least) & (clamped < most)]
    target = neighbors.parameters.target
    close = np.abs(judged - target) <= TOLERANCE * target
    return bool(close.sum() >= PART * len(judged))


def fitted(neighbors: Neighbors, positions: F32, dimension: int, steps: int = STEPS) -> F32:
    """Return initial radii [unit], shape (n,), with about the target number of neighbours.

    Args:
        neighbors: Neighbour lists to count with; afterwards they are those of the result, or
            nearly.
        positions: [unit], shape (n, 3).
        dimension: 2 or 3.
        steps: Largest number of control steps; 0 for the first guess.
    """
    support = first_guess(neighbors, positions)
    for _ in range(steps):
        count = crowding(neighbors.device, neighbors.update(positions, support), dimension)
        if fits(neighbors, support, count):
            break
        support = corrected(neighbors, support, count, dimension)
    return neighbors.clamped(support)


def first_guess(neighbors: Neighbors, positions: F32) -> F32:
    """Return the distance to the k-th nearest neighbour, where k is the target number, or to the
    farthest if there are fewer [unit], shape (n,); 1 for a single splat."""
    k = round(neighbors.parameters.target) + 1
    _, distances = nearest(neighbors.device, positions, positions, k)
    radii: F32 = np.where(np.isfinite(distances), distances, 0).max(axis=1)
    return np.where(radii > 0, radii, 1).astype(np.float32)
