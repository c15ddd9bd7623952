"""Motifs of growth: the shape of new matter over a field's carriers, behind the front.

A motif divides the surface around sites, which are evenly spaced, and says for each carrier how
high matter stands there, once the front has arrived: packed cells, or plates with lobed margins.
The motifs of needles, veins and corals are in `needles`, `vein_tree` and `corals`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, I64
from usdsplat.kernels.device import Device
from usdsplat.kernels.points.nearest import nearest
from usdsplat.kernels.sim import seeds as kernels
from usdsplat.sim.carriers import Carriers

FORMING = 0.9
"""Time in which a cell or a plate takes its size [s]."""
ROUNDS = 3
"""Rounds of Lloyd's relaxation of the sites."""
SEAM = 0.10
"""Width of the seam between cells, as a part of the distance from seam to centre."""
LOBES = 7.0
"""Mean number of lobes of a plate."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Look:
    """What a motif says at one time, for each of c carriers."""

    rise: F32
    """Height of matter, 0 to 1, shape (c,); 0 where there is none yet."""
    tone: F32
    """Place on the ramp of colours, 0 to 1, shape (c,)."""
    piece: I32
    """Number of the cell, plate, needle, vein or colony, shape (c,)."""
    begun: npt.NDArray[np.bool_] | None = None
    """Whether splats of new matter exist on each carrier, shape (c,). None: they exist where `rise`
    is above 0."""


class Motif(Protocol):
    """Shape of new matter."""

    def at(self, arrival: F32, now: float) -> Look:
        """Return the look at a time.

        Args:
            arrival: Time at which the front reaches each carrier [s], shape (c,); inf for never.
            now: Time since the simulation's start [s].
        """


def drawn(device: Device, count: int, seed: int) -> F32:
    """Return `count` random numbers in [0, 1)."""
    out: F32 = device.empty(count, np.float32)
    device.run(kernels.draw, np.arange(count, dtype=np.int64), seed, out)
    return out


def noise(device: Device, carriers: Carriers, seed: int, size: float) -> F32:
    """Return smooth noise at the carriers, 0 to 1, in patches of `size` distances of carriers."""
    out: F32 = device.empty(len(carriers), np.float32)
    device.run(kernels.noise, carriers.positions, seed, size * carriers.spacing, out)
    return out


def sites_of(device: Device, carriers: Carriers, size: float, seed: int) -> I64:
    """Return carriers on the outside about `size` distances of carriers apart, in ascending order.

    Carriers are taken in a random order unless one is near already; Lloyd's rounds then move each
    to the middle of the carriers that are nearest to it.
    """
    c, places = len(carriers), carriers.positions
    order = np.argsort(drawn(device, c, seed), kind="stable")
    order = order[carriers.outer[order]]
    outer = np.flatnonzero(carriers.outer)
    taken = _apart(places, order, 0.72 * size * carriers.spacing)
    for _ in range(ROUNDS):
        owner = nearest(device, places[taken], places[outer], 1)[0][:, 0]
        total = np.stack(
            [
                np.bincount(owner, weights=places[outer, axis], minlength=len(taken))
                for axis in range(3)
            ]
        ).T
        count = np.maximum(np.bincount(owner, minlength=len(taken)), 1)
        middle = (total / count[:, None]).astype(np.float32)
        taken = np.unique(outer[nearest(device, places[outer], middle, 1)[0][:, 0]])
    return taken.astype(np.int64)


class Cells:
    """Packed round cells with seams.

    Args:
        device: Runs the kernels.
        carriers: Carriers of the field.
        size: Diameter of a cell, in distances of carriers.
        seed: Seed of the random numbers.
    """

    def __init__(self, device: Device, carriers: Carriers, size: float, seed: int) -> None:
        self._sites = sites_of(device, carriers, size, seed)
        near, apart = nearest(device, carriers.positions[self._sites], carriers.positions, 2)
        self._piece = near[:, 0]
        self._inner = _inner(apart)

    def at(self, arrival: F32, now: float) -> Look:
        """Return the look at a time: cells swell from their centres."""
        grown = _formed(arrival[self._sites], now)[self._piece]
        inner = np.clip((self._inner - (1 - grown)) / np.maximum(grown, 1e-6), 0, 1)
        t = np.clip((inner - SEAM) / 0.75, 0, 1)
        dome = np.sqrt(1 - (1 - t) ** 2)
        exists = (grown > 0) & (self._inner >= 1 - grown)
        # the membrane between cells has matter, too
        rise = np.where(exists, np.maximum(dome * grown, 0.04), 0)
        return Look(rise=_f32(rise), tone=_f32(inner), piece=self._piece)


class Plates:
    """Crusty plates that grow at their lobed margins.

    Args:
        device: Runs the kernels.
        carriers: Carriers of the field.
        size: Usual diameter of a plate, in distances of carriers.
        seed: Seed of the random numbers.
    """

    def __init__(self, device: Device, carriers: Carriers, size: float, seed: int) -> None:
        self._sites = sites_of(device, carriers, 0.62 * size, seed)
        places, n = carriers.positions, len(self._sites)
        near, apart = nearest(device, places[self._sites], places, 4)
        widths = 0.5 * size * carriers.spacing * (0.45 + 0.75 * drawn(device, n, seed + 1))
        widths[drawn(device, n, seed + 2) < 0.18] = 0  # some stone stays bare
        rugged = noise(device, carriers, seed + 3, 3.0) - 0.5
        turn, count = drawn(device, n, seed + 4), drawn(device, n, seed + 5)
        part = np.full((len(carriers), near.shape[1]), np.inf, np.float32)
        for k in range(near.shape[1]):
            site = np.maximum(near[:, k], 0)
            angle = _angle(places - places[self._sites[site]], carriers.normals[self._sites[site]])
            lobes = np.round(LOBES + 4 * (count[site] - 0.5))
            wave = np.abs(np.sin(0.5 * (lobes * angle + 6.28 * turn[site])))
            reach = widths[site] * (0.72 + 0.34 * wave + 0.4 * rugged)
            here = (near[:, k] >= 0) & (reach > 0)
            part[:, k] = np.where(here, apart[:, k] / np.maximum(reach, 1e-9), np.inf)
        best = np.argmin(part, axis=1)
        every = np.arange(len(carriers))
        self._piece, self._part = near[every, best], part[every, best]
        self._grain = noise(device, carriers, seed + 6, 1.6)
        cups = noise(device, carriers, seed + 7, 2.4)
        self._cups = np.clip((cups - 0.62) / 0.1, 0, 1)

    def at(self, arrival: F32, now: float) -> Look:
        """Return the look at a time: margins move outwards."""
        grown = _formed(arrival[self._sites], now, 2.2)[self._piece]
        with np.errstate(divide="ignore", invalid="ignore"):
            out = self._part / np.where(grown > 0, 0.15 + 0.85 * grown, 0)
        exists = (grown > 0) & (out < 1)
        inside = np.where(exists, 1 - out, 0)
        edge = np.clip(inside / 0.10, 0, 1)
        rim = np.clip(1 - np.abs(inside - 0.16) / 0.14, 0, 1)
        cup = self._cups * np.clip((inside - 0.35) / 0.1, 0, 1)
        rise = edge * (0.42 + 0.3 * rim + 0.28 * self._grain + 0.35 * cup)
        tone = np.clip(inside, 0, 0.82) + 0.18 * cup
        rise = np.where(exists, np.clip(rise, 0.03, 1), 0)
        return Look(rise=_f32(rise), tone=_f32(tone), piece=self._piece)


def _apart(places: F32, order: I64, radius: float) -> I64:
    """Return points that are at least a radius apart, taken in this order."""
    cells = np.floor(places / radius).astype(np.int64)
    grid: dict[tuple[int, int, int], list[int]] = {}
    taken = []
    for i in order.tolist():
        x, y, z = cells[i].tolist()
        p = places[i]
        free = True
        for dx in (-1, 0, 1):
            for dy in (-1, 0, 1):
                for dz in (-1, 0, 1):
                    for j in grid.get((x + dx, y + dy, z + dz), ()):
                        d = places[j] - p
                        if d @ d < radius * radius:
                            free = False
        if free:
            grid.setdefault((x, y, z), []).append(i)
            taken.append(i)
    return np.array(sorted(taken), np.int64)


def _inner(apart: F32) -> F32:
    """Return how far inside its cell a carrier is: 0 on the seam, 1 at the site."""
    first, second = apart[:, 0], np.where(np.isfinite(apart[:, 1]), apart[:, 1], np.inf)
    with np.errstate(invalid="ignore"):
        part = 1 - 2 * first / np.maximum(first + second, 1e-12)
    return _f32(np.where(np.isfinite(second), part, 1))


def _formed(arrival: F32, now: float, slower: float = 1.0) -> F32:
    """Return how far what began at `arrival` has formed, 0 to 1."""
    with np.errstate(invalid="ignore"):
        t = np.clip((now - arrival) / (slower * FORMING), 0, 1)
    return _f32(np.where(np.isfinite(arrival), 1 - (1 - t) ** 2, 0))


def _angle(offset: F32, normals: F32) -> F32:
    """Return the azimuth of an offset around a normal [rad]."""
    aside = np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    x = np.cross(normals, aside)
    y = np.cross(normals, x)
    return _f32(np.arctan2((offset * y).sum(1), (offset * x).sum(1)))


def _f32(values: npt.NDArray[Any]) -> F32:
    return np.ascontiguousarray(values, np.float32)
