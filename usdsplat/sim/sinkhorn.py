"""Optimal transport between two sets of points, entropic, on several scales.

Points have equal masses. The potentials are found for a coarse problem and a large epsilon first,
and are refined while both shrink. At each epsilon, pairs of blocks whose share of the plan is
negligible are dropped, so that the finest level evaluates about a hundredth of all pairs: 20,000 x
20,000 points take seconds.

Sources: Schmitzer 2019, "Stabilized sparse scaling algorithms for entropy regularized transport
problems"; Feydy 2020, "Geometric data analysis, beyond convolutions", on scaling over clusters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, I64
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import sinkhorn as kernels
from usdsplat.kernels.sim.sinkhorn import BLOCK

CLUSTERS = (64, 8, 1)
"""Points of a cluster at each level."""
FEWEST = 64
"""Number of clusters below which a level is left out."""
SHRINK = 0.5
"""Ratio of successive epsilons."""
PER_EPSILON = 2
"""Iterations for each epsilon but a level's last."""
COARSE, FINE = 4, 12
"""Iterations at the last epsilon of a coarse level, and of the finest."""
CUT = -12.0
"""Exponent below which a pair of blocks is dropped: no pair of points in it has a share of more
than exp(-12) = 6e-6 of its row."""

Lists = tuple[I64, I32]
"""Blocks that are neighbours of each block: rows and lists, as in `kernels.sim.sinkhorn`."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Side:
    """Points in the order of their blocks."""

    order: I64
    """Row of each."""
    features: F32
    logarithms: F32
    """Logarithm of the mass of each; the masses sum to 1."""

    @classmethod
    def of(cls, features: F32) -> _Side:
        order = _compact(features)
        n = len(features)
        mass = np.full(n, -math.log(n), np.float32)
        return cls(order=order, features=_rows(features[order]), logarithms=mass)

    def __len__(self) -> int:
        return len(self.features)

    @property
    def blocks(self) -> int:
        return -(-len(self) // BLOCK)

    def clustered(self, size: int) -> _Side:
        """Return the means of runs of `size` points."""
        if size == 1:
            return self
        starts = np.arange(0, len(self), size)
        counts = np.diff(np.append(starts, len(self)))
        sums = np.add.reduceat(self.features.astype(np.float64), starts, axis=0)
        return _Side(
            order=np.arange(len(starts)),
            features=_rows(sums / counts[:, None]),
            logarithms=np.log(counts / len(self)).astype(np.float32),
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Plan:
    """Plan of a transport from n points to m points."""

    epsilon: float
    _device: Device
    _x: _Side
    _y: _Side
    _potentials: tuple[F32, F32]
    _lists: Lists

    def images(self, values: F32) -> tuple[F32, I32]:
        """Return the mean over the plan of values at the m points, shape (m, 3), for each of the n
        points, shape (n, 3); and the point with the largest share, shape (n,)."""
        images, best, _ = self._averaged(values)
        return images, best

    def cost(self) -> float:
        """Return the cost of the plan: its mean squared distance of features."""
        costs = self._averaged(np.zeros((len(self._y), 3), np.float32))[2]
        return float(costs.mean(dtype=np.float64))

    def _averaged(self, values: F32) -> tuple[F32, I32, F32]:
        x, y, n = self._x, self._y, len(self._x)
        found: tuple[F32, I32, F32] = (
            np.empty((n, 3), np.float32), np.empty(n, np.int32), np.empty(n, np.float32),
        )  # fmt: skip
        self._device.run(
            kernels.average, x.features, y.features, *self._potentials, y.logarithms,
            np.float32(self.epsilon), *self._lists, _rows(values[y.order]), *found,
        )  # fmt: skip
        images, best, costs = (
            np.empty_like(found[0]),
            np.empty(n, np.int32),
            np.empty_like(found[2]),
        )
        images[x.order], costs[x.order] = found[0], found[2]
        best[x.order] = np.where(found[1] >= 0, y.order[found[1]], -1)
        return images, best, costs


def transport(device: Device, x: F32, y: F32, epsilon: float) -> Plan:
    """Transport points to points at the least mean cost, the squared distance of their features.

    Args:
        device: Runs the kernels.
        x: Features, shape (n, 6), n >= 1.
        y: Features, shape (m, 6), m >= 1.
        epsilon: Entropic regularisation, in units of the cost: the plan spreads over about its
            square root.
    """
    fine = _Side.of(_rows(x)), _Side.of(_rows(y))
    both = np.concatenate([x, y])
    span = float(np.square(np.ptp(both, axis=0).astype(np.float64)).sum())
    now = max(span / 4, epsilon)
    solver: _Level | None = None
    for size in CLUSTERS:
        if size > 1 and max(map(len, fine)) // size < FEWEST:
            continue
        level = _Level(device, (fine[0].clustered(size), fine[1].clustered(size)), size)
        if solver is not None:
            level.start(solver, now)
        least = max(epsilon, min(epsilon * size, span / 4))
        while True:
            is_last = now <= least
            last = FINE if size == 1 else COARSE
            level.iterate(now, last if is_last else PER_EPSILON)
            level.prune(now)
            if is_last:
                break
            now = max(now * SHRINK, least)
        solver = level
    assert solver is not None
    solver.balance_rows(now)
    return Plan(
        epsilon=now, _device=device, _x=fine[0], _y=fine[1],
        _potentials=(solver.first, solver.second), _lists=solver.lists,
    )  # fmt: skip


class _Level:
    """Iterations on clusters of one size."""

    def __init__(self, device: Device, sides: tuple[_Side, _Side], size: int) -> None:
        self._device, self._x, self._y, self.size = device, *sides, size
        self.first, self.second = (np.zeros(len(each), np.float32) for each in sides)
        blocks = self._y.blocks
        starts = np.arange(self._x.blocks + 1, dtype=np.int64) * blocks
        every = np.tile(np.arange(blocks, dtype=np.int32), self._x.blocks)
        self.lists: Lists = starts, every
        """Blocks of y of each block of x."""

    def start(self, coarse: _Level, epsilon: float) -> None:
        """Take potentials and lists from a coarser level."""
        whole = _every(self._x.blocks, coarse._y.blocks)
        self.first = self._soft(self._x, coarse._y, coarse.second, epsilon, whole)
        whole = _every(self._y.blocks, coarse._x.blocks)
        self.second = self._soft(self._y, coarse._x, coarse.first, epsilon, whole)
        ratio = coarse.size // self.size
        near = np.zeros((coarse._x.blocks, coarse._y.blocks), np.bool_)
        near[_sources(coarse.lists), coarse.lists[1]] = True
        fine = near.repeat(ratio, axis=0).repeat(ratio, axis=1)
        self.lists = _listed(fine[: self._x.blocks, : self._y.blocks])
        self.prune(epsilon)

    def iterate(self, epsilon: float, times: int) -> None:
        """Fit both potentials in turn."""
        back = _transposed(self.lists, self._y.blocks)
        for _ in range(times):
            self.balance_rows(epsilon)
            self.second = self._soft(self._y, self._x, self.first, epsilon, back)

    def balance_rows(self, epsilon: float) -> None:
        """Fit the potentials of x, so that each of its points sends exactly its mass."""
        self.first = self._soft(self._x, self._y, self.second, epsilon, self.lists)

    def prune(self, epsilon: float) -> None:
        """Drop pairs of blocks with a negligible share; each block keeps its best partner."""
        sources, lists = _sources(self.lists), self.lists[1]
        top: F32 = self._device.empty(len(lists), np.float32)
        self._device.run(
            kernels.survey, self._x.features, self._y.features, self.first, self.second,
            np.float32(epsilon), sources, lists, top,
        )  # fmt: skip
        kept = top > CUT
        for keys, count in ((sources, self._x.blocks), (lists, self._y.blocks)):
            most = np.full(count, -np.inf, np.float32)
            np.maximum.at(most, keys, top)
            kept |= top >= most[keys]
        rows = np.zeros(self._x.blocks + 1, np.int64)
        np.cumsum(np.bincount(sources[kept], minlength=self._x.blocks), out=rows[1:])
        self.lists = rows, lists[kept]

    def _soft(self, x: _Side, y: _Side, potentials: F32, epsilon: float, lists: Lists) -> F32:
        out: F32 = self._device.empty(len(x), np.float32)
        self._device.run(
            kernels.soften, x.features, y.features, potentials, y.logarithms,
            np.float32(epsilon), *lists, out,
        )  # fmt: skip
        return out


def _compact(features: F32) -> I64:
    """Return an order of points in which aligned runs of any size are compact.

    Source: Friedman, Bentley & Finkel 1977; halves of the longest side, split between blocks.
    """
    order = np.arange(len(features))
    parts = [(0, -(-len(features) // BLOCK))]
    while parts:
        halves = []
        for first, end in parts:
            rows = order[first * BLOCK : end * BLOCK]
            axis = int(np.argmax(np.ptp(features[rows], axis=0)))
            order[first * BLOCK : end * BLOCK] = rows[
                np.argsort(features[rows, axis], kind="stable")
            ]
            if end - first > 1:
                middle = (first + end) // 2
                halves += [(first, middle), (middle, end)]
        parts = halves
    return order


def _rows(values: npt.NDArray[np.floating]) -> F32:
    return np.ascontiguousarray(values, np.float32)


def _every(blocks: int, others: int) -> Lists:
    """Return lists of all blocks."""
    return (
        np.arange(blocks + 1, dtype=np.int64) * others,
        np.tile(np.arange(others, dtype=np.int32), blocks),
    )


def _sources(lists: Lists) -> I32:
    """Return the block of x of each pair."""
    rows = lists[0]
    return np.repeat(np.arange(len(rows) - 1, dtype=np.int32), np.diff(rows))


def _listed(near: npt.NDArray[np.bool_]) -> Lists:
    """Return the lists of a matrix of neighbours."""
    rows = np.zeros(len(near) + 1, np.int64)
    np.cumsum(near.sum(axis=1), out=rows[1:])
    return rows, np.nonzero(near)[1].astype(np.int32)


def _transposed(lists: Lists, blocks: int) -> Lists:
    """Return the lists of the other side, which has so many blocks."""
    order = np.argsort(lists[1], kind="stable")
    rows = np.zeros(blocks + 1, np.int64)
    np.cumsum(np.bincount(lists[1], minlength=blocks), out=rows[1:])
    return rows, _sources(lists)[order]
