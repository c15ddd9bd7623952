"""The front of a pattern: it spreads from seeds over the surface, at a speed of its own.

Where the front arrives, nuclei of the pattern are planted. The times of arrival are distances along
the carriers, so they depend neither on the frames that are simulated nor on their rate.
"""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import F32, I64
from usdsplat.kernels.device import Device
from usdsplat.kernels.points.nearest import nearest
from usdsplat.kernels.sim import seeds as kernels
from usdsplat.kernels.sim.geodesic import geodesics
from usdsplat.sim.carriers import Carriers
from usdsplat.sim.parameters import RdParameters
from usdsplat.sim.seeds import SEED_RADIUS, connected
from usdsplat.sim.state import State

ARRIVAL, PASSED = "front:arrival", "front:passed"
"""In `State.globals`: time at which the front reaches each carrier [s], shape (c,); and time up to
which nuclei have been planted [s], shape (1,)."""
DENSITY = 0.006
"""Fraction of the carriers that are centres of nuclei."""


class Front:
    """The front of one field's pattern.

    Args:
        device: Runs the kernels.
        carriers: Carriers of the field, by slot.
        parameters: Knobs of the reaction.
        seed: Seed of the random numbers.
    """

    def __init__(
        self, device: Device, carriers: Carriers, parameters: RdParameters, seed: int
    ) -> None:
        self._device, self._carriers = device, carriers
        self._parameters, self._seed = parameters, seed

    def begin(self, state: State, selection: F32) -> None:
        """Choose the seeds, and compute when the front reaches each carrier.

        Args:
            state: Receives the times.
            selection: Selection weight of each carrier, shape (c,). The front does not cross
                carriers with 0.
        """
        state.globals[ARRIVAL] = self._spread(self._seeds(selection), selection)
        state.globals[PASSED] = np.array([0.0])

    def reached(self, state: State, seed: F32 | None, now: float) -> F32:
        """Return the weight with which each carrier is planted now, shape (c,).

        Args:
            state: Its times are updated.
            seed: Weight of affectors that seed, shape (c,): the front spreads from there, too.
            now: Time since the simulation's start [s].
        """
        arrival: F32 = state.globals[ARRIVAL]
        passed = float(state.globals[PASSED][0])
        if seed is not None:
            fresh = np.flatnonzero((seed > 0.5) & (arrival > now)).astype(np.int64)
            if len(fresh):
                ones = np.ones(len(arrival), np.float32)
                arrival = np.minimum(arrival, np.float32(now) + self._spread(fresh, ones))
                state.globals[ARRIVAL] = arrival
        due = (arrival <= now) & (arrival > passed)
        if passed == 0:
            due |= arrival == 0
        state.globals[PASSED] = np.array([now])
        planted = self._nuclei() * due if due.any() else np.zeros(len(due), np.float32)
        if passed == 0:  # the seeds themselves are planted in any case
            planted[arrival * self._parameters.front_speed <= SEED_RADIUS] = 1
        return planted if seed is None else np.maximum(planted, seed)

    def _spread(self, sources: I64, selection: F32) -> F32:
        """Return the time that the front takes from the nearest source to each carrier [s]."""
        c, graph = self._carriers, self._carriers.graph
        if not len(sources):
            return np.full(len(c), np.inf, np.float32)
        own = np.repeat(np.arange(len(c)), np.diff(graph.rows))
        apart = c.positions[own] - c.positions[graph.neighbors]
        length = np.linalg.norm(apart, axis=1)
        costs = (length / (self._parameters.front_speed * c.spacing)).astype(np.float32)
        costs[selection[graph.neighbors] <= 0] = np.inf
        found, _ = geodesics(self._device, graph.rows, graph.neighbors, costs, sources)
        return self._leapt(found, costs, selection)

    def _leapt(self, found: F32, costs: F32, selection: F32) -> F32:
        """Return times of arrival also for parts of the capture that nothing connects to others:
        the front leaps to them from the nearest carrier, at its speed."""
        c, graph = self._carriers, self._carriers.graph
        part = connected(self._device, graph)
        reached = np.isfinite(found)
        left = np.flatnonzero(~np.isin(part, part[reached]) & (selection > 0))
        if not len(left) or not reached.any():
            return found
        near, apart = nearest(self._device, c.positions[reached], c.positions[left], 1)
        pace = 1 / (self._parameters.front_speed * c.spacing)
        starts = found[reached][near[:, 0]] + pace * apart[:, 0]
        order = np.lexsort((starts, part[left]))
        first = order[np.unique(part[left][order], return_index=True)[1]]
        others, _ = geodesics(
            self._device, graph.rows, graph.neighbors, costs, left[first].astype(np.int64),
            starts[first].astype(np.float32),
        )  # fmt: skip
        return np.minimum(found, others)

    def _seeds(self, selection: F32) -> I64:
        """Return the carriers from which the front starts, on the outside if there are any."""
        mode, c = self._parameters.seed_mode, self._carriers
        allowed = np.flatnonzero((selection > 0) & c.outer)
        if not len(allowed):
            allowed = np.flatnonzero(selection > 0)
        if mode == "affectors" or not len(allowed):
            return np.empty(0, np.int64)
        if mode == "selection":
            return np.flatnonzero(selection > 0.5).astype(np.int64)
        if mode == "noise":
            drawn: F32 = self._device.empty(len(c), np.float32)
            size = 8 * SEED_RADIUS * c.spacing
            self._device.run(kernels.noise, c.positions, self._seed, size, drawn)
            order = np.argsort(-drawn[allowed], kind="stable")
        else:
            drawn = self._device.empty(len(c), np.float32)
            self._device.run(kernels.draw, np.arange(len(c)), self._seed, drawn)
            order = np.argsort(drawn[allowed], kind="stable")
        return np.sort(allowed[order[: self._parameters.seeds]]).astype(np.int64)

    def _nuclei(self) -> F32:
        """Return 1 for carriers in a nucleus, shape (c,)."""
        c = self._carriers
        drawn: F32 = self._device.empty(len(c), np.float32)
        self._device.run(kernels.draw, np.arange(len(c)), self._seed + 1, drawn)
        centres = c.positions[drawn < DENSITY]
        if not len(centres):
            return np.zeros(len(c), np.float32)
        _, distances = nearest(self._device, centres, c.positions, 1)
        return (distances[:, 0] <= SEED_RADIUS * c.spacing).astype(np.float32)
