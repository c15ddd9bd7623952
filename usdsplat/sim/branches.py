"""Branches of corals: their middle lines, how side branches leave them, and how they grow."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I64
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim.branches import TAPER
from usdsplat.sim.motifs import drawn

GOLDEN = 2.399963229728653
"""Angle [rad] by which successive points around a line are evenly spaced: the golden one."""
THINNER = 0.9
"""Radius of a side branch, relative to that of the branch that it leaves, there."""
THINNEST = 0.026
"""Least radius of a side branch, relative to the longest finger."""
FIRST, LAST = 0.25, 0.85
"""Part of a branch on which others leave it."""
UPWARD = 0.7
"""How far side branches bend to what is up, relative to the direction of what they leave."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """How branches of one order leave those of the order before."""

    each: int
    """Largest number on a branch."""
    least: float
    """Length of a branch, relative to the longest finger, below which it has none."""
    angle: float
    """Angle to the branch that they leave [rad]."""
    bend: float
    """How far they bend upwards."""


ORDERS = (
    Order(each=4, least=0.22, angle=0.95, bend=0.40),
    Order(each=2, least=0.20, angle=0.80, bend=0.30),
)
"""Side branches, and theirs."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Branches:
    """b branches. Lengths are relative to the longest finger, except in `roots`.

    The middle line runs through `offsets + lengths (axes u + bends u^2)` from the root of its
    finger, 0 <= u <= the part that has grown.
    """

    site: I64
    """Carrier at which the finger of each branch roots, shape (b,)."""
    colony: I64
    """Number of its colony, shape (b,)."""
    roots: F32
    """Root of the finger [unit], shape (b, 3)."""
    offsets: F32
    """Where the branch begins, from there, shape (b, 3)."""
    axes: F32
    """Unit vectors in which branches begin, shape (b, 3)."""
    bends: F32
    """Change of direction, perpendicular to them, shape (b, 3)."""
    lengths: F32
    """Lengths, shape (b,)."""
    radii: F32
    """Radii where branches begin, shape (b,)."""
    delays: F32
    """Time between the beginning of the finger and that of the branch [s], shape (b,)."""
    times: F32
    """Time of growth [s], shape (b,)."""

    def __len__(self) -> int:
        return len(self.site)

    def taken(self, rows: I64) -> Branches:
        """Return some of the branches."""
        return Branches(**{f.name: getattr(self, f.name)[rows] for f in fields(Branches)})

    @classmethod
    def joined(cls, parts: list[Branches]) -> Branches:
        """Return all branches of several sets."""
        return cls(
            **{f.name: np.concatenate([getattr(b, f.name) for b in parts]) for f in fields(cls)}
        )

    def areas(self) -> F32:
        """Return the areas of their surfaces, shape (b,)."""
        return f32(2 * np.pi * self.radii * (1 - TAPER / 2) * self.lengths)

    def line(self, u: F32) -> tuple[F32, F32]:
        """Return the points at u on the middle lines, from the roots of the fingers, and the unit
        vectors along the lines there, both of shape (b, 3)."""
        v = u[:, None]
        points = self.offsets + self.lengths[:, None] * v * (self.axes + v * self.bends)
        return f32(points), unit(self.axes + 2 * v * self.bends)

    def grown(self, begins: F32, now: float) -> F32:
        """Return the part of its length that each branch has grown, shape (b,).

        Args:
            begins: Time at which the finger of each branch begins [s], inf for never, shape (b,).
            now: Time since the simulation's start [s].
        """
        t = np.clip((now - begins - self.delays) / self.times, 0, 1)
        return f32(1 - (1 - t) ** 2)


def sides(device: Device, of: Branches, order: Order, up: F32, seed: int) -> Branches:
    """Return the branches that leave others, once these have grown past.

    Args:
        device: Draws the random numbers.
        of: Branches that they leave.
        order: Their number and directions.
        up: Unit vector upwards, shape (3,).
        seed: Seed of the random numbers.
    """
    b = len(of)
    chance = [drawn(device, b * order.each, seed + i).reshape(order.each, b) for i in range(4)]
    first = 2 * np.pi * drawn(device, b, seed + 4)
    made = []
    for j in range(order.each):
        rows = np.flatnonzero((of.lengths >= order.least) & (chance[0][j] < 0.85))
        own = of.taken(rows)
        u = f32(FIRST + (LAST - FIRST) * (j + chance[1][j, rows]) / order.each)
        points, along = own.line(u)
        x, y = across(along)
        turn = (first[rows] + GOLDEN * j)[:, None]
        away = np.cos(turn) * x + np.sin(turn) * y
        axes = unit(np.cos(order.angle) * along + np.sin(order.angle) * away)
        toward = aside(unit(along + UPWARD * up), axes)
        lengths = own.lengths * (1.1 - 0.7 * u) * (0.6 + 0.35 * chance[2][j, rows])
        made.append(
            Branches(
                site=own.site, colony=own.colony, roots=own.roots, offsets=points, axes=axes,
                bends=f32(order.bend * toward), lengths=f32(lengths),
                radii=f32(np.maximum(THINNER * own.radii * (1 - TAPER * u), THINNEST)),
                delays=f32(own.delays + own.times * passed(u)),
                times=f32(own.times * (0.6 + 0.3 * chance[3][j, rows])),
            )
        )  # fmt: skip
    return Branches.joined(made)


def passed(u: F32) -> F32:
    """Return the part of its time in which a branch grows to the part u of its length."""
    return f32(1 - np.sqrt(1 - u))


def across(vectors: F32) -> tuple[F32, F32]:
    """Return two unit vectors that are perpendicular to each vector and to each other."""
    other = np.where(np.abs(vectors[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
    x = unit(np.cross(vectors, other))
    return x, f32(np.cross(vectors, x))


def aside(vectors: F32, units: F32) -> F32:
    """Return the parts of vectors that are perpendicular to unit vectors, shape (n, 3)."""
    return f32(vectors - (vectors * units).sum(axis=1, keepdims=True) * units)


def unit(vectors: npt.NDArray[Any]) -> F32:
    """Return vectors of length 1, shape (n, 3); 0 stays 0."""
    return f32(vectors / np.maximum(np.sqrt((vectors**2).sum(axis=1, keepdims=True)), 1e-12))


def f32(values: npt.NDArray[Any]) -> F32:
    """Return values in single precision."""
    return np.ascontiguousarray(values, np.float32)
