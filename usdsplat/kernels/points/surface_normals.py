"""Normals of splats that a lighter can use, how far to trust them, and occlusion.

The steps, each a kernel of `kernels.normals`:

    planes             plane through 24 neighbours, weighted by opacity and area
    look_around        in which directions each fourth splat sees least matter
    begin              normal of the plane on sheets, the open direction in fuzzy matter
    align              averages over neighbours, of any sign
    links, contract    one outer side for all splats together
    smooth             averages over neighbours of like colour, which keep edges
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core import quaternion
from usdsplat.core.cloud import F32, I32
from usdsplat.kernels.device import Device
from usdsplat.kernels.normals import openness, planes, sides, smoothing
from usdsplat.kernels.normals.axes import thin_axes
from usdsplat.kernels.points.curve_order import curve_order
from usdsplat.kernels.points.nearest import nearest
from usdsplat.kernels.points.optical_grids import OpticalGrids

NEIGHBORS = 24
"""Number of neighbours of a splat."""
CELL = 1.5
"""Edge of the grids' finest cells, in median distances of the sixth neighbour."""
DIRECTIONS = 26
"""Number of rays of a splat."""
STRIDE = 4
"""Number of splats, neighbours on the curve, that share rays."""
ALIGNMENTS, PASSES = 2, 8
"""Number of averages of normals of any sign, and of oriented normals."""

Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SurfaceNormals:
    """Normals of n splats."""

    normals: F32
    """Unit vectors that point out of the matter, shape (n, 3)."""
    confidence: F32
    """From 1 on flat sheets to 0 in a volume and for strays, shape (n,)."""
    occlusion: F32
    """Part of the sky above each splat that other splats hide, weighted by the cosine to its
    normal, from 0 to 1, shape (n,)."""


def surface_normals(
    device: Device,
    positions: F32,
    rotations: F32,
    scales: F32,
    opacities: F32,
    colors: F32 | None = None,
) -> SurfaceNormals:
    """Return the normals of the surfaces that splats lie on.

    The result does not depend on the unit, or on the number of threads.

    Args:
        device: Runs the kernels.
        positions: [unit], shape (n, 3).
        rotations: Quaternions, (w, x, y, z), shape (n, 4).
        scales: Standard deviations [unit], shape (n, 3).
        opacities: [0..1], shape (n,).
        colors: Colours of the splats, [0..1] as displayed, shape (n, 3): normals are not averaged
            over edges of colour. None if all are alike.

    Returns:
        Finite unit vectors, confidences and occlusions, for all splats. Splats that are not finite,
        strays, and fewer than seven splats have confidence 0; the normals of the last are their
        thin axes. Normals of a closed surface point
        outwards; those of a sheet that is open on both sides agree, and point to the middle of the
        capture.
    """
    n = len(positions)
    if n == 0:
        nothing = np.zeros(0, np.float32)
        return SurfaceNormals(
            normals=np.zeros((0, 3), np.float32), confidence=nothing, occlusion=nothing
        )
    order = curve_order(device, positions)
    cloud = _Sorted.of(order, positions, rotations, scales, opacities, colors)
    computed = _computed(device, cloud) if n > planes.FEWEST else _of_few(device, cloud)
    found = SurfaceNormals(
        normals=np.empty((n, 3), np.float32),
        confidence=np.empty(n, np.float32),
        occlusion=np.empty(n, np.float32),
    )
    found.normals[order] = computed.normals
    found.confidence[order] = computed.confidence
    found.occlusion[order] = computed.occlusion
    return found


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Sorted:
    """Splats along the curve, without values that are not finite, except positions."""

    positions: F32
    rotations: F32
    scales: F32
    opacities: F32
    colors: F32
    weights: F32
    """Opacity times area [unit^2], shape (n,)."""

    @classmethod
    def of(
        cls,
        order: I32,
        positions: F32,
        rotations: F32,
        scales: F32,
        opacities: F32,
        colors: F32 | None,
    ) -> _Sorted:
        with np.errstate(all="ignore"):  # what is not finite is replaced
            turns = quaternion.normalize(rotations[order].astype(np.float64)).astype(np.float32)
        sizes, opaque = scales[order], np.clip(opacities[order], 0, 1)
        sound = np.isfinite(turns).all(axis=1) & np.isfinite(sizes).all(axis=1)
        sound &= np.isfinite(opaque)
        turns[~sound] = np.array([1, 0, 0, 0], np.float32)
        sizes = np.where(sound[:, None], sizes, np.float32(0))
        opaque = np.where(sound, opaque, np.float32(0))
        shades = np.zeros((len(order), 3), np.float32)
        if colors is not None:
            shades = np.clip(np.nan_to_num(colors[order]), 0, 1).astype(np.float32)
        larger = np.sort(sizes, axis=1)[:, 1:]
        return cls(
            positions=np.ascontiguousarray(positions[order]),
            rotations=turns,
            scales=np.ascontiguousarray(sizes, np.float32),
            opacities=opaque.astype(np.float32),
            colors=shades,
            weights=opaque * larger[:, 0] * larger[:, 1],
        )


def _of_few(device: Device, cloud: _Sorted) -> SurfaceNormals:
    """Return the thin axes of splats that define no surface."""
    n = len(cloud.positions)
    axes, nothing = np.empty((n, 3), np.float32), np.zeros(n, np.float32)
    device.run(thin_axes, cloud.rotations, cloud.scales, axes)
    return SurfaceNormals(normals=axes, confidence=nothing, occlusion=nothing)


def _computed(device: Device, cloud: _Sorted) -> SurfaceNormals:
    """Return the normals of splats along the curve."""
    n, run, keep = len(cloud.positions), device.run, device.keep
    found, apart = nearest(device, cloud.positions, cloud.positions, NEIGHBORS + 1)
    neighbors, distances = keep(found), keep(apart)
    axes, normals, other = (device.resident((n, 3), np.float32) for _ in range(3))
    flatness, contrast = (device.resident(n, np.float32) for _ in range(2))
    positions, colors = keep(cloud.positions), keep(cloud.colors)
    run(
        planes.planes, positions, keep(cloud.rotations), keep(cloud.scales), keep(cloud.weights),
        neighbors, distances, axes, flatness,
    )  # fmt: skip
    grids = OpticalGrids.of(
        device, cloud.positions, cloud.rotations, cloud.scales, cloud.opacities,
        cell=CELL * spacing(apart),
    )  # fmt: skip
    sampled = device.resident((-(-n // STRIDE), openness.VIEW), np.float32)
    run(
        openness.look_around, keep(grids.positions), axes, STRIDE, keep(grids.density),
        keep(sphere_directions(DIRECTIONS)), 4.0 * grids.extent, sampled,
    )  # fmt: skip
    views = device.resident((n, openness.VIEW), np.float32)
    run(
        smoothing.begin, axes, flatness, neighbors, colors, sampled, STRIDE, views, contrast,
        normals,
    )  # fmt: skip
    for _ in range(ALIGNMENTS):
        run(smoothing.align, normals, flatness, neighbors, colors, contrast, other)
        normals, other = other, normals
    weights, pull = device.resident((n, sides.NEAREST), np.int32), device.empty(n, np.int64)
    run(
        sides.links, positions, grids.middle, grids.extent * grids.cell, normals, flatness,
        views, neighbors, distances, weights, pull,
    )  # fmt: skip
    side = outer_sides(device, device.fetch(weights), found, pull)
    oriented = device.fetch(normals) * side[:, None]
    normals, agreement = device.move(oriented), device.resident(n, np.float32)
    for turn in range(PASSES):
        run(
            smoothing.smooth, normals, flatness, views, neighbors, colors, contrast, turn, other,
            agreement,
        )  # fmt: skip
        normals, other = other, normals
    hidden = device.resident(n, np.float32)
    run(openness.occlusion, normals, views, hidden)
    return SurfaceNormals(
        normals=device.fetch(normals),
        confidence=np.clip(device.fetch(flatness) * device.fetch(agreement), 0, 1),
        occlusion=device.fetch(hidden),
    )


def spacing(distances: F32) -> float:
    """Return the median distance of the sixth neighbour [unit], or 1 if there is none.

    Args:
        distances: Distances of the nearest splats, the splat itself among them, shape (n, k).
    """
    apart = distances[:, min(planes.FEWEST, distances.shape[1] - 1)]
    apart = apart[np.isfinite(apart) & (apart > 0)]
    return float(np.median(apart)) if len(apart) else 1.0


def sphere_directions(count: int) -> F32:
    """Return unit vectors that are evenly distributed over all directions, shape (count, 3).

    Source: Gonzalez 2010, "Measurement of areas on a sphere using Fibonacci lattices".
    """
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    turn = k * np.pi * (3 - math.sqrt(5))
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1).astype(np.float32)


def outer_sides(device: Device, weights: I32, neighbors: I32, pull: Any) -> npt.NDArray[np.int8]:
    """Return 1 or -1 for each splat: the signs that agree best with links and pulls.

    Args:
        device: Runs the kernels.
        weights, pull: Results of `sides.links`.
        neighbors: Rows of the nearest splats, the splat itself first, shape (n, k).
    """
    run, n = device.run, len(weights)
    links = 2 * int(np.count_nonzero(weights))
    graphs = [_Links.of(n, links), _Links.of(n, links)]
    graphs[0].pull[:] = pull
    run(sides.collect, weights, neighbors, *graphs[0].lists)
    parent, number = np.empty(n + 1, np.int32), np.empty(n + 1, np.int32)
    sign, side = np.empty(n + 1, np.int8), np.ones(n, np.int8)
    label, mark, count = np.arange(n, dtype=np.int32), np.full(n, -1, np.int64), n
    while count:
        graph, other = graphs
        joined = run(sides.choose, count, *graph.lists, graph.pull, parent, sign, mark)
        if not joined:
            break
        left = run(sides.find_roots, count, parent, sign, number)
        run(sides.relabel, parent, sign, number, label, side)
        run(
            sides.contract, count, *graph.lists, graph.pull, parent, sign, number, left, other.pull,
            *other.lists,
        )  # fmt: skip
        graphs, count = [other, graph], left
    return side


@dataclass(frozen=True, slots=True, eq=False)
class _Links:
    """Links of the nodes of a graph, see `sides.collect`."""

    starts: npt.NDArray[np.int64]
    others: I32
    weights: npt.NDArray[np.int64]
    pull: npt.NDArray[np.int64]

    @classmethod
    def of(cls, nodes: int, links: int) -> _Links:
        return cls(
            np.empty(nodes + 1, np.int64),
            np.empty(links, np.int32),
            np.empty(links, np.int64),
            np.empty(nodes, np.int64),
        )

    @property
    def lists(self) -> tuple[Any, ...]:
        return self.starts, self.others, self.weights
