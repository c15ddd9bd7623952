"""What pieces of broken stone are filled with: new splats on their broken faces and their backs.

A capture is a shell. A piece of it that breaks off gets a thickness at that moment: a back below
its carriers, and columns of splats below those at its seams, as deep as the solid there allows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, I64
from usdsplat.core.sh import rgb_to_dc
from usdsplat.kernels.device import Device
from usdsplat.kernels.points.nearest import nearest
from usdsplat.kernels.sim.seeds import draw
from usdsplat.sim.carriers import NEAR, NEAREST, WEIGHTS, Carriers
from usdsplat.sim.outside import Light
from usdsplat.sim.pieces import Pieces
from usdsplat.sim.state import DYING, FREE, State

THICK = 0.42
"""Depth of a piece, relative to its size."""
LAYERS = 5
"""Splats of a column, one over the other."""
SIDE_BY_SIDE = 5
"""Splats of a layer of a column, beside each other."""
BELOW = 0.85
"""Least depth, in distances of carriers: captured splats cover what is there."""
TAPER = 0.22
"""How much a piece narrows towards its back."""
WIDE, FLAT = 0.32, 0.1
"""Standard deviations of a splat along its face and across, in distances of carriers."""
ROUGH = 1.0
"""Random shifts of splats, in distances of carriers."""
OPACITY = 0.97
GREY, DARK, GRAIN = 0.5, 0.78, 0.12
"""How grey broken stone is, how bright relative to its surface, and how much that varies."""
CELL = 1.2
"""Edge of the cells in which it is looked for the inside, in distances of carriers."""
DIM = 0.03
"""Light inside, at most, relative to that usual outside."""
SEED = 9100
"""Added to the seed of the simulation."""
FILLED = "filling:pieces"
"""In `State.globals`: 1 for pieces that have been filled."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Fill:
    """All splats that fill the pieces of a capture, d of them."""

    carriers: I64
    """The carrier that each follows, shape (d,)."""
    positions: F32
    """At rest [unit], shape (d, 3)."""
    rotations: F32
    scales: F32
    colors: F32


class Infill:
    """The filling of one field's pieces.

    Args:
        device: Runs the kernels.
        carriers: Carriers of the field.
        pieces: Its pieces.
        colors: Colour of each carrier, shape (c, 3).
        origin: The splat of the field that is nearest to each carrier, shape (c,).
        ids: Identities of the field's splats.
        size: Size of a piece, in distances of carriers.
        seed: Seed of the random numbers.
    """

    def __init__(
        self,
        device: Device,
        carriers: Carriers,
        pieces: Pieces,
        *,
        colors: F32,
        origin: I32,
        ids: I64,
        size: float,
        seed: int,
    ) -> None:
        self._pieces, self._parents = pieces, ids[origin]
        self._fill = _filled(device, carriers, pieces, colors, size, seed + SEED)

    def due(self, state: State, *, maximum: int) -> tuple[I64, I64]:
        """Return the rows of the filling of pieces that have come loose since the last time, and
        the rows of the splats that they are children of; both of shape (d,).

        Args:
            state: Its record of what has been filled is updated.
            maximum: Number of splats that the state may have; pieces for which there is no room
                stay as they are.
        """
        loose = ~self._pieces.stands
        filled = state.globals.get(FILLED)
        if filled is None:
            filled = np.zeros(len(loose), np.uint8)
        state.globals[FILLED] = (loose | (filled > 0)).astype(np.uint8)
        fresh = loose & (filled == 0)
        if not fresh.any():
            return np.empty(0, np.int64), np.empty(0, np.int64)
        piece = self._pieces.piece[self._fill.carriers]
        sizes = np.bincount(piece, minlength=len(loose)) * fresh
        fresh &= np.cumsum(sizes) <= max(0, maximum - len(state))
        chosen = np.flatnonzero(fresh[piece])
        wanted = self._parents[self._fill.carriers[chosen]]
        rows = np.minimum(np.searchsorted(state.ids, wanted), len(state) - 1)
        alive = state.ids[rows] == wanted
        return chosen[alive].astype(np.int64), rows[alive].astype(np.int64)

    def shape(self, state: State, chosen: I64) -> None:
        """Set the rest values of the last rows of the state, which are this filling."""
        first, fill = len(state) - len(chosen), self._fill
        carriers = fill.carriers[chosen]
        memory = state.memory
        memory[NEAR][first:] = np.pad(
            carriers[:, None].astype(np.int32), ((0, 0), (0, NEAREST - 1)), constant_values=-1
        )
        memory[WEIGHTS][first:] = np.eye(1, NEAREST, dtype=np.float32)
        state.flags[first:] &= ~(FREE | DYING)  # they follow the piece, whatever their parents do
        state.velocities[first:] = 0
        shared = state.sh is state.rest_sh
        names = ("rest_positions", "rest_rotations", "rest_scales", "rest_opacities", "rest_sh")
        for name in names:
            setattr(state, name, np.array(getattr(state, name)))
        state.rest_positions[first:] = fill.positions[chosen]
        state.rest_rotations[first:] = fill.rotations[chosen]
        state.rest_scales[first:] = fill.scales[chosen]
        state.rest_opacities[first:] = OPACITY
        state.rest_sh[first:] = 0
        state.rest_sh[first:, 0] = rgb_to_dc(fill.colors[chosen])
        state.rotations[first:] = state.rest_rotations[first:]
        state.scales[first:] = state.rest_scales[first:]
        if shared:
            state.sh = state.rest_sh
        else:
            state.sh = state.sh.copy()
            state.sh[first:] = state.rest_sh[first:]


def _filled(
    device: Device, carriers: Carriers, pieces: Pieces, colors: F32, size: float, seed: int
) -> _Fill:
    """Return the splats that fill all pieces."""
    c, spacing, graph = len(carriers), carriers.spacing, carriers.graph
    places, normals = carriers.positions.astype(np.float64), carriers.normals.astype(np.float64)
    own = np.repeat(np.arange(c), np.diff(graph.rows))
    seam = np.zeros(c, np.bool_)
    seam[own[pieces.piece[own] != pieces.piece[graph.neighbors]]] = True
    count = np.maximum(np.bincount(pieces.piece), 1)
    middle = np.stack([np.bincount(pieces.piece, weights=places[:, a]) for a in range(3)]).T
    inward = (middle / count[:, None])[pieces.piece] - places
    inward -= normals * np.einsum("ij,ij->i", inward, normals)[:, None]
    number = np.repeat(np.arange(c), LAYERS * SIDE_BY_SIDE)
    layer = np.tile(np.repeat(np.arange(LAYERS), SIDE_BY_SIDE), c)
    back = layer == LAYERS - 1
    kept = (back | seam[number]) & carriers.outer[number]
    number, layer, back = number[kept], layer[kept], back[kept]
    noise: F32 = device.empty(5 * len(number), np.float32)
    device.run(draw, np.arange(5 * len(number), dtype=np.int64), seed, noise)
    chance = noise.reshape(-1, 5)
    part = (layer + chance[:, 3]) / LAYERS
    depth = spacing * (BELOW + 0.1 + THICK * size * part)
    at = places[number] - depth[:, None] * normals[number]
    at += TAPER * part[:, None] * inward[number]
    at += ROUGH * spacing * (chance[:, :3] - 0.5)
    at = at.astype(np.float32)
    # what is thin stays thin: light comes to its other side
    near = nearest(device, carriers.positions, at, 1)[0][:, 0]
    height = np.einsum("ij,ij->i", at - carriers.positions[near], carriers.normals[near])
    light = Light(carriers.positions, CELL * spacing, None)
    outer = light.at(carriers.positions + 2 * light.cell * carriers.normals)
    solid = height < -BELOW * spacing
    for deeper in (0, 1, 2):
        further = at - np.float32(deeper * light.cell) * carriers.normals[number]
        solid &= light.at(further) < DIM * np.median(outer)
    number, back, at, chance = number[solid], back[solid], at[solid], chance[solid]
    side = -inward[number]
    length = np.linalg.norm(side, axis=1, keepdims=True)
    face = np.where(back[:, None] | (length < 1e-9), -normals[number], side / length.clip(1e-12))
    tone = colors[number].astype(np.float64)
    grey = tone.mean(axis=1, keepdims=True)
    tone = (GREY * grey + (1 - GREY) * tone) * DARK * (1 + GRAIN * (2 * chance[:, 3:4] - 1))
    tone *= np.where(back, 0.85, 1.0)[:, None]
    scales = np.empty((len(number), 3), np.float32)
    scales[:, :2] = WIDE * spacing * (0.8 + 0.4 * chance[:, 4:5])
    scales[:, 2] = FLAT * spacing
    return _Fill(
        carriers=number.astype(np.int64),
        positions=at,
        rotations=_facing(face),
        scales=scales,
        colors=_f32(np.clip(tone, 0, 1)),
    )


def _facing(axes: npt.NDArray[np.float64]) -> F32:
    """Return unit quaternions that rotate z to these unit vectors, shape (n, 4)."""
    w = 1 + axes[:, 2]
    turn = np.stack([w, -axes[:, 1], axes[:, 0], np.zeros(len(axes))], axis=1)
    turn[w < 1e-6] = (0, 1, 0, 0)
    return _f32(turn / np.linalg.norm(turn, axis=1, keepdims=True))


def _f32(values: npt.NDArray[Any]) -> F32:
    return np.ascontiguousarray(values, np.float32)
