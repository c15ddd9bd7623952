"""The motif of corals: colonies of tapered fingers that branch, with rounded tips, on a crust.

Fingers root at evenly spaced sites. Those of a colony lean away from its middle and bend upwards;
they are longest in the middle. All splats of a colony's carriers share the surface of its branches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32, I32, I64
from usdsplat.kernels.device import Device
from usdsplat.kernels.points.nearest import nearest
from usdsplat.kernels.sim import branches as kernels
from usdsplat.kernels.sim.branches import TAPER
from usdsplat.sim.branches import GOLDEN, ORDERS, Branches, across, aside, f32, sides, unit
from usdsplat.sim.carriers import Carriers
from usdsplat.sim.motifs import Look, drawn, noise, sites_of
from usdsplat.sim.needles import ranked

GROUP = 4.2
"""Distance of the middles of colonies, in distances of fingers."""
GROWING = 0.95
"""Time in which a finger grows [s]."""
CRUST, CRUSTING = 0.06, 0.6
"""Greatest height of the crust below the fingers, relative to the longest finger, and time in which
it rises [s]."""
LEAN, STRAY, UPWARD = 0.85, 0.30, 0.95
"""How far fingers lean away from the middle of their colony, at random, and upwards."""
BEND = 0.45
"""How far fingers bend upwards."""
SLIM = 0.056
"""Radius of the longest finger, relative to its length."""
REACH = 0.6
"""Distance from the middle of a colony at which it ends, relative to that of the middles."""
LEAST = 0.36
"""Length of a finger far from the middle of its colony, relative to the longest."""
ALONE = (0.95, 0.35)
"""Distance from the middle of a colony, relative to that one, from which fingers are missing, and
what part of them."""
POLYPS = 0.2
"""Part of the splats that are polyps."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Places:
    """Places of d splats on branches."""

    positions: F32
    """Positions [unit], shape (d, 3)."""
    normals: F32
    """Unit normals of the surface, shape (d, 3)."""
    tones: F32
    """Place on the ramp, 0 at the root to 1 at the tip, shape (d,)."""
    tints: F32
    """How much of the colony's tint a place has, 0 to 1: tips are pale, shape (d,)."""
    opened: F32
    """0 in the depth of a colony to 1, shape (d,)."""
    spread: F32
    """Mean distance of splats [unit], 0 where the branch has not begun, shape (d,)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Slots:
    """Where each of s splats is, by number."""

    first: I64
    """Number of the first splat of each colony."""
    branch: I64
    """Branch, shape (s,)."""
    part: F32
    """Place along the branch, 0 to 1, shape (s,)."""
    ways: F32
    """Unit vector from the middle line, where the branch begins, shape (s, 3)."""
    polyp: F32
    """1 for polyps, 0 for others, shape (s,)."""
    spread: F32
    """Mean distance of splats, relative to the longest finger, shape (s,)."""


class Corals:
    """Colonies of branching fingers.

    Args:
        device: Runs the kernels.
        carriers: Carriers of the field.
        size: Distance of fingers, in distances of carriers.
        seed: Seed of the random numbers.
    """

    def __init__(self, device: Device, carriers: Carriers, size: float, seed: int) -> None:
        self._device, self._carriers, self._size, self._seed = device, carriers, size, seed
        places = carriers.positions
        self._middles = sites_of(device, carriers, GROUP * size, seed + 1)
        self._colony: I32 = nearest(device, places[self._middles], places, 1)[0][:, 0]
        self._bumps = noise(device, carriers, seed + 8, 2.6)
        self._grain = drawn(device, len(carriers), seed + 10)
        self.branches: Branches
        """Branches, by colony; `keep_to` makes them."""
        self._slots: _Slots
        self._rank: I32
        self._layers = 0
        self.crust = np.zeros(len(carriers), np.float32)
        """How far the crust has formed on each carrier at the last call of `at`, 0 to 1."""

    def keep_to(self, allowed: F32, layers: int, up: F32) -> None:
        """Make the branches, on carriers that may grow only, and shorter where they may less.

        Args:
            allowed: Factor of the height of each carrier, shape (c,).
            layers: Number of splats of branches for each carrier.
            up: Unit vector upwards, shape (3,).
        """
        k = len(self._middles)
        self._rank, count = ranked(self._colony.astype(np.int64), allowed > 0, k)
        made = [self._fingers(allowed, up)]
        for number, order in enumerate(ORDERS):
            made.append(sides(self._device, made[-1], order, up, self._seed + 30 + 10 * number))
        joined = Branches.joined(made)
        self.branches = joined.taken(np.argsort(joined.colony, kind="stable"))
        self._layers = layers
        self._slots = s = self._numbered(count.astype(np.int64) * layers)
        b = self.branches
        for each in (
            s.branch, s.part, s.ways, s.polyp, s.spread, b.roots, b.offsets, b.axes, b.bends,
            b.lengths, b.radii, b.delays,
        ):  # fmt: skip
            self._device.keep(each)

    def at(self, arrival: F32, now: float) -> Look:
        """Return the look at a time: that of the crust. Splats of a whole colony exist once the
        front has reached it."""
        first = np.full(len(self._middles), np.inf, np.float32)
        np.minimum.at(first, self._colony, arrival)
        with np.errstate(invalid="ignore"):
            age = np.clip((now - arrival) / CRUSTING, 0, 1)
        self.crust = f32(np.where(np.isfinite(arrival), age, 0))
        rise = CRUST * (0.4 + 0.6 * self._bumps) * self.crust
        tone = 0.6 + 0.2 * self._bumps + 0.15 * self._grain**2
        return Look(
            rise=f32(rise), tone=f32(tone), piece=self._colony, begun=(first <= now)[self._colony]
        )

    def roots(self, carrier: I64, layer: I32) -> I64:
        """Return the carrier at which the branch of a splat roots, and its own for the crust's.

        Args:
            carrier: Carrier of each splat, shape (d,).
            layer: Number among its splats of branches, -1 for the crust, shape (d,).
        """
        high = np.flatnonzero(layer >= 0)
        found = carrier.astype(np.int64)
        slot = self._slot(carrier[high], layer[high])
        found[high] = self.branches.site[self._slots.branch[slot]]
        return found

    def _slot(self, carrier: I64 | I32, layer: I32) -> I64:
        """Return the number of the place of each splat."""
        number = self._rank[carrier].astype(np.int64) * self._layers + layer
        return self._slots.first[self._colony[carrier]] + number

    def placed(self, carrier: I32, layer: I32, full: float, arrival: F32, now: float) -> Places:
        """Return the places of splats on branches at a time.

        Args:
            carrier: Carrier of each splat, shape (d,).
            layer: Number among its splats of branches, shape (d,).
            full: Length of the longest finger [unit].
            arrival: Time at which the front reaches each carrier [s], shape (c,); inf for never.
            now: Time since the simulation's start [s].
        """
        b, s, empty, d = self.branches, self._slots, self._device.empty, len(carrier)
        made = Places(
            positions=empty((d, 3), np.float32), normals=empty((d, 3), np.float32),
            tones=empty(d, np.float32), tints=empty(d, np.float32),
            opened=empty(d, np.float32), spread=empty(d, np.float32),
        )  # fmt: skip
        self._device.run(
            kernels.place, self._slot(carrier, layer), s.branch, s.part, s.ways, s.polyp, s.spread,
            b.grown(arrival[b.site], now), b.roots, b.offsets, b.axes, b.bends, b.lengths, b.radii,
            b.delays, np.float32(full), made.positions, made.normals, made.tones, made.tints,
            made.opened, made.spread,
        )  # fmt: skip
        return made

    def _fingers(self, allowed: F32, up: F32) -> Branches:
        """Return the branches that root on the surface."""
        device, c, seed = self._device, self._carriers, self._seed
        places, m = c.positions, len(self._middles)
        sites = sites_of(device, c, self._size, seed)
        some = allowed[sites] > 0
        sites = sites[some] if some.any() else np.flatnonzero(allowed > 0)[:1]
        k = len(sites)
        group = self._colony[sites].astype(np.int64)
        reach = REACH * GROUP * self._size * c.spacing
        away = (places[sites] - places[self._middles[group]]) / np.float32(reach)
        part = np.sqrt((away**2).sum(axis=1))
        away /= np.maximum(part, 1)[:, None]
        vigour, stout = 0.45 + 0.55 * drawn(device, m, seed + 2), drawn(device, m, seed + 3)
        chance, luck, girth = (drawn(device, k, seed + i) for i in (4, 5, 6))
        lengths = vigour[group] * np.exp(-0.65 * part**2) * (0.65 + 0.35 * chance)
        lengths = np.maximum(lengths, LEAST * (0.6 + 0.4 * chance))
        kept = (part < ALONE[0]) | (luck > ALONE[1]) | (part <= part.min(initial=np.inf))
        radii = SLIM * (0.55 + 0.45 * lengths) * (0.85 + 0.3 * girth) * (0.85 + 0.5 * stout[group])
        own = c.normals[sites]
        total = [np.bincount(group, own[:, axis], m) for axis in range(3)]
        common = unit(np.stack(total, axis=1))[group]
        x, y = across(own)
        turn, tilt = 2 * np.pi * drawn(device, k, seed + 7), STRAY * np.sqrt(luck)
        stray = tilt[:, None] * (np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * y)
        axes = unit(unit(own + 0.5 * common) + LEAN * away + UPWARD * up + stray)
        toward = aside(unit(common + up), axes)
        return Branches(
            site=sites, colony=group, roots=places[sites],
            offsets=np.zeros((k, 3), np.float32), axes=axes, bends=f32(BEND * toward),
            lengths=f32(lengths * allowed[sites]), radii=f32(radii * np.sqrt(allowed[sites])),
            delays=np.zeros(k, np.float32), times=f32(GROWING * (0.5 + 0.5 * np.sqrt(lengths))),
        ).taken(np.flatnonzero(kept))  # fmt: skip

    def _numbered(self, count: I64) -> _Slots:
        """Return the places of `count` splats for each colony: by area, in golden spirals. Those of
        a colony without branches have the spread 0, which hides them."""
        b, k = self.branches, len(count)
        areas = np.maximum(b.areas().astype(np.float64), 1e-30)
        total = np.bincount(b.colony, areas, k)
        ends = np.cumsum(areas)
        before = np.cumsum(total) - total
        first = np.cumsum(count) - count
        colony = np.repeat(np.arange(k), count)
        number = np.arange(len(colony)) - first[colony]
        at = before[colony] + (number + 0.5) / count[colony] * total[colony]
        branch = np.minimum(np.searchsorted(ends, at, side="right"), len(b) - 1)
        q = np.clip((at - ends[branch] + areas[branch]) / areas[branch], 0, 1)
        # the area up to a place is a parabola of it, as branches taper
        part = (1 - np.sqrt(1 - q * TAPER * (2 - TAPER))) / TAPER
        x, y = across(b.axes[branch])
        turn = (GOLDEN * number)[:, None]
        chance = drawn(self._device, len(colony), self._seed + 9)
        return _Slots(
            first=first, branch=branch, part=f32(part),
            ways=f32(np.cos(turn) * x + np.sin(turn) * y), polyp=f32(chance < POLYPS),
            spread=f32(np.sqrt(total[colony] / count[colony])),
        )  # fmt: skip
