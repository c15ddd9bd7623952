"""Carriers: evenly spaced points on a capture's surface, on which the reaction runs.

Captures have many splats where there is detail and few large ones elsewhere, so that a Laplacian on
the splats themselves is inaccurate. Instead, points are drawn on the ellipses of all visible
splats, a Poisson disk sample of them is taken, and it is relaxed until the Laplacian is accurate.

Sources: Lagae & Dutre 2008 on Poisson disks; Turk 1991 on relaxing points and reacting on them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, I64, SplatCloud
from usdsplat.core.progress import phase
from usdsplat.core.quaternion import to_matrix
from usdsplat.kernels.device import Device
from usdsplat.kernels.points.nearest import nearest
from usdsplat.kernels.sim import carriers as kernels
from usdsplat.sim.neighbors import Graph, Neighbors
from usdsplat.sim.normals import FLAT, grown, oriented
from usdsplat.sim.outside import outer_side
from usdsplat.sim.parameters import NeighborsParameters, Parameters, SimParameters
from usdsplat.sim.relaxing import relax, spacing
from usdsplat.sim.specs import Moment, Recipe
from usdsplat.sim.state import State
from usdsplat.sim.support import fitted
from usdsplat.sim.uses import Uses

MOST = 250_000
"""Largest number of carriers."""

FAINT = 0.1
"""Opacity below which a splat is not part of a surface."""

HUGE = 0.05
"""Standard deviation, in diagonals of the capture, above which a splat is background."""

EDGE = 1.2
"""Half axes of a splat's ellipse, in standard deviations."""

DRAWN = 64
"""Maximum number of points drawn per carrier if the distance is automatic."""
DENSITY = 4.0
"""Density of the points drawn on an ellipse [1/distance^2]: enough for a sample without gaps."""

MOST_POINTS = 256
"""Largest number of points on one ellipse."""

SWEEPS = 12, 8
"""Number of relaxation sweeps before and after dropping points that are too close on the
surface."""

CLOSEST = 0.8
"""Least distance after dropping, as a fraction of the least distance of the first sample."""

PER_DISTANCE = 1.25
"""Mean spacing of a Poisson disk sample, as a multiple of its least distance."""

FEWEST = 4
"""Number of neighbours below which a carrier is isolated and dropped."""

NEAREST = 8
"""Number of carriers whose values a splat interpolates."""

WIDEN = 1.2
"""Radius of the weights of these carriers, as a multiple of the distance to the farthest."""

ASKED = 20_000
"""Number of splats whose nearest neighbour shows the distance of all."""

CELL = 1.3
"""Edge of the cells that measure an area, in distances of points on it."""

CELL_HASH = (73_856_093, 19_349_663_017, 83_492_791_471)
"""Primes with which cells are numbered; equal numbers of different cells are rare enough."""

PACKED = 0.47
"""Number of carriers whose distance is the edge of these cells, per occupied cell."""

NEAR, WEIGHTS = "carriers:near", "carriers:weights"
"""In `State.memory`: carriers that a splat follows and reads, and their weights, (n, 8)."""
REACH = 3.0
"""Distance to the nearest carrier above which a splat reads none, in spacings."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Binding:
    """Carriers that n splats read, and their weights; constant while both are at rest."""

    near: I32
    """Carriers, nearest first, -1 for none, shape (n, 8)."""
    weights: F32
    """Weights; rows sum to 1, or to 0 far from all carriers, shape (n, 8)."""

    @classmethod
    def kept(cls, state: State) -> Binding:
        """Return what `keep` stored, with a row for each splat that the state has now."""
        return cls(near=state.memory[NEAR], weights=state.memory[WEIGHTS])

    def keep(self, state: State) -> None:
        """Store the binding in a state, where it follows births and deaths."""
        state.memory[NEAR], state.memory[WEIGHTS] = self.near, self.weights

    def read(self, device: Device, uv: F32) -> F32:
        """Interpolate u and v of the carriers, shape (c, 2), at the splats, shape (n, 2); (1, 0)
        far from all carriers."""
        out: F32 = device.empty((len(self.near), 2), np.float32)
        device.run(kernels.read, self.near, self.weights, uv, out)
        return out


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Carriers:
    """c points on a capture at rest."""

    positions: F32
    """Positions [unit], shape (c, 3)."""
    normals: F32
    """Unit normals, on the outer side, shape (c, 3)."""
    outer: npt.NDArray[np.bool_]
    """Whether a carrier is on the outside, not inside the capture, shape (c,)."""
    dimension: F32
    """2 on surfaces, 3 where neighbours are all around, shape (c,)."""
    graph: Graph
    """Neighbours of each carrier."""
    spacing: float
    """Approximate distance of neighbours [unit]."""

    @classmethod
    def of(
        cls,
        device: Device,
        cloud: SplatCloud,
        *,
        distance: float = -1.0,
        seed: int = 0,
        target: float = 16.0,
        most: int = MOST,
        up: tuple[float, float, float] | None = None,
    ) -> Carriers:
        """Distribute points evenly over a capture.

        Args:
            device: Runs the kernels.
            cloud: The capture at rest. Splats that are faint, huge or not finite get no carriers.
            distance: Distance of neighbours [unit]; larger where there would be more than `most`.
                Negative takes the median distance of the capture's splats.
            seed: Seed of the random numbers.
            target: Target number of neighbours of each carrier.
            most: Largest number of carriers.
            up: Unit vector upwards in the capture's space; None if unknown.
        """
        rows = np.flatnonzero(_is_surface(cloud))
        ellipses = _Ellipses.of(cloud, rows)
        sample, closest = _sample(device, ellipses, distance, seed, most)
        even = _relax(device, sample, closest, seed, target, SWEEPS[0])
        priority = np.arange(len(even), dtype=np.float32)
        even = even[poisson_disk(device, even, priority, CLOSEST * closest)]
        even = _relax(device, even, closest, seed, target, SWEEPS[1])
        neighbors = Neighbors(device, NeighborsParameters(target=target, skin=0.0), seed=seed)
        graph = neighbors.update(even, fitted(neighbors, even, 2))
        kept = np.diff(graph.rows) >= FEWEST
        even = even[graph.order[kept]]
        graph = neighbors.update(even, fitted(neighbors, even, 2))
        even = even[graph.order]
        slots: I32 = np.arange(len(even), dtype=np.int32)
        graph = replace(graph, order=slots, rank=slots)  # slots are rows
        normals, surfaceness = grown(device, graph, np.zeros_like(even))
        normals, outer = outer_side(
            even, oriented(device, graph, normals), graph.rows, graph.neighbors,
            PER_DISTANCE * closest, up,
        )  # fmt: skip
        return cls(
            positions=even,
            normals=normals,
            outer=outer,
            dimension=np.where(surfaceness < FLAT, 3, 2).astype(np.float32),
            graph=graph,
            spacing=PER_DISTANCE * closest,
        )

    def __len__(self) -> int:
        return len(self.positions)

    def bind(self, device: Device, points: F32) -> Binding:
        """Find the carriers that points at rest read, and their weights.

        Args:
            device: Runs the kernels.
            points: [unit], shape (n, 3).
        """
        near, _ = nearest(device, self.positions, points, NEAREST)
        weights: F32 = device.empty(near.shape, np.float32)
        device.run(
            kernels.bind, points, self.positions, near, np.float32(REACH * self.spacing),
            np.float32(WIDEN), weights,
        )  # fmt: skip
        return Binding(near=near, weights=weights)


def carriers_of(device: Device, recipe: Recipe, uses: Uses, first: Moment) -> Carriers | None:
    """Return the carriers of a field, one set for pattern, matter and transport, or None if nothing
    needs them.

    Args:
        device: Runs the kernels.
        recipe: The field.
        uses: What its simulation needs.
        first: Values of the stage at the first frame.
    """
    p = first.parameters
    has_pattern = uses.reacts and p.rd.domain == "carrier"
    if not (has_pattern or uses.coheres or uses.transports):
        return None
    distance, most = p.carriers.spacing, MOST
    if distance <= 0 and has_pattern:
        distance = p.rd.pattern_scale
    elif distance <= 0:
        most = p.carriers.count
    with phase("carriers", work=len(recipe.rest)):
        return Carriers.of(
            device, recipe.rest, distance=distance, seed=p.sim.seed, target=p.neighbors.target,
            most=most, up=first.up,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Ellipses:
    """The ellipses spanned by the two larger axes of splats."""

    centres: F32
    long: F32
    """Half axes [unit], shape (n, 3)."""
    short: F32
    ids: I64

    @classmethod
    def of(cls, cloud: SplatCloud, rows: I64) -> _Ellipses:
        scales = cloud.scales[rows]
        axes = to_matrix(cloud.rotations[rows].astype(np.float64))
        order = np.argsort(-scales, axis=1, kind="stable")
        every = np.arange(len(rows))
        long, short = (
            (EDGE * scales[every, order[:, i], None] * axes[every, :, order[:, i]]).astype(
                np.float32
            )
            for i in range(2)
        )
        return cls(
            centres=np.ascontiguousarray(cloud.positions[rows]),
            long=long,
            short=short,
            ids=rows if cloud.ids is None else cloud.ids[rows],
        )

    def counts(self, distance: float) -> I64:
        """Return the number of points on each ellipse for a sample of this distance, shape (n,)."""
        half = np.linalg.norm(self.long, axis=1).astype(np.float64)
        wide = np.maximum(np.linalg.norm(self.short, axis=1), distance / 4)
        counts = np.minimum(1 + np.pi * DENSITY * half * wide / distance**2, MOST_POINTS)
        return np.where(half < distance / 2, 1, counts).astype(np.int64)

    def points(self, device: Device, distance: float, seed: int) -> tuple[F32, F32]:
        """Draw candidates for a Poisson disk sample on all ellipses.

        Returns:
            Points [unit], shape (m, 3), and their priority, shape (m,). Candidates are tried in
            ascending priority; centres come first.
        """
        counts = self.counts(distance)
        first = np.zeros(len(counts) + 1, np.int64)
        np.cumsum(counts, out=first[1:])
        points: F32 = device.empty((int(first[-1]), 3), np.float32)
        priority: F32 = device.empty(int(first[-1]), np.float32)
        device.run(
            kernels.scatter, self.centres, self.long, self.short, self.ids, first, seed, points,
            priority,
        )  # fmt: skip
        return points, priority


def _is_surface(cloud: SplatCloud) -> np.ndarray:
    """Return which splats are part of a surface, shape (n,)."""
    sound = np.isfinite(cloud.positions).all(axis=1) & np.isfinite(cloud.scales).all(axis=1)
    sound &= cloud.opacities >= FAINT
    if not sound.any():
        return sound
    low, high = np.percentile(cloud.positions[sound], [2, 98], axis=0)
    diagonal = float(np.linalg.norm(high - low))
    return sound & (cloud.scales.max(axis=1) <= HUGE * diagonal) if diagonal > 0 else sound


def _sample(
    device: Device, ellipses: _Ellipses, distance: float, seed: int, most: int
) -> tuple[F32, float]:
    """Return at most `most` points no closer than a distance, and that distance [unit]."""
    if distance <= 0:
        _, apart = nearest(device, ellipses.centres, ellipses.centres, 2)
        apart = apart[np.isfinite(apart[:, -1]) & (apart[:, -1] > 0), -1]
        distance = float(np.median(apart)) if len(apart) else 1.0
        # where many splats overlap, far more points are drawn than can be kept
        drawn = int(ellipses.counts(distance).sum())
        distance *= math.sqrt(max(1.0, drawn / max(DRAWN * most, 4 * len(ellipses.ids))))
    else:
        distance /= PER_DISTANCE
    while True:
        points, priority = ellipses.points(device, distance, seed)
        kept = poisson_disk(device, points, priority, distance)
        if len(kept) <= most:
            return points[kept], distance
        distance *= 1.01 * math.sqrt(len(kept) / most)


def poisson_disk(device: Device, points: F32, priority: F32, distance: float) -> I64:
    """Return the rows of points to keep, ascending, none closer than `distance` to another."""
    n = len(points)
    kept = np.zeros(n, np.bool_)
    table = np.full(max(64, 1 << math.ceil(math.log2(n + 1))), -1, np.int32)
    following: I32 = device.empty(n, np.int32)
    order = _ascending(priority)
    device.run(kernels.throw, points, priority, order, distance, table, following, kept)
    return np.flatnonzero(kept)


def _ascending(priority: F32) -> I64:
    """Return the rows by ascending priority, none of them negative, then ascending.

    Numbers whose upper half is the priority and whose lower half the row are sorted in half the
    time of a stable sort.
    """
    keys = priority.view(np.uint32).astype(np.uint64) << np.uint64(32)
    keys |= np.arange(len(priority), dtype=np.uint64)
    keys.sort()
    return (keys & np.uint64(0xFFFFFFFF)).view(np.int64)


def _relax(
    device: Device, points: F32, closest: float, seed: int, target: float, sweeps: int
) -> F32:
    """Move points along their surface until they are evenly spaced.

    All have the same radius: radii that follow density would preserve clusters and gaps.
    """
    radius = PER_DISTANCE * closest / spacing(target, 2)
    parameters = Parameters(
        sim=SimParameters(seed=seed),
        neighbors=NeighborsParameters(target=target, h_min=radius, h_max=radius),
    )
    return relax(device, points, None, parameters, sweeps)[0]


def expected_spacing(
    device: Device, cloud: SplatCloud, *, seed: int = 0, most: int = MOST
) -> float:
    """Return about the spacing that `Carriers.of` would choose, in a fraction of its time.

    The area of the capture is that of the cells that points on its ellipses are in.

    Args:
        device: Runs the kernels.
        cloud: The capture at rest.
        seed: Seed of the random numbers.
        most: Largest number of carriers.

    Returns:
        [unit]; 0 if all splats that are part of a surface are at one point.
    """
    rows = np.flatnonzero(_is_surface(cloud))
    if not len(rows):
        rows = np.flatnonzero(np.isfinite(cloud.positions).all(axis=1))
    ellipses = _Ellipses.of(cloud, rows)
    some = ellipses.centres[:: max(1, len(rows) // ASKED)]
    apart = nearest(device, ellipses.centres, some, 2)[1][:, -1]
    apart = apart[np.isfinite(apart) & (apart > 0)]
    if not len(apart):
        return 0.0
    distance = float(np.median(apart))
    drawn = int(ellipses.counts(distance).sum())
    cell = CELL * distance * math.sqrt(max(1.0, drawn / (4 * most)))
    points, _ = ellipses.points(device, cell / CELL, seed)
    x, y, z = np.floor(points / np.float32(cell)).astype(np.int64).T
    occupied = len(np.unique(x * CELL_HASH[0] ^ y * CELL_HASH[1] ^ z * CELL_HASH[2]))
    wanted = PACKED * occupied * (cell / distance) ** 2
    return PER_DISTANCE * distance * math.sqrt(max(1.0, wanted / most))
