"""Neighbour lists that are kept until a splat has moved far.

Lists are built with radii enlarged by a skin and kept until a neighbour might be missing. They may
contain splats beyond the radius, so that callers must test the distance. Source: Verlet 1967.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, I64
from usdsplat.kernels.device import Device
from usdsplat.kernels.points.cells import Cells, into_cells
from usdsplat.kernels.points.nearest import nearest
from usdsplat.kernels.sim import grid, lists
from usdsplat.sim.parameters import NeighborsParameters

__all__ = ["Graph", "Neighbors", "nearest"]

WIDEST_RATIO = 8.0
"""Largest ratio of the radii that one grid serves."""
WAVE = 1 << 26
"""Maximum number of neighbours in the buffer of one search; larger searches are split."""
SAMPLE = 1 << 16
"""Approximate number of radii that the median is computed from."""

NOBODY = np.zeros(0, np.int32)

Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Graph:
    """n splats in the order of their cells, one slot each, and the neighbours of each."""

    order: I32
    """Row of each slot, shape (n,)."""
    rank: I32
    """Slot of each row, shape (n,)."""
    rows: I64
    """The neighbours of slot s are `neighbors[rows[s]:rows[s + 1]]`, shape (n + 1,)."""
    neighbors: I32
    """Slots, ascending in each list: all within the radius, and some up to a skin beyond it."""
    positions: F32
    """Position of each slot now [unit], shape (n, 3); coincident ones are separated a little."""
    support: F32
    """Radius h of each slot now [unit], clamped, shape (n,); 0 where it was not a number."""
    dropped: int
    """Lists that were longer than `k_max` and lost their farthest neighbours."""
    build: int
    """Number of builds so far. Graphs of the same build differ in positions and radii only."""


class _Slots(NamedTuple):
    """n splats in the order of their cells. Arrays are the device's, except `order`."""

    cells: Cells
    order: I32
    """For each slot, a place in the order of cells: the row of its splat, shape (n,)."""
    rank: Any
    """For each row, a splat in the order of the field: its slot, shape (n,)."""
    positions: Any
    """Position of each slot [unit], shape (n, 3)."""
    radii: Any
    """Radius of each slot, clamped [unit], shape (n,)."""

    def twins(self, device: Device) -> Flags:
        """Return which slots share their position with another one, shape (n,)."""
        out = device.resident(len(self.order), np.bool_)
        how = self.cells.start, self.cells.inverse, self.cells.bits
        device.run(lists.coincident, self.positions, self.radii, *how, out)
        return device.fetch(out)


class Neighbors:
    """Neighbour lists that are rebuilt when necessary.

    Args:
        device: Runs the kernels.
        parameters: Skin, limits of the radius, longest list. May be replaced at any time.
        symmetric: Whether i and j are neighbours of each other if either is within the other's
            radius.
        seed: Seed of the random numbers that separate coincident splats.
    """

    def __init__(
        self,
        device: Device,
        parameters: NeighborsParameters,
        *,
        symmetric: bool = False,
        seed: int = 0,
    ) -> None:
        self.device = device
        self.parameters = parameters
        self.symmetric = symmetric
        self.seed = seed
        self.limits = (0.0, math.inf)
        """Least and largest radius at the last build [unit]."""
        self._graph: Graph | None = None
        self._built: tuple[F32, F32, NeighborsParameters] | None = None
        self._twins: Flags = np.zeros(0, np.bool_)
        self._latest: tuple[F32, F32] | None = None

    def update(self, positions: F32, support: F32) -> Graph:
        """Return the neighbours now; the same object as before if nothing has changed.

        Args:
            positions: [unit], shape (n, 3). Splats that are not finite have no neighbours.
            support: Radii h [unit], shape (n,).
        """
        if self._graph is None or self._latest is None or self._built is None:
            return self._build(positions, support, 0)
        if _lists(self._built[2]) == _lists(self.parameters) and _equal(
            self._latest, (positions, support)
        ):
            return self._graph
        if self._is_stale(positions, support):
            return self._build(positions, support, self._graph.build)
        return self._refresh(self._graph, positions, support)

    def memory(self) -> dict[str, npt.NDArray[Any]]:
        """Return what the next rebuild and the order of lists depend on; empty before the first
        build."""
        if self._built is None or self._graph is None:
            return {}
        positions, support, parameters = self._built
        return {
            "positions": positions,
            "support": support,
            "limits": np.array([parameters.h_min, parameters.h_max, parameters.skin]),
            "counts": np.array([parameters.k_max, self._graph.build], np.int64),
        }

    def restore(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        """Restore the result of `memory`, bit for bit."""
        self._graph = self._built = self._latest = None
        if not memory:
            return
        now = self.parameters
        h_min, h_max, skin = (float(each) for each in memory["limits"])
        k_max, build = (int(each) for each in memory["counts"])
        self.parameters = NeighborsParameters(
            target=now.target, gain=now.gain, h_min=h_min, h_max=h_max, skin=skin, k_max=k_max
        )
        self._build(memory["positions"], memory["support"], build - 1)
        self.parameters = now

    def clamped(self, support: F32) -> F32:
        """Return radii clamped to the limits of the last build; 0 where they are not positive
        numbers."""
        least, most = self.limits
        radii = np.where(support > 0, np.clip(support, least, most), 0)
        return radii.astype(np.float32, copy=False)

    def _is_stale(self, positions: F32, support: F32) -> bool:
        assert self._built is not None
        built, built_support, parameters = self._built
        if len(built) != len(positions) or _lists(parameters) != _lists(self.parameters):
            return True
        place, before = self.device.move(positions), self.device.keep(built)
        gone = self.device.run(lists.drift, place, before)
        if not math.isfinite(gone):
            return True
        now, then = self.clamped(support), self.clamped(built_support)
        skin = self.parameters.skin
        ratio = math.exp(skin / 2)
        late = self.device.run(lists.stale, place, now, before, then, skin, ratio, gone)
        return bool(late)

    def _build(self, positions: F32, support: F32, builds: int) -> Graph:
        self.limits = _limits(self.parameters, support)
        self._twins = np.zeros(len(positions), np.bool_)
        slots = self._slots(positions, support)
        twins = slots.twins(self.device)
        if twins.any():
            self._twins = twins[self.device.fetch(slots.rank)]
            slots = self._slots(positions, support)
        self._graph = graph = self._lists(slots, builds + 1)
        self._built = positions.copy(), support.copy(), self.parameters
        self._latest = self._built[:2]
        return graph

    def _refresh(self, old: Graph, positions: F32, support: F32) -> Graph:
        apart = self._apart(positions, support)
        _, place, radius = self._in_slots(apart, support, self.device.keep(old.order))
        self._graph = Graph(
            order=old.order,
            rank=old.rank,
            rows=old.rows,
            neighbors=old.neighbors,
            positions=self.device.publish(place),
            support=self.device.publish(radius),
            dropped=old.dropped,
            build=old.build,
        )
        self._latest = positions.copy(), support.copy()
        return self._graph

    def _in_slots(self, positions: Any, support: F32, order: Any) -> tuple[Any, Any, Any]:
        """Return the slot of each row, then positions and radii of each slot, on the device.

        positions: With coincident splats separated; order: row of each slot.
        """
        n, resident = order.shape[0], self.device.resident
        rank, place, radius = (
            resident(n, np.int32),
            resident((n, 3), np.float32),
            resident(n, np.float32),
        )
        clamped = self.clamped(support)
        self.device.run(grid.to_slots, order, positions, clamped, rank, place, radius)
        return rank, place, radius

    def _apart(self, positions: F32, support: F32) -> F32:
        """Return positions with coincident splats separated a little."""
        if not self._twins.any():
            return positions
        out: F32 = self.device.empty(positions.shape, np.float32)
        radii = self.clamped(support)
        self.device.run(lists.separate, positions, radii, self.seed, self._twins, out)
        return out

    def _slots(self, positions: F32, support: F32) -> _Slots:
        """Sort splats by cell, coincident ones separated a little."""
        apart = self.device.move(self._apart(positions, support))
        cells = into_cells(self.device, apart, self._edge(support))
        order = self.device.publish(cells.order)
        slots = self._in_slots(apart, support, self.device.keep(order))
        return _Slots(cells, order, *slots)

    def _lists(self, slots: _Slots, build: int) -> Graph:
        """Return the neighbour lists of splats that are sorted by cell."""
        n, device, cells = len(slots.order), self.device, slots.cells
        rank, place, radius = map(device.publish, (slots.rank, slots.positions, slots.radii))
        skin = 1.0 + self.parameters.skin
        widest = float(radius.max(initial=0)) * skin * (1 + 1e-6) if self.symmetric else 0.0
        reach = device.move(radius * np.float32(skin))
        k_max = self.parameters.k_max
        rows = np.zeros(n + 1, np.int64)
        wave = max(1, WAVE // (k_max * grid.BLOCK))
        blocks = math.ceil(n / grid.BLOCK)
        found = device.resident(min(wave, blocks) * grid.BLOCK * k_max, np.int32)
        pieces, dropped = [], 0
        for first in range(0, blocks, wave):
            count = min(wave, blocks - first)
            begin, end = first * grid.BLOCK, min(n, (first + count) * grid.BLOCK)
            cut = np.empty(count, np.int64)
            device.run(
                lists.search, slots.positions, reach, np.float32(widest), cells.start,
                cells.inverse, cells.bits, k_max, begin, found, rows[1:], cut,
            )  # fmt: skip
            piece = device.resident(int(rows[begin + 1 : end + 1].sum()), np.int32)
            local = np.zeros(end - begin + 1, np.int64)
            np.cumsum(rows[begin + 1 : end + 1], out=local[1:])
            device.run(lists.pack, found, k_max, count, local, piece)
            pieces.append(device.publish(piece))
            dropped += int(cut.sum())
        np.cumsum(rows, out=rows)
        return Graph(
            order=slots.order,
            rank=rank,
            rows=rows,
            neighbors=pieces[0] if len(pieces) == 1 else np.concatenate([NOBODY, *pieces]),
            positions=place,
            support=radius,
            dropped=dropped,
            build=build,
        )

    def _edge(self, support: F32) -> float:
        """Return the cell size that suits most radii [unit]."""
        return (_median(self.clamped(support)) or 1.0) * (1.0 + self.parameters.skin)


def _even(radius: float) -> float:
    """Round a radius to a power of 2^(1/4), so that limits do not change with every radius."""
    return 2.0 ** (round(4 * math.log2(radius)) / 4) if radius > 0 else 0.0


def _lists(parameters: NeighborsParameters) -> tuple[float, ...]:
    """Return the parameters that lists depend on."""
    return parameters.h_min, parameters.h_max, parameters.skin, parameters.k_max


def _equal(a: tuple[F32, F32], b: tuple[F32, F32]) -> bool:
    """Return whether two arrays are equal bit for bit."""
    return all(
        np.array_equal(x.view(np.uint32), y.view(np.uint32)) for x, y in zip(a, b, strict=True)
    )


def _median(support: F32) -> float:
    """Return the median of the positive numbers of an even sample; 0 if there is none."""
    sample = support[:: max(1, len(support) // SAMPLE)]
    sample = sample[np.isfinite(sample) & (sample > 0)]
    return float(np.median(sample)) if len(sample) else 0.0


def _limits(parameters: NeighborsParameters, support: F32) -> tuple[float, float]:
    """Return the least and largest radius [unit]: as given, or automatic where negative, with a
    bounded ratio."""
    least, most = parameters.h_min, parameters.h_max
    if least <= 0 and most <= 0:
        middle = _even(_median(support))
        return middle / math.sqrt(WIDEST_RATIO), middle * math.sqrt(WIDEST_RATIO)
    if least <= 0:
        return most / WIDEST_RATIO, most
    if most <= 0:
        return least, least * WIDEST_RATIO
    return min(least, most), min(most, least * WIDEST_RATIO)
