"""Normals of splats."""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.kernels.device import Device
from usdsplat.kernels.normals.axes import thin_axes
from usdsplat.kernels.sim import normals as kernels
from usdsplat.sim.neighbors import Graph

FLAT = 0.3
"""Surfaceness from which a splat counts as part of a surface."""


SHEET = 0.7
"""Median surfaceness from which a field counts as a surface: white noise has 0.93 on a sheet and
0.4 to 0.5 in a volume."""


def manifold_dimension(surfaceness: F32) -> int:
    """Return 2 for splats on surfaces or 3 for splats that fill a volume, from the surfaceness of
    each, shape (n,)."""
    return 2 if len(surfaceness) == 0 or np.median(surfaceness) >= SHEET else 3


def axes(device: Device, rotations: F32, scales: F32) -> F32:
    """Return the thin axes of splats, of any sign.

    Args:
        device: Runs the kernels.
        rotations: Unit quaternions, shape (n, 4).
        scales: [unit], shape (n, 3).

    Returns:
        Unit vectors, shape (n, 3).
    """
    found: F32 = device.empty(scales.shape, np.float32)
    device.run(thin_axes, rotations, scales, found)
    return found


def captured(device: Device, graph: Graph, rotations: F32, scales: F32) -> F32:
    """Return the thin axes of captured splats, all on the outer side of each connected part.

    Args:
        device: Runs the kernels.
        graph: Neighbours of the splats; symmetric, so that connectivity does not depend on the
            order.
        rotations: Unit quaternions, shape (n, 4).
        scales: [unit], shape (n, 3).

    Returns:
        Unit vectors by row, shape (n, 3). In each connected part, the normal of the splat that is
        farthest from the mean of all positions points away from this mean. The signs of the others
        follow from their neighbours.
    """
    return oriented(device, graph, axes(device, rotations, scales))


def oriented(device: Device, graph: Graph, normals: F32) -> F32:
    """Return normals of rows, shape (n, 3), with signs as in `captured`."""
    n = len(normals)
    outward = np.zeros((n, 3), np.float32)
    sound = np.isfinite(graph.positions).all(axis=1)
    if sound.any():
        centre = graph.positions[sound].mean(axis=0, dtype=np.float64)
        outward[sound] = graph.positions[sound] - centre
    distance = np.einsum("ij,ij->i", outward, outward, dtype=np.float64)
    seeds = np.argsort(-distance, kind="stable")
    turned = normals[graph.order]
    queue, state = device.empty(n, np.int32), np.zeros(n, np.uint8)
    device.run(kernels.orient, turned, graph.rows, graph.neighbors, seeds, outward, queue, state)
    return turned[graph.rank]


def grown(device: Device, graph: Graph, before: F32) -> tuple[F32, F32]:
    """Return the normals of planes through neighbours, and their surfaceness.

    Args:
        device: Runs the kernels.
        graph: Neighbours of the splats.
        before: Normals by row whose signs are kept, and that stay where neighbours define no plane,
            shape (n, 3); zeros where there are none yet.

    Returns:
        Unit vectors by row, shape (n, 3), and surfaceness, shape (n,): 1 on a sheet, 0 where
        neighbours are all around. Below FLAT a splat is part of a volume.
    """
    normals: F32 = device.empty(before.shape, np.float32)
    surfaceness: F32 = device.empty(len(before), np.float32)
    device.run(
        kernels.planes, graph.positions, graph.support, graph.order, graph.rows, graph.neighbors,
        before, normals, surfaceness,
    )  # fmt: skip
    return normals, surfaceness
