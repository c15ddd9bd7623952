"""The motif of veins: tubes that branch as a tree over the surface, from the seeds of the front.

Evenly spaced ends are joined to the seeds by paths along which the front's time of arrival falls,
and which prefer paths that exist. Radii follow from the number of ends beyond.

Source: Murray 1926, "The physiological principle of minimum work": cubes of radii add up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32, I64
from usdsplat.kernels.device import Device
from usdsplat.kernels.points.nearest import nearest
from usdsplat.kernels.sim.geodesic import geodesics
from usdsplat.sim.carriers import Carriers
from usdsplat.sim.motifs import Look, drawn, noise, sites_of

MURRAY = 1 / 2.4
"""Exponent of radii: 1/3 is Murray's, a larger one tells trunks from ends."""
LEAST, MOST = 0.55, 2.6
"""Radii of ends, and largest radii, in distances of carriers."""
MEANDER, JOIN = 1.5, 4.0
"""How much paths stray, and how much they prefer others, in distances of carriers."""
ROOTS = 4
"""About the largest number of trees."""
THICKENING = 1.6
"""Time in which a vein takes its thickness [s]."""
REACH = 1.2
"""Distance at which carriers have splats of a thin vein, in distances of carriers."""
NEAR = 6
"""Number of points on veins that a carrier looks at."""
PARTS = 4
"""Points on each edge of the tree."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Tree:
    """The vein that each of c carriers is nearest to."""

    radius: F32
    """Its radius there, in distances of carriers."""
    distance: F32
    """Distance from it, in distances of carriers; inf for none."""
    arrival: F32
    """Time at which it gets there [s]."""
    feet: F32
    """Its nearest point [unit], shape (c, 3)."""
    ways: F32
    """Unit vectors along it there, shape (c, 3)."""

    @classmethod
    def nothing(cls, c: int) -> _Tree:
        """Return a tree without veins for c carriers."""
        none, zero = np.full(c, np.inf, np.float32), np.zeros((c, 3), np.float32)
        return cls(
            radius=np.zeros(c, np.float32), distance=none, arrival=none, feet=zero, ways=zero
        )


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
        ends = sites_of(device, carriers, size, seed)
        self._ends = ends[np.argsort(drawn(device, len(ends), seed + 1), kind="stable")]
        self._stray = noise(device, carriers, seed + 2, 6.0) + 0.3 * drawn(
            device, len(carriers), seed + 3
        )
        graph, places = carriers.graph, carriers.positions
        own = np.repeat(np.arange(len(carriers)), np.diff(graph.rows))
        length = np.linalg.norm(places[own] - places[graph.neighbors], axis=1) / carriers.spacing
        # paths stray through what is cheap, as veins do
        toll = 1 + MEANDER * self._stray[graph.neighbors]
        inside = ~(carriers.outer[own] & carriers.outer[graph.neighbors])
        self._length = np.where(inside, np.inf, length).astype(np.float32)
        self._costs = np.where(inside, np.inf, length * toll).astype(np.float32)
        self._own = own
        self._of: F32 | None = None
        self.tree = _Tree.nothing(len(carriers))
        """The veins as the last call of `at` found them."""
        self.radius = np.zeros(len(carriers), np.float32)
        """Radius of the vein that each carrier has splats of, in distances of carriers, then."""

    def at(self, arrival: F32, now: float) -> Look:
        """Return the look at a time: veins run outwards with the front, and thicken."""
        if self._of is None or not np.array_equal(self._of, arrival):
            self.tree, self._of = self._grown(arrival), arrival
        tree = self.tree
        with np.errstate(invalid="ignore"):
            age = np.clip((now - tree.arrival) / THICKENING, 0, 1)
        radius = tree.radius * np.where(tree.arrival <= now, 0.45 + 0.55 * age, 0)
        with np.errstate(invalid="ignore"):
            here = (radius > 0) & (tree.distance < np.maximum(radius, REACH))
        self.radius = np.where(here, radius, 0).astype(np.float32)
        part = self.radius / np.float32(MOST)
        return Look(rise=part, tone=part, piece=np.zeros(len(arrival), np.int32))

    def _grown(self, arrival: F32) -> _Tree:
        """Return the tree for these times of arrival."""
        c, n = self._carriers, len(self._carriers)
        roots = np.flatnonzero(np.isfinite(arrival) & c.outer)
        roots = roots[arrival[roots] <= arrival[roots].min(initial=np.inf)]
        ways, parent = self._ways(arrival, roots[:: max(1, len(roots) // ROOTS)])
        rows = np.flatnonzero(parent >= 0)
        if not len(rows):
            return _Tree.nothing(n)
        flow = np.zeros(n)
        flow[self._ends[parent[self._ends] >= 0]] = 1
        for i in rows[np.argsort(-ways[rows], kind="stable")].tolist():
            flow[parent[i]] += flow[i]
        places = _smoothed(c.positions, rows, parent)
        wide = np.minimum(LEAST * np.maximum(flow, 1) ** MURRAY, MOST)
        times = self._times(arrival, rows, parent, ways)
        t = (np.arange(PARTS) / PARTS)[None, :]
        up = parent[rows]
        points = places[rows, None] + t[..., None] * (places[up] - places[rows])[:, None]
        radii = (wide[rows, None] + t * (wide[up] - wide[rows])[:, None]).ravel()
        begins = (times[rows, None] + t * (times[up] - times[rows])[:, None]).ravel()
        tree = np.ascontiguousarray(points.reshape(-1, 3), np.float32)
        edge = places[up].astype(np.float64) - places[rows]
        edge /= np.maximum(np.linalg.norm(edge, axis=1, keepdims=True), 1e-12)
        ways_along = np.repeat(edge, PARTS, axis=0).astype(np.float32)
        near, apart = nearest(self._device, tree, c.positions, NEAR)
        apart = np.where(near >= 0, apart / np.float32(c.spacing), np.inf)
        near = np.maximum(near, 0)
        best = np.argmax(radii[near] ** 2 - apart**2, axis=1)
        every = np.arange(n)
        chosen = near[every, best]
        return _Tree(
            radius=radii[chosen].astype(np.float32),
            distance=np.where(c.outer, apart[every, best], np.inf).astype(np.float32),
            arrival=begins[chosen].astype(np.float32),
            feet=tree[chosen],
            ways=ways_along[chosen],
        )

    def _ways(self, arrival: F32, roots: I64) -> tuple[F32, I64]:
        """Return the cost of the way to each carrier, shape (c,), and the carrier before it on the
        way to the ends, -1 for none, shape (c,)."""
        graph, n = self._carriers.graph, len(self._carriers)
        parent, on = np.full(n, -1, np.int64), np.zeros(n, np.bool_)
        if not len(roots):
            return np.full(n, np.inf, np.float32), parent
        costs = np.where(np.isfinite(arrival[graph.neighbors]), self._costs, np.inf)
        ways, _ = geodesics(
            self._device, graph.rows, graph.neighbors, costs.astype(np.float32), roots
        )
        for end in self._ends[np.isfinite(ways[self._ends])].tolist():
            at = end
            while not on[at]:
                on[at] = True
                edges = np.arange(graph.rows[at], graph.rows[at + 1])
                near = graph.neighbors[edges]
                lower = ways[near] < ways[at]
                if not lower.any():
                    break
                edges, near = edges[lower], near[lower]
                score = ways[near] + costs[edges] - JOIN * on[near]
                parent[at] = at = int(near[np.argmin(score)])
        return ways, parent

    def _times(self, arrival: F32, rows: I64, parent: I64, ways: F32) -> F32:
        """Return the time at which veins reach the tree's carriers [s], shape (c,): they run as
        fast as the front, and are never ahead of it."""
        c, graph = self._carriers, self._carriers.graph
        with np.errstate(invalid="ignore"):
            later = np.abs(arrival[self._own] - arrival[graph.neighbors]) / self._length
        some = later[np.isfinite(later) & (later > 0)]
        pace = float(np.quantile(some, 0.95)) if len(some) else 0.0
        times = arrival.astype(np.float64)
        apart = np.zeros(len(c))
        apart[rows] = np.linalg.norm(c.positions[rows] - c.positions[parent[rows]], axis=1)
        for i in rows[np.argsort(ways[rows], kind="stable")].tolist():
            times[i] = max(times[i], times[parent[i]] + pace * apart[i] / c.spacing)
        return times.astype(np.float32)


def _smoothed(places: F32, rows: I64, parent: I64) -> F32:
    """Return positions of the tree's nodes, smoothed along its branches, shape (c, 3).

    Branches follow edges between carriers, so that without it they zigzag.
    """
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
