"""The motif of needles: groups of faceted crystals of many sizes that lean away from each other."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, I64
from usdsplat.kernels.device import Device
from usdsplat.kernels.points.nearest import nearest
from usdsplat.sim.carriers import Carriers
from usdsplat.sim.motifs import Look, drawn, sites_of

GROUP = 3.4
"""Distance of the middles of groups, in distances of needles."""
GROWING = 1.5
"""Time in which the longest needle grows [s]."""
SLIM = 0.15
"""Usual radius of a needle, as a part of its length."""
ALONE = (0.8, 0.8)
"""Distance from the middle of a group, relative to its reach, from which the ground is bare, and
what part of it."""
LEAN, STRAY = 0.75, 0.22
"""How far needles lean away from the middle of their group, and how much at random."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Prisms:
    """Needles of k sites; lengths are relative to the longest."""

    bases: F32
    """Places of their lower ends [unit], shape (k, 3)."""
    axes: F32
    """Unit vectors to the tips, shape (k, 3)."""
    lengths: F32
    """Lengths, 0 to 1; 0 for none, shape (k,)."""
    radii: F32
    """Radii, relative to the longest needle, shape (k,)."""
    site: I32
    """Needle of each carrier, shape (c,)."""
    group: I32
    """Group of each carrier, shape (c,)."""
    rank: I32
    """Place of each carrier among those of its needle, shape (c,)."""
    count: I32
    """Number of carriers of each needle, shape (k,)."""


class Needles:
    """Groups of needles.

    Args:
        device: Runs the kernels.
        carriers: Carriers of the field.
        size: Distance of needles, in distances of carriers.
        seed: Seed of the random numbers.
    """

    def __init__(self, device: Device, carriers: Carriers, size: float, seed: int) -> None:
        places = carriers.positions
        sites = sites_of(device, carriers, size, seed)
        k = len(sites)
        self._sites = sites
        site = nearest(device, places[sites], places, 1)[0][:, 0]
        rank, count = ranked(site.astype(np.int64), np.ones(len(site), np.bool_), k)
        middles = places[sites_of(device, carriers, GROUP * size, seed + 1)]
        near, apart = nearest(device, middles, places[sites], 1)
        reach = 0.5 * GROUP * size * carriers.spacing
        away = (places[sites] - middles[near[:, 0]]) / reach
        part = np.minimum(apart[:, 0] / reach, 1.5)
        chance = drawn(device, k, seed + 2)
        group = 0.4 + 0.6 * drawn(device, len(middles), seed + 3)[near[:, 0]]
        lengths = group * np.exp(-1.6 * part**2) * (0.3 + 0.7 * chance)
        lengths = np.maximum(lengths, 0.12 + 0.16 * chance**2)
        lengths[(part > ALONE[0]) & (chance < ALONE[1])] = 0
        # a group has a common axis, from which its needles lean away
        m, own = len(middles), carriers.normals[sites]
        total = [np.bincount(near[:, 0], own[:, axis], m) for axis in range(3)]
        common = np.stack(total, axis=1)[near[:, 0]]
        normals = own + common / np.maximum(np.linalg.norm(common, axis=1, keepdims=True), 1e-9)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
        turn = 2 * np.pi * drawn(device, k, seed + 4)
        tilt = STRAY * np.sqrt(drawn(device, k, seed + 5))
        aside = np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
        x = np.cross(normals, aside)
        x /= np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-9)
        y = np.cross(normals, x)
        random = tilt[:, None] * (np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * y)
        axes = normals + LEAN * away + random
        axes /= np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-9)
        radii = SLIM * lengths**0.8 * (0.65 + 0.7 * drawn(device, k, seed + 6))
        self.prisms = Prisms(
            bases=places[sites], axes=_f32(axes), lengths=_f32(lengths),
            radii=_f32(radii), site=site.astype(np.int32),
            group=near[site, 0].astype(np.int32), rank=rank, count=count,
        )  # fmt: skip

    def keep_to(self, allowed: F32) -> None:
        """Make needles of the carriers that may grow only, and shorter where they may less.

        Args:
            allowed: Factor of the height of each carrier, shape (c,).
        """
        p = self.prisms
        rank, count = ranked(p.site.astype(np.int64), allowed > 0, len(p.count))
        part = allowed[self._sites]
        self.prisms = replace(
            p, rank=rank, count=count, lengths=p.lengths * part, radii=p.radii * np.sqrt(part)
        )

    def grown(self, arrival: F32, now: float) -> F32:
        """Return the part of its length that each needle has grown, shape (k,)."""
        with np.errstate(invalid="ignore"):
            t = np.clip((now - arrival[self._sites]) / GROWING, 0, 1)
        return _f32(np.where(np.isfinite(arrival[self._sites]), 1 - (1 - t) ** 2, 0))

    def at(self, arrival: F32, now: float) -> Look:
        """Return the look at a time: needles grow from the surface."""
        site = self.prisms.site
        grown = self.grown(arrival, now)[site]
        rise = self.prisms.lengths[site] * grown
        return Look(rise=_f32(rise), tone=_f32(0.5 * grown), piece=self.prisms.group)


def ranked(site: I64, kept: npt.NDArray[np.bool_], k: int) -> tuple[I32, I32]:
    """Number the kept carriers of each needle.

    Returns:
        Number of each carrier within its needle, shape (c,), and of kept carriers of each of k
        needles, shape (k,).
    """
    rows = np.flatnonzero(kept)
    rows = rows[np.argsort(site[rows], kind="stable")]
    count = np.bincount(site[rows], minlength=k)
    rank = np.zeros(len(site), np.int32)
    rank[rows] = np.arange(len(rows)) - np.repeat(np.cumsum(count) - count, count)
    return rank, count.astype(np.int32)


def _f32(values: npt.NDArray[Any]) -> F32:
    return np.ascontiguousarray(values, np.float32)
