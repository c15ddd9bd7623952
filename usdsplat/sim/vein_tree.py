"""The motif of veins: tubes that branch as a tree over the surface, from the seeds of the front.

Evenly spaced ends are joined to the seeds by paths along which the front's time of arrival falls,
and which prefer paths that exist. Radii follow from the number of ends beyond.

Source: Murray 1926, "The physiological principle of minimum work": cubes of radii add up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32, I32, I64
from usdsplat.kernels.device import Device
from usdsplat.kernels.points.nearest import nearest
from usdsplat.sim.carriers import Carriers
from usdsplat.sim.motifs import Look, drawn, noise, sites_of

MURRAY = 1 / 2.4
"""Exponent of radii: 1/3 is Murray's, a larger one tells trunks from ends."""
LEAST, MOST = 1.0, 3.6
"""Radii of ends, and largest radii, in distances of carriers."""
MEANDER, JOIN = 1.8, 2.2
"""How far paths stray, and how much they prefer others, in distances of carriers."""
THICKENING = 1.6
"""Time in which a vein takes its thickness [s]."""
NEAR = 6
"""Number of points on veins that a carrier looks at."""
PARTS = 4
"""Points on each edge of the tree."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Tree:
    """Veins at the carriers: radius of the nearest vein, distance from it, both in distances of
    carriers, and time at which it gets there."""

    radius: F32
    distance: F32
    arrival: F32
    piece: I32


class Veins:
    """Branching tubes.

    Args:
        device: Runs the kernels.
        carriers: Carriers of the field.
        size: Distance of the ends, in distances of carriers.
        seed: Seed of the random numbers.
    """

    def __init__(self, device: Device, carriers: Carriers, size: float, seed: int) -> None:
        self._device, self._carriers = device, carriers
        self._ends = sites_of(device, carriers, size, seed)
        order = np.argsort(drawn(device, len(self._ends), seed + 1), kind="stable")
        self._ends = self._ends[order]
        self._stray = noise(device, carriers, seed + 2, 5.0) + 0.4 * drawn(
            device, len(carriers), seed + 3
        )
        self._of: F32 | None = None
        self._tree: _Tree | None = None

    def at(self, arrival: F32, now: float) -> Look:
        """Return the look at a time: veins run outwards with the front, and thicken."""
        if self._tree is None or self._of is not arrival:
            if self._of is None or not np.array_equal(self._of, arrival):
                self._tree = self._grown(arrival)
            self._of = arrival
        tree = self._tree
        assert tree is not None
        with np.errstate(invalid="ignore"):
            age = np.clip((now - tree.arrival) / THICKENING, 0, 1)
        age = np.where(tree.arrival <= now, 0.45 + 0.55 * age, 0)
        radius = tree.radius * age
        with np.errstate(divide="ignore", invalid="ignore"):
            across = np.where(radius > 0, tree.distance / radius, np.inf)
        tube = np.sqrt(np.clip(1 - across**2, 0, 1)) * radius / MOST
        rise = np.where(across < 1, np.maximum(tube, 0.05), 0)
        tone = np.clip(1 - across, 0, 1) * (0.55 + 0.45 * radius / MOST)
        return Look(
            rise=np.float32(rise), tone=np.float32(np.where(across < 1, tone, 0)), piece=tree.piece
        )

    def _grown(self, arrival: F32) -> _Tree:
        """Return the tree for these times of arrival."""
        c, graph = self._carriers, self._carriers.graph
        n = len(c)
        finite = np.isfinite(arrival)
        steps = self._steps(arrival)
        score = np.where(finite, steps, np.inf) + MEANDER * self._stray
        parent = np.full(n, -1, np.int64)
        on = np.zeros(n, np.bool_)
        for end in self._ends[finite[self._ends]].tolist():
            at = end
            while not on[at]:
                on[at] = True
                near = graph.neighbors[graph.rows[at] : graph.rows[at + 1]]
                near = near[arrival[near] < arrival[at]]
                if not len(near):
                    break
                best = int(near[np.argmin(score[near] - JOIN * on[near])])
                parent[at] = best
                at = best
        rows = np.flatnonzero(parent >= 0)
        none = np.full(n, np.inf, np.float32)
        if not len(rows):
            return _Tree(
                radius=np.zeros(n, np.float32), distance=none, arrival=none,
                piece=np.zeros(n, np.int32),
            )  # fmt: skip
        flow = np.zeros(n)
        flow[self._ends[finite[self._ends]]] = 1
        for i in rows[np.argsort(-arrival[rows], kind="stable")].tolist():
            flow[parent[i]] += flow[i]
        places = _smoothed(c.positions, rows, parent)
        wide = np.minimum(LEAST * np.maximum(flow, 1) ** MURRAY, MOST)
        t = (np.arange(PARTS) / PARTS)[:, None]
        up = parent[rows]
        points = places[rows] + t[..., None] * (places[up] - places[rows])
        radii = (wide[rows] + t * (wide[up] - wide[rows])).ravel()
        times = (arrival[rows] + t * (arrival[up] - arrival[rows])).ravel()
        near, apart = nearest(self._device, np.float32(points.reshape(-1, 3)), c.positions, NEAR)
        apart = np.where(near >= 0, apart / np.float32(c.spacing), np.inf)
        near = np.maximum(near, 0)
        inside = 1 - (apart / radii[near]) ** 2
        best = np.argmax(inside * radii[near] ** 2, axis=1)
        every = np.arange(n)
        chosen = near[every, best]
        return _Tree(
            radius=np.float32(radii[chosen]), distance=np.float32(apart[every, best]),
            arrival=np.float32(times[chosen]), piece=np.zeros(n, np.int32),
        )  # fmt: skip

    def _steps(self, arrival: F32) -> F32:
        """Return times of arrival in distances of carriers along the front's way."""
        c, graph = self._carriers, self._carriers.graph
        own = np.repeat(np.arange(len(c)), np.diff(graph.rows))
        with np.errstate(invalid="ignore"):
            later = np.abs(arrival[own] - arrival[graph.neighbors])
        length = np.linalg.norm(c.positions[own] - c.positions[graph.neighbors], axis=1)
        some = np.isfinite(later) & (later > 0)
        if not some.any():
            return arrival
        pace = float(np.quantile(later[some] / length[some], 0.95)) * c.spacing
        return np.float32(arrival / max(pace, 1e-12))


def _smoothed(places: F32, rows: I64, parent: I64) -> F32:
    """Return positions of the tree's nodes without the zigzag of the graph, shape (c, 3)."""
    out = places.astype(np.float64)
    up = parent[rows]
    children = np.bincount(up, minlength=len(places))
    for _ in range(3):
        below = np.stack(
            [np.bincount(up, weights=out[rows, axis], minlength=len(places)) for axis in range(3)]
        ).T
        inner = rows[children[rows] > 0]
        middle = 0.5 * (out[parent[inner]] + below[inner] / children[inner, None])
        out[inner] = 0.5 * (out[inner] + middle)
    return out.astype(np.float32)


