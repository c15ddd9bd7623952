"""Matter that breaks: rigid pieces that stand until they are struck, or lose what holds them.

Pieces are the cells of a Voronoi diagram along the surface. Their seams prefer edges of colour, so
that a capture breaks where it looks as if it could.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, I64
from usdsplat.core.quaternion import to_matrix
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import pieces as kernels
from usdsplat.kernels.sim.geodesic import geodesics
from usdsplat.kernels.sim.seeds import draw
from usdsplat.sim.carriers import Carriers
from usdsplat.sim.neighbors import Neighbors
from usdsplat.sim.parameters import NeighborsParameters
from usdsplat.sim.state import PINNED, U32, State

SEAM = 4.0
"""Cost of crossing from black to white, in lengths of the edge."""
APART = 1.5
"""Distance that carriers of different pieces keep, in distances of carriers."""

Bools = npt.NDArray[np.bool_]


class Pieces:
    """The pieces of one field's matter.

    Args:
        device: Runs the kernels.
        carriers: Carriers of the field.
        rows, neighbours: Edges between carriers, see `matter.edges`.
        colors: Colour of each carrier, shape (c, 3).
        size: Size of a piece, in distances of carriers.
        roots: Carriers that are always held, shape (c,).
        seed: Seed of the random numbers.
    """

    def __init__(
        self,
        device: Device,
        carriers: Carriers,
        rows: I64,
        neighbours: I32,
        *,
        colors: F32,
        size: float,
        roots: Bools,
        seed: int,
    ) -> None:
        self._device, self._carriers = device, carriers
        self._rows, self._neighbours, self._roots = rows, neighbours, roots
        self._own = np.repeat(np.arange(len(carriers)), np.diff(rows))
        self.piece = self._cells(colors, size, seed)
        """Piece of each carrier, shape (c,)."""
        count = int(self.piece.max(initial=-1)) + 1
        a, b = self.piece[self._own].astype(np.int64), self.piece[neighbours]
        self._crossing = np.flatnonzero(a != b)
        pairs, self._pair = np.unique((a * count + b)[self._crossing], return_inverse=True)
        self._pairs = np.divmod(pairs, max(count, 1))
        self._members = np.argsort(self.piece, kind="stable").astype(np.int32)
        self._counts = np.bincount(self.piece, minlength=count).astype(np.int64)
        self._starts = np.cumsum(self._counts) - self._counts
        self._turns = np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1))
        self.stands = np.ones(count, np.bool_)
        """Whether each piece still stands, shape (pieces,)."""
        radius = APART * carriers.spacing
        self._near = Neighbors(
            device,
            NeighborsParameters(target=16.0, skin=0.4, h_min=radius, h_max=radius),
            symmetric=True,
        )
        self._support = np.full(len(carriers), radius, np.float32)

    def update(self, flags: U32, touched: Bools, cut: npt.NDArray[np.uint8]) -> None:
        """Let pieces go that were touched, and those that nothing holds; hold the others. Pieces
        with a root stand always.

        Args:
            flags: Flags of the carriers, of which PINNED changes, shape (c,).
            touched: Which carriers touch an affector, shape (c,).
            cut: 1 for edges that have torn, shape (edges,); edges to pieces that go are cut.
        """
        self.stands[self.piece[touched]] = False
        self.stands[self.piece[self._roots]] = True
        self.stands &= self._supported(cut)
        loose = ~self.stands[self.piece]
        flags[:] = np.where(loose, flags & ~PINNED, flags | PINNED)
        first, second = self._pairs
        cut[self._crossing[(self.stands[first] != self.stands[second])[self._pair]]] = 1

    def maps(self) -> F32:
        """Return the rotation of each carrier's piece, shape (c, 3, 3)."""
        turns = np.where(self.stands[:, None], np.array([1, 0, 0, 0], np.float32), self._turns)
        return np.ascontiguousarray(to_matrix(turns)[self.piece], dtype=np.float32)

    def place(self, state: State, poses: Any) -> None:
        """Make the pieces rigid again, and keep them apart; positions of the state change."""
        run = self._device.run
        shifts = self._device.resident((len(self._counts), 6), np.float32)
        run(
            kernels.match_pieces, poses, state.positions, state.flags, self._starts, self._counts,
            self._members, self._turns, shifts,
        )  # fmt: skip
        run(
            kernels.place_pieces, poses, state.flags, self.piece, self._counts, self._turns, shifts,
            state.positions,
        )  # fmt: skip

    def part(self, state: State, poses: Any) -> None:
        """Move carriers of different pieces apart that are too close; positions change."""
        graph = self._near.update(self._device.fetch(state.positions), self._support)
        out = self._device.resident(poses.shape, np.float32)
        self._device.run(
            kernels.keep_apart, np.float32(APART * self._carriers.spacing), poses, state.positions,
            state.flags, self.piece, graph.order, graph.rank, graph.rows, graph.neighbors, out,
        )  # fmt: skip
        state.positions = out

    def memory(self) -> dict[str, npt.NDArray[Any]]:
        """Return what `restore` needs."""
        return {
            "piece": self.piece, "pieceTurns": self._turns, "stands": self.stands,
            **{f"near:{key}": each for key, each in self._near.memory().items()},
        }  # fmt: skip

    def restore(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        """Restore the result of `memory`, bit for bit."""
        self._turns, self.stands = memory["pieceTurns"], memory["stands"]
        near = {k.removeprefix("near:"): v for k, v in memory.items() if k.startswith("near:")}
        self._near.restore(near)

    def _cells(self, colors: F32, size: float, seed: int) -> I32:
        """Return the piece of each carrier."""
        c = len(self._carriers)
        if size <= 1:
            return np.arange(c, dtype=np.int32)
        wanted = max(1, round(c / size**2))
        drawn: F32 = self._device.empty(c, np.float32)
        self._device.run(draw, np.arange(c, dtype=np.int64), seed, drawn)
        sources = _spread_out(self._carriers.positions, np.argsort(drawn, kind="stable"), wanted)
        a, b = self._own, self._neighbours
        length = np.linalg.norm(self._carriers.positions[a] - self._carriers.positions[b], axis=1)
        change = np.linalg.norm(colors[a] - colors[b], axis=1) / np.sqrt(3)
        costs = (length * (1 + SEAM * change)).astype(np.float32)
        _, origin = geodesics(self._device, self._rows, b, costs, sources)
        # parts without a source are pieces of their own, by their lowest carrier
        left = np.flatnonzero(origin < 0)
        while len(left):
            reached, _ = geodesics(self._device, self._rows, b, costs, left[:1].astype(np.int64))
            origin[np.isfinite(reached) & (origin < 0)] = int(origin.max(initial=-1)) + 1
            left = left[origin[left] < 0]
        _, piece = np.unique(origin, return_inverse=True)
        return piece.astype(np.int32)

    def _supported(self, cut: npt.NDArray[np.uint8]) -> Bools:
        """Return which pieces stand on the roots: by edges that hold, over pieces that stand."""
        first, second = self._pairs
        holds = self.stands[first] & self.stands[second]
        holds &= np.bincount(self._pair[cut[self._crossing] == 0], minlength=len(first)) > 0
        first, second = first[holds], second[holds]
        count = len(self._counts)
        reached = np.zeros(count, np.bool_)
        reached[self.piece[self._roots]] = True
        if not reached.any():
            return np.ones(count, np.bool_)
        while True:
            more = reached[first] & ~reached[second]
            if not more.any():
                return reached
            reached[second[more]] = True


def _spread_out(points: F32, order: npt.NDArray[np.integer[Any]], count: int) -> I64:
    """Return `count` points, each the farthest of some random ones from those before it."""
    tries = order[: min(len(order), 8 * count)]
    chosen = [int(tries[0])]
    apart = np.linalg.norm(points[tries] - points[chosen[0]], axis=1)
    while len(chosen) < min(count, len(tries)):
        best = int(np.argmax(apart))
        chosen.append(int(tries[best]))
        apart = np.minimum(apart, np.linalg.norm(points[tries] - points[chosen[-1]], axis=1))
    return np.array(sorted(chosen), np.int64)
