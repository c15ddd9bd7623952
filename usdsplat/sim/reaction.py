"""Gray-Scott reaction-diffusion on particles that do not move while it runs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from usdsplat.core.cloud import F32, I32, I64
from usdsplat.core.knobs import knobs
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import laplacian as weights
from usdsplat.kernels.sim import reaction as kernels
from usdsplat.sim.neighbors import Graph
from usdsplat.sim.parameters import RdParameters
from usdsplat.sim.presets_rd import rates

FINEST = 0.8
"""Least lattice unit in mean spacings: below it the points do not resolve the pattern."""

LARGEST_V = 0.6
"""Largest v for which the step length is stable; the reaction stays below it."""

FEEDS, KILLS = (
    tuple(np.array(each.range, np.float32))
    for each in knobs(RdParameters)
    if each.name in ("feed", "kill")
)
"""Limits of the rates."""

COUNTS = {2: 4.0, 3: 105 / 16}
"""Dimension -> factor by which the sum of the kernel K gives the number of neighbours at
even density."""


class Reaction:
    """A reaction on points that do not move; weights are computed once.

    Args:
        device: Runs the kernels.
        graph: Positions and neighbours of n points. Lists without a skin are faster.
        parameters: Parameters of the reaction. All may change by `adopt`.
        dimension: 2 where points lie on a surface, 3 where they fill a volume; one number or shape
            (n,).
        normals: Unit vectors, shape (n, 3), to which diffusion directions are made tangential; None
            where points fill a volume.
    """

    def __init__(
        self,
        device: Device,
        graph: Graph,
        parameters: RdParameters,
        *,
        dimension: int | F32 = 2,
        normals: F32 | None = None,
    ) -> None:
        self._device = device
        self.graph = graph
        self._normals = None if normals is None else normals[graph.order]
        every = np.broadcast_to(np.asarray(dimension, np.float32), len(graph.order))
        self._dimension = np.ascontiguousarray(every[graph.order])
        self.spacing = 0.0
        """Mean distance of neighbours [unit]: the root of the area or volume per point."""
        self.parameters = parameters
        self._weigh()

    def adopt(self, parameters: RdParameters) -> None:
        """Change the parameters; weights are computed again only if diffusion changes."""
        before, self.parameters = self.parameters, parameters
        if _diffusion(before) != _diffusion(parameters):
            self._weigh()

    @property
    def scale(self) -> float:
        """Length of a lattice unit [unit]."""
        own = self.parameters.pattern_scale
        return own if own > 0 else self.spacing

    @property
    def is_too_fine(self) -> bool:
        """Whether the points cannot resolve the lattice unit."""
        return self.scale < FINEST * self.spacing

    @property
    def subdivisions(self) -> int:
        """Number of substeps of one `d_tau` that make it stable.

        Gershgorin bounds the rates of diffusion by 2 D S; u decays with F + v^2.
        """
        most = max(self.parameters.diffusion_u, self.parameters.diffusion_v)
        feed, kill = rates(self.parameters)
        decay = feed + max(kill, LARGEST_V**2)
        rate = most * self.scale**2 * self.largest_sum + decay / 2
        return max(1, math.ceil(self.parameters.d_tau * rate))

    def step(
        self,
        uv: F32,
        count: int | None = None,
        *,
        feed_offset: F32 | None = None,
        feed_factor: F32 | None = None,
        kill_factor: F32 | None = None,
    ) -> F32:
        """Return u and v after `count` reaction steps, by default those of a frame.

        Args:
            uv: Shape (n, 2); not changed.
            count: Number of steps of `d_tau`.
            feed_offset: Offset of the feed rate, which is then clamped to 0..0.1, shape (n,).
            feed_factor, kill_factor: Factors of the rates, shape (n,), which are then clamped to
                the parameters' ranges; that of the feed rate precedes its offset.
        """
        rd, graph, device = self.parameters, self.graph, self._device
        feed, kill = rates(rd)
        f = np.float32
        parts = self.subdivisions
        area = self.scale**2
        now = device.move(uv[graph.order].reshape(-1))
        then = device.resident(2 * len(uv), np.float32)
        feeds = device.move(self._feeds(feed, feed_offset, feed_factor))
        kills = device.move(self._by_slot(kill, kill_factor, KILLS))
        for _ in range((rd.substeps if count is None else count) * parts):
            device.run(
                kernels.gray_scott, *self.weights, now, feeds, kills,
                f(rd.diffusion_u * area), f(rd.diffusion_v * area), f(rd.d_tau / parts), then,
            )  # fmt: skip
            now, then = then, now
        after = np.empty((len(uv), 2), np.float32)
        after[graph.order] = device.fetch(now).reshape(-1, 2)
        return after

    def _feeds(self, feed: float, offset: F32 | None, factor: F32 | None) -> F32:
        """Return the feed rate, one number or by slot."""
        feeds = self._by_slot(feed, factor, FEEDS)
        if offset is None:
            return feeds
        return np.clip(feeds + offset[self.graph.order], *FEEDS)

    def _by_slot(self, rate: float, factor: F32 | None, limits: tuple[F32, F32]) -> F32:
        """Return a rate, one number or by slot."""
        if factor is None:
            return np.array([rate], np.float32)
        return np.clip(np.float32(rate) * factor[self.graph.order], *limits)

    def _weigh(self) -> None:
        """Compute the weights of all neighbours, their largest sum, and the mean spacing."""
        graph, rd, device = self.graph, self.parameters, self._device
        row, nbr = device.keep(graph.rows), device.keep(graph.neighbors)
        w = device.resident(len(graph.neighbors), np.float32)
        weighed = device.resident((len(graph.order), 2), np.float32)
        device.run(
            weights.laplacian, device.keep(graph.positions), row, nbr, device.keep(graph.support),
            self._directions(), 1.0 - rd.anisotropy, self._dimension, w, weighed,
        )  # fmt: skip
        sums = device.fetch(weighed)
        self.spacing = _spacing(graph.support, sums[:, 1], self._dimension)
        if rd.conservative:
            both = self._conserved(graph.rows, graph.neighbors, device.fetch(w))
            row, nbr, w = device.keep(both[0]), device.keep(both[1]), device.move(both[2])
            sums = np.empty((len(graph.order), 1), np.float32)
            device.run(weights.row_sums, row, w, sums[:, 0])
        self.weights: tuple[Any, Any, Any] = row, nbr, w
        """Weights of the Laplacian [1/unit^2]: rows, neighbours and weights, in the graph's slots,
        on the device."""
        self.largest_sum = float(sums[:, 0].max(initial=0))
        """Largest sum S of weights of a point [1/unit^2], which limits the step."""

    def _conserved(self, row: I64, nbr: I32, w: F32) -> tuple[I64, I32, F32]:
        """Return the graph with both directions of each pair, equally weighted."""
        extra = np.zeros(len(row) - 1, np.int64)
        self._device.run(weights.missing, row, nbr, extra)
        both = np.zeros_like(row)
        np.cumsum(np.diff(row) + extra, out=both[1:])
        both_nbr, both_w = np.empty(both[-1], np.int32), np.empty(both[-1], np.float32)
        self._device.run(weights.merge, row, nbr, w, both, both_nbr, both_w)
        return both, both_nbr, both_w

    def _directions(self) -> F32:
        """Return unit vectors along which diffusion is faster; no rows if it is isotropic."""
        direction = np.array(self.parameters.direction, np.float64)
        length = float(np.linalg.norm(direction))
        if self.parameters.anisotropy == 0 or length == 0:
            return np.empty((0, 3), np.float32)
        every = np.broadcast_to(direction / length, (len(self._dimension), 3))
        if self._normals is not None:
            n = self._normals.astype(np.float64)
            every = every - n * (every * n).sum(1, keepdims=True)
        lengths = np.linalg.norm(every, axis=1, keepdims=True)
        return np.where(lengths > 0.01, every / np.maximum(lengths, 0.01), 0).astype(np.float32)


def _diffusion(rd: RdParameters) -> tuple[object, ...]:
    return (rd.conservative, rd.anisotropy, rd.direction if rd.anisotropy else None)


def _spacing(h: F32, near: F32, dimension: F32) -> float:
    """Return the mean spacing of points that have neighbours [unit]; 0 if none has."""
    some = near > 0
    if not some.any():
        return 0.0
    h, k = h[some].astype(np.float64), near[some] + 1.0  # a point is in its own neighbourhood
    on_surface = h * np.sqrt(np.pi / (COUNTS[2] * k))
    in_volume = h * np.cbrt(4 / 3 * np.pi / (COUNTS[3] * k))
    return float(np.where(dimension[some] == 2, on_surface, in_volume).mean())
