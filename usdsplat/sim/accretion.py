"""Accretion: new matter that grows over a field's carriers where their pattern is high.

The matter of a carrier begins when v there first exceeds `low`, and stays. Its discs are splats of
the state, whose rest values are computed from the carriers at each frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32, I32, I64
from usdsplat.core.sh import rgb_to_dc
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import accretion as kernels
from usdsplat.kernels.sim import needles as prisms
from usdsplat.kernels.sim import tubes
from usdsplat.sim.carriers import NEAR, NEAREST, WEIGHTS, Carriers
from usdsplat.sim.corals import Corals
from usdsplat.sim.front import ARRIVAL
from usdsplat.sim.motifs import Cells, Look, Motif, Plates, drawn
from usdsplat.sim.needles import Needles
from usdsplat.sim.parameters import AccretionParameters
from usdsplat.sim.specs import Moment
from usdsplat.sim.state import State
from usdsplat.sim.vein_tree import MOST as FULL_VEIN
from usdsplat.sim.vein_tree import Veins

CARRIER, LAYER = "accretion:carrier", "accretion:layer"
"""In `State.memory`: carrier and layer of a disc, -1 for other splats, shape (n,)."""
GROWN = "accretion:grown"
"""In `State.globals`: 1 for carriers whose matter has begun, shape (c,)."""
MOTIFS: dict[str, Callable[[Device, Carriers, float, int], Motif]] = {
    "cells": Cells, "veins": Veins, "plates": Plates, "needles": Needles,
    "corals": Corals,
}  # fmt: skip
CHANGED = (
    "rest_positions", "rest_rotations", "rest_scales", "rest_opacities", "rest_sh",
    "rotations", "scales",
)  # fmt: skip
"""Arrays of the state that change with the discs, and that others may hold."""
MOTIF_SEED = 7000
"""Added to the seed of the simulation."""
SMOOTHINGS = 2
"""Passes that smooth the pattern before matter is raised."""
PROFILES = {
    "dome": kernels.DOME, "ridge": kernels.RIDGE, "plate": kernels.PLATE, "thorn": kernels.THORN,
}  # fmt: skip
RAMPS = {
    "v": kernels.BY_V, "height": kernels.BY_HEIGHT, "age": kernels.BY_AGE,
    "curvature": kernels.BY_CURVATURE,
}  # fmt: skip
LIFT = 0.9
"""Least height of a motif's matter, in distances of carriers: captured splats do not cover it."""
FULL_V = 2.5
"""Factor of v that gives its place on the ramp."""
CLOSED, CRUST_TINT = 1.3, 0.5
"""Factor of the size of a crust's discs, of which there is one for each carrier, and strength of
its tint."""
BEGIN = 1.15
"""Matter of a carrier begins where v exceeds `low` by this factor: lower, nothing can be seen."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Ground:
    """What discs lie on: see the arguments of the kernel `discs`."""

    carrier: I32
    layer: I32
    places: F32
    normals: F32
    values: F32
    heights: F32
    facing: F32
    over: F32


class Accretion:
    """New matter of one field.

    Args:
        device: Runs the kernels.
        carriers: Carriers of the field, by slot.
        origin: The splat of the field that is nearest to each carrier, shape (c,).
        ids: Identities of the field's splats.
        weight: Selection weight of the field's splats, shape (n,): matter does not grow from those
            with 0, and less high from those below 1. Nor does it inside the capture.
        first: Values of the stage at the first frame.
    """

    def __init__(
        self,
        device: Device,
        carriers: Carriers,
        origin: I32,
        ids: I64,
        weight: F32,
        first: Moment,
    ) -> None:
        self._device, self._carriers = device, carriers
        self._origin, self._ids = origin, ids
        self._weight: F32 = weight[origin] * carriers.outer
        self._seed = first.parameters.sim.seed
        self._up = np.asarray(first.up, np.float32)
        self._light = _light(first)
        graph = carriers.graph
        self._graph = graph.rows, graph.neighbors
        self._support = graph.support
        self._motif: Motif | None = None

    def begin(self, state: State) -> None:
        """Prepare the state, without new matter."""
        n = len(state)
        state.memory[CARRIER] = np.full(n, -1, np.int32)
        state.memory[LAYER] = np.full(n, -1, np.int32)
        state.globals[GROWN] = np.zeros(len(self._carriers), np.uint8)

    def due(
        self, state: State, uv: F32, knobs: AccretionParameters, maximum: int, now: float
    ) -> tuple[I64, I64]:
        """Return the carriers whose matter begins now, and the rows of their origins, for each disc
        to add; both of shape (d,). Carriers whose origin has died are left out.

        Args:
            state: Its record of what has begun is updated.
            uv: u and v of the carriers, shape (c, 2).
            knobs: Resolved knobs.
            maximum: Number of splats at which growth ends.
            now: Time since the simulation's start [s].
        """
        grown = state.globals[GROWN]
        if _has_motif(state, knobs):
            look = self._look_at(state, knobs, now)
            there = look.rise > 0 if look.begun is None else look.begun
        else:
            there = uv[:, 1] > BEGIN * knobs.low
        starts = there & (grown == 0) & (self.allowed(knobs) > 0)
        room = max(0, (maximum - len(state)) // knobs.layers)
        carriers = np.flatnonzero(starts)[:room]
        wanted = self._ids[self._origin[carriers]]
        rows = np.minimum(np.searchsorted(state.ids, wanted), len(state) - 1)
        alive = state.ids[rows] == wanted
        grown = grown.copy()
        grown[carriers] = 1
        state.globals[GROWN] = grown
        return np.repeat(carriers[alive], knobs.layers), np.repeat(rows[alive], knobs.layers)

    def bind(self, state: State, carriers: I64, knobs: AccretionParameters) -> None:
        """Set the carriers and layers of the last rows of the state, which are new discs."""
        first = len(state) - len(carriers)
        memory = state.memory
        memory[CARRIER][first:] = carriers
        memory[LAYER][first:] = np.arange(len(carriers)) % knobs.layers
        if isinstance(self._motif, Corals):  # a branch moves with its root
            carriers = self._motif.roots(carriers, memory[LAYER][first:] - 1)
        memory[NEAR][first:] = np.pad(
            carriers[:, None].astype(np.int32), ((0, 0), (0, NEAREST - 1)), constant_values=-1
        )
        memory[WEIGHTS][first:] = np.eye(1, NEAREST, dtype=np.float32)
        state.rest_sh[first:] = 0

    def shape(
        self, state: State, uv: F32, knobs: AccretionParameters, seconds: float, *, is_new: bool
    ) -> None:
        """Compute the rest values of all discs.

        Args:
            state: Its rest values of discs change.
            uv: u and v of the carriers, shape (c, 2).
            knobs: Resolved knobs.
            seconds: Time since the simulation's start [s].
            is_new: Whether the state's arrays are new, so that nothing else holds them. Others are
                replaced.
        """
        rows = np.flatnonzero(state.memory[CARRIER] >= 0)
        if not len(rows):
            return
        discs = _span(rows)
        device, run, c = self._device, self._device.run, self._carriers
        spacing, f = c.spacing, np.float32
        look: Look | None = None
        strength: F32 | None = None
        if not _has_motif(state, knobs):
            values, heights = self._raised(uv, knobs)
        else:
            look = self._look_at(state, knobs, seconds)
            values = look.tone
            lifted = np.where(look.rise > 0, f(LIFT) + f(knobs.relief) * look.rise, f(0))
            heights = lifted * self.allowed(knobs) * f(spacing)
        facing: F32 = device.empty((len(c), 3), np.float32)
        over: F32 = device.empty(len(c), np.float32)
        run(
            kernels.face, c.positions, c.normals, self._support, *self._graph, heights, facing, over
        )
        colors: F32 = device.empty((len(state), 3), np.float32)
        shared = state.sh is state.rest_sh
        for name in () if is_new else CHANGED:
            setattr(state, name, getattr(state, name).copy())
        if isinstance(self._motif, Needles):
            self._place_needles(state, rows, knobs, seconds, colors)
        elif isinstance(self._motif, Veins):
            self._place_veins(state, rows, knobs, colors)
        else:
            on = _Ground(
                carrier=state.memory[CARRIER], layer=state.memory[LAYER], places=c.positions,
                normals=c.normals, values=values, heights=heights, facing=facing, over=over,
            )  # fmt: skip
            if isinstance(self._motif, Corals):
                strength = self._place_corals(state, rows, on, knobs, seconds, colors)
            else:
                self._place_discs(state, rows, on, knobs, seconds, colors)
        if look is not None and knobs.tints:
            piece = look.piece[state.memory[CARRIER][discs]]
            tints = self._tints(knobs, int(look.piece.max()) + 1)[piece]
            colors[discs] *= tints if strength is None else 1 + strength[:, None] * (tints - 1)
        state.rest_sh[discs, 0] = rgb_to_dc(colors[discs])
        # where nothing deforms splats, nothing else computes these
        state.rotations[discs] = state.rest_rotations[discs]
        state.scales[discs] = state.rest_scales[discs]
        if shared:
            state.sh = state.rest_sh
        else:
            state.sh = state.sh if is_new else state.sh.copy()
            state.sh[discs] = state.rest_sh[discs]

    def _raised(self, uv: F32, knobs: AccretionParameters) -> tuple[F32, F32]:
        """Return the pattern's place on the ramp, and the heights [unit], both of shape (c,)."""
        device, c, f = self._device, self._carriers, np.float32
        values = np.ascontiguousarray(uv[:, 1])
        for _ in range(SMOOTHINGS):
            out: F32 = device.empty(len(c), np.float32)
            device.run(kernels.smooth, c.positions, self._support, *self._graph, values, out)
            values = out
        heights: F32 = device.empty(len(c), np.float32)
        device.run(
            kernels.raise_carriers, values, self.allowed(knobs), f(knobs.low), f(knobs.high),
            f(knobs.relief * c.spacing), PROFILES[knobs.profile], heights,
        )  # fmt: skip
        return values * f(FULL_V), heights

    def _place_discs(
        self, state: State, rows: I64, on: _Ground, knobs: AccretionParameters, now: float,
        colors: F32,
    ) -> None:  # fmt: skip
        """Compute place, shape, opacity and colour at rest of the discs in `rows`. They lie on the
        surface `on`. Results are in `state` and `colors`."""
        self._device.run(
            kernels.discs, rows, on.carrier, on.layer, knobs.layers, state.ids, state.births,
            np.float32(now), self._seed, _numbers(knobs, self._carriers.spacing),
            RAMPS[knobs.ramp_by], _ramp(knobs), self._light, on.places, on.normals, on.values,
            on.heights, on.facing, on.over, state.rest_positions, state.rest_rotations,
            state.rest_scales, state.rest_opacities, colors,
        )  # fmt: skip

    def _place_corals(
        self, state: State, rows: I64, on: _Ground, knobs: AccretionParameters, now: float,
        colors: F32,
    ) -> F32:  # fmt: skip
        """Compute the rest values of a crust and of the branches on it, at the time of the last
        look. Return the strength of the tint of each row, shape (d,)."""
        assert isinstance(self._motif, Corals)
        high = on.layer[rows] > 0
        flat, rising = rows[~high], rows[high]
        self._place_discs(state, flat, on, knobs, now, colors)
        state.rest_scales[flat, :2] *= np.float32(CLOSED)
        state.rest_opacities[flat] *= np.minimum(4 * self._motif.crust[on.carrier[flat]], 1)
        strength = np.full(len(rows), CRUST_TINT, np.float32)
        spacing, d = np.float32(self._carriers.spacing), len(rising)
        at = self._motif.placed(
            on.carrier[rising], on.layer[rising] - 1, knobs.relief * float(spacing),
            state.globals[ARRIVAL], now,
        )  # fmt: skip
        number = np.full(len(state), -1, np.int32)
        number[rising] = np.arange(d, dtype=np.int32)
        surface = _Ground(
            carrier=number, layer=np.zeros(len(state), np.int32), places=at.positions,
            normals=at.normals, values=at.tones, heights=np.zeros(d, np.float32),
            facing=at.normals, over=kernels.VALLEY * spacing * (2 * at.opened - 1),
        )  # fmt: skip
        if d:  # of one layer, there is the crust alone
            self._place_discs(state, rising, surface, knobs, now, colors)
        thin = np.float32(knobs.thickness) * spacing
        state.rest_scales[rising, :2] *= at.spread[:, None] / spacing
        state.rest_scales[rising] = np.maximum(state.rest_scales[rising], thin)
        state.rest_opacities[rising[at.spread <= 0]] = 0
        strength[high] = at.tints
        return strength

    def _place_needles(
        self, state: State, rows: I64, knobs: AccretionParameters, now: float, colors: F32
    ) -> None:
        """Compute the rest values of needles' splats."""
        assert isinstance(self._motif, Needles)
        p, spacing = self._motif.prisms, self._carriers.spacing
        grown = self._motif.grown(state.globals[ARRIVAL], now)
        numbers = np.array(
            [
                knobs.relief * spacing, knobs.opacity, knobs.shade, knobs.gloss,
                knobs.thickness * spacing, knobs.size,
            ],
            np.float32,
        )  # fmt: skip
        self._device.run(
            prisms.facets, rows, state.memory[CARRIER], state.memory[LAYER], knobs.layers, p.site,
            p.rank, p.count, p.bases, p.axes, p.lengths, p.radii, grown, numbers, _ramp(knobs),
            self._light, state.rest_positions, state.rest_rotations, state.rest_scales,
            state.rest_opacities, colors,
        )  # fmt: skip

    def _place_veins(
        self, state: State, rows: I64, knobs: AccretionParameters, colors: F32
    ) -> None:
        """Compute the rest values of the splats of veins, at the time of the last look."""
        assert isinstance(self._motif, Veins)
        c, tree = self._carriers, self._motif.tree
        radii = self._motif.radius * self.allowed(knobs)
        radii *= np.float32(knobs.relief / FULL_VEIN * c.spacing)
        feet = tree.feet + c.normals * np.float32(LIFT * c.spacing)
        values = c.spacing, knobs.opacity, knobs.shade, knobs.gloss, knobs.thickness * c.spacing
        numbers = np.array(values, np.float32)
        self._device.run(
            tubes.strokes, rows, state.memory[CARRIER], state.memory[LAYER], knobs.layers,
            state.ids, self._seed, c.normals, feet, tree.ways, radii, numbers,
            _ramp(knobs), self._light, state.rest_positions, state.rest_rotations,
            state.rest_scales, state.rest_opacities, colors,
        )  # fmt: skip

    def _look_at(self, state: State, knobs: AccretionParameters, now: float) -> Look:
        """Return the look of the motif."""
        if self._motif is None:
            seed = self._seed + MOTIF_SEED
            self._motif = MOTIFS[knobs.motif](self._device, self._carriers, knobs.motif_size, seed)
            if isinstance(self._motif, Needles):
                self._motif.keep_to(self.allowed(knobs))
            if isinstance(self._motif, Corals):
                self._motif.keep_to(self.allowed(knobs), knobs.layers - 1, self._up)
        return self._motif.at(state.globals[ARRIVAL], now)

    def _tints(self, knobs: AccretionParameters, count: int) -> F32:
        """Return the colour by which each piece's is multiplied, shape (count, 3)."""
        every = np.array(knobs.tints, np.float32)
        number = drawn(self._device, count, self._seed + MOTIF_SEED - 1) * len(every)
        return np.asarray(every[number.astype(np.int64)], np.float32)

    def allowed(self, knobs: AccretionParameters) -> F32:
        """Return the factor of the height of each carrier, shape (c,)."""
        if knobs.upward <= 0:
            return self._weight
        facing = self._carriers.normals @ self._up
        least = 2 * knobs.upward - 1.4
        part = np.clip((facing - least) / 0.4, 0, 1)
        return (self._weight * part * part * (3 - 2 * part)).astype(np.float32)


def _span(rows: I64) -> I64 | slice:
    """Return ascending rows as a slice where none is missing, which takes less time."""
    first, last = int(rows[0]), int(rows[-1])
    return slice(first, last + 1) if last - first + 1 == len(rows) else rows


def _has_motif(state: State, knobs: AccretionParameters) -> bool:
    """Return whether matter has the shapes of a motif, which needs the times of a front."""
    return knobs.motif != "pattern" and ARRIVAL in state.globals


def _numbers(knobs: AccretionParameters, spacing: float) -> F32:
    """Return the numbers that the kernel of discs takes."""
    return np.array(
        [
            knobs.relief, knobs.size, knobs.thickness, knobs.opacity, knobs.jitter,
            math.radians(knobs.tilt), knobs.variation, knobs.shade, knobs.occlusion,
            knobs.ramp_time, knobs.rise, spacing, knobs.gloss,
        ],
        np.float32,
    )  # fmt: skip


def _ramp(knobs: AccretionParameters) -> F32:
    """Return the ramp as a table, shape (COLORS, 3)."""
    colors = np.array(knobs.ramp or ((0.5, 0.5, 0.5),), np.float64)
    at = np.linspace(0, len(colors) - 1, kernels.COLORS)
    table = [np.interp(at, np.arange(len(colors)), channel) for channel in colors.T]
    return np.ascontiguousarray(np.transpose(table), np.float32)


def _light(moment: Moment) -> F32:
    """Return the unit vector to the light in the simulation's space, shape (3,)."""
    up = np.asarray(moment.up)
    linear = moment.to_world[:3, :3]
    right = np.linalg.solve(linear, np.array([1.0, 0.0, 0.0]))
    right -= (right @ up) * up
    right /= np.linalg.norm(right) or 1.0
    front = np.cross(right, up) * (1.0 if np.linalg.det(linear) > 0 else -1.0)
    x, y, z = moment.parameters.accretion.light
    found = x * right + y * up + z * front
    return np.asarray(found / (np.linalg.norm(found) or 1.0), np.float32)
