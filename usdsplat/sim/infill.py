"""What pieces of broken stone are filled with, so that they are solid: new splats, and edges.

A capture is a shell. Where it breaks, broken faces go down from the seams, to the depth that the
solid there allows or the size of a piece asks for; a back closes each piece below, and a ground
coat under its surface closes what cut splats leave open. Captured splats end at the seams, and
those that were captured inside the solid vanish.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, F64, I32, I64
from usdsplat.core.sh import rgb_to_dc
from usdsplat.kernels.device import Device
from usdsplat.kernels.points.nearest import nearest
from usdsplat.kernels.sim.seeds import draw
from usdsplat.sim.carriers import NEAR, NEAREST, WEIGHTS, Carriers
from usdsplat.sim.outside import Light
from usdsplat.sim.pieces import Pieces
from usdsplat.sim.seams import Bools, Seams
from usdsplat.sim.state import DYING, FREE, State

THICK = 0.5
"""Depth of a piece, relative to its size."""
STEP = 0.35
"""Distance of splats on broken faces, in distances of carriers."""
BESIDE = 2
"""Splats of a broken face beside each other, for each carrier at its seam."""
TOP, COAT = 0.3, 0.45
"""How deep below the captured surface the first row of splats of a broken face lies, and how deep
the ground coat lies, in distances of carriers."""
SOLID = 1.0
"""Depth from which there is something to fill, in distances of carriers."""
MIDDLE = 0.72
"""Distance to the surface, relative to the depth, below which a place is nearer to another side."""
WIDE, FLAT = 0.22, 0.04
"""Standard deviations of a splat along its face and across, in distances of carriers."""
FINE = np.array([[-0.25, -0.25], [0.25, -0.25], [-0.25, 0.25], [0.25, 0.25]])
"""Places of the splats of a back and of the ground coat around a carrier, in distances of
carriers."""
BACK = 0.32
"""Standard deviation of these along their face, in distances of carriers."""
ROUGH, TILT = 0.08, 0.16
"""Random shifts of splats across their face, in distances of carriers, and tilts."""
OPACITY = 0.98
GREY, DARK, GRAIN = 0.3, 0.88, 0.07
"""Broken stone: how grey, how bright relative to its surface, and how much brightness varies."""
SHADE = 0.22
"""How much darker faces are that look down, so that they are told apart."""
CELL = 1.2
"""Edge of the cells in which light is computed, in distances of carriers."""
DIM = 0.03
"""Largest light of a place inside, relative to the median of the light outside."""
HIDDEN = 1.2
"""Distance to the surface from which captured splats in the dark vanish, in distances of
carriers."""
SEED = 9100
"""Added to the seed of the simulation."""
FILLING = "filling:is"
"""In `State.memory`: 1 for the filling, 0 for other splats, uint8, shape (n,)."""
OPENED = "filling:seams"
"""In `State.globals`: 1 for points of seams that have opened."""
CAPTURED = "filling:captured"
"""In `State.memory`: captured splats before they were cut, float32, shape (n, 10): position less
that at rest now, rotation, scales; rotation 0 where nothing is kept yet. Splats grow and have
children, which the differences of positions follow."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Fill:
    """The d splats that fill all pieces, and when each is born."""

    carriers: I64
    """The carrier that each follows, shape (d,)."""
    seams: I64
    """The point of a seam that it is born at, -1 for none, shape (d,)."""
    pieces: I64
    """The piece at whose first open seam it is born, -1 for none, shape (d,); where there is
    neither, at the first one of all."""
    positions: F32
    """At rest [unit], shape (d, 3)."""
    rotations: F32
    scales: F32
    colors: F32


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Due:
    """What seams that have opened change."""

    chosen: I64
    """Rows of the filling that are born, shape (b,)."""
    parents: I64
    """Rows of the splats that they are children of, shape (b,)."""
    seams: Bools
    """Which points of seams have opened, shape (s,)."""
    is_first: bool
    """Whether none had been open before."""

    def __bool__(self) -> bool:
        return bool(self.seams.any())


class Infill:
    """The filling of one field's pieces.

    Args:
        device: Runs the kernels.
        carriers: Carriers of the field.
        pieces: Its pieces.
        colors: Colour of each carrier, shape (c, 3).
        up: Unit vector upwards, shape (3,).
        parents: Identity of the splat of the field that is nearest to each carrier, shape (c,).
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
        up: F32,
        parents: I64,
        size: float,
        seed: int,
    ) -> None:
        self._device, self._carriers, self._pieces = device, carriers, pieces
        self._parents = parents
        self._seams = Seams.of(device, carriers, pieces.piece)
        self._inside = _Inside(device, carriers)
        depths = self._inside.depths(THICK * size)
        self._fill = _filled(
            device, carriers, pieces.piece, self._seams, depths, colors, up, seed + SEED
        )
        self._nothing = Due(
            chosen=np.empty(0, np.int64), parents=np.empty(0, np.int64),
            seams=np.zeros(len(self._seams), np.bool_), is_first=False,
        )  # fmt: skip

    def due(self, state: State, places: F32, *, maximum: int) -> Due:
        """Return what changes, as seams have opened since the last time.

        Args:
            state: Its record of what is open is updated.
            places: Where the carriers are now, shape (c, 3).
            maximum: Number of splats that the state may have. Seams whose filling there is no
                room for stay shut, as a whole, until there is.
        """
        c, seams = self._carriers, self._seams
        before = state.globals.get(OPENED)
        if before is None:
            before = np.zeros(len(seams), np.uint8)
        loose = ~self._pieces.stands
        fresh = (before == 0) & (loose[seams.own] | loose[seams.other])
        fresh &= seams.parted(c.positions, places, c.spacing)
        if not fresh.any():
            state.globals[OPENED] = before
            return self._nothing
        fresh = self._admitted(before > 0, fresh, max(0, maximum - len(state)))
        state.globals[OPENED] = (fresh | (before > 0)).astype(np.uint8)
        chosen = np.flatnonzero(self._born(before > 0, fresh))
        wanted = self._parents[self._fill.carriers[chosen]]
        rows = np.minimum(np.searchsorted(state.ids, wanted), len(state) - 1)
        alive = state.ids[rows] == wanted
        return Due(
            chosen=chosen[alive].astype(np.int64),
            parents=rows[alive].astype(np.int64),
            seams=fresh,
            is_first=not before.any(),
        )

    def _admitted(self, before: Bools, fresh: Bools, room: int) -> Bools:
        """Return which points open: whole seams, in the order of their pieces, shape (s,).

        Args:
            before: Points that are open, shape (s,).
            fresh: Those that have parted, shape (s,).
            room: Number of splats that there is room for.
        """
        if np.count_nonzero(self._born(before, fresh)) <= room:
            return fresh
        own, other = self._seams.own, self._seams.other
        pair = np.minimum(own, other) * len(self._pieces.stands) + np.maximum(own, other)
        pairs = np.unique(pair[fresh])
        low, high = 0, len(pairs) - 1  # more open seams have no less filling
        while low < high:
            middle = (low + high + 1) // 2
            some = fresh & (pair < pairs[middle])
            if np.count_nonzero(self._born(before, some)) <= room:
                low = middle
            else:
                high = middle - 1
        return np.asarray(fresh & (pair < pairs[low]))

    def _born(self, before: Bools, fresh: Bools) -> Bools:
        """Return which splats of the filling are born if these points open, shape (d,)."""
        return self._open(before | fresh) & ~self._open(before)

    def _open(self, seams: Bools) -> Bools:
        """Return which splats of the filling are born if these seams are open, shape (d,)."""
        fill = self._fill
        pieces = np.zeros(len(self._pieces.stands), np.bool_)
        pieces[self._seams.own[seams]] = True
        at_seam = np.where(fill.seams >= 0, seams[np.maximum(fill.seams, 0)], False)
        at_piece = np.where(fill.pieces >= 0, pieces[np.maximum(fill.pieces, 0)], False)
        always = (fill.seams < 0) & (fill.pieces < 0)
        return np.asarray(at_seam | at_piece | (always & seams.any()))

    def shape(self, state: State, due: Due) -> None:
        """Set the rest values of the last rows of the state, which are the filling that is due, and
        cut captured splats where seams have opened."""
        first, fill, chosen = len(state) - len(due.chosen), self._fill, due.chosen
        carriers = fill.carriers[chosen]
        memory = state.memory
        memory[NEAR][first:] = np.pad(
            carriers[:, None].astype(np.int32), ((0, 0), (0, NEAREST - 1)), constant_values=-1
        )
        memory[WEIGHTS][first:] = np.eye(1, NEAREST, dtype=np.float32)
        if FILLING not in memory:
            memory[FILLING] = np.zeros(len(state), np.uint8)
        memory[FILLING][first:] = 1
        state.flags[first:] &= ~(FREE | DYING)  # they follow the piece, whatever their parents do
        state.velocities[first:] = 0
        shared = state.sh is state.rest_sh
        names = ("rest_positions", "rest_rotations", "rest_scales", "rest_opacities", "rest_sh")
        for name in names:
            setattr(state, name, np.array(getattr(state, name)))
        self._cut(state, due)
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

    def _cut(self, state: State, due: Due) -> None:
        """Cut captured splats at seams; those that were captured inside vanish at first."""
        memory = state.memory
        captured = np.flatnonzero((memory[FILLING] == 0) & (memory[NEAR][:, 0] >= 0))
        if due.is_first:
            hidden = self._inside.hides(state.rest_positions[captured])
            state.rest_opacities[captured[hidden]] = 0
        piece = np.full(len(state), -1, np.int32)
        piece[captured] = self._pieces.piece[memory[NEAR][captured, 0]]
        shapes = state.rest_positions, state.rest_rotations, state.rest_scales
        rows, made, gone = self._seams.cut(
            self._device, state.globals[OPENED] > 0, due.seams, piece, self._carriers.spacing,
            _captured(state),
        )  # fmt: skip
        kept = memory[CAPTURED]
        kept[rows, :3] += shapes[0][rows] - made[0]
        for array, values in zip(shapes, made, strict=True):
            array[rows] = values
        state.rest_opacities[rows[gone]] = 0


def _captured(state: State) -> tuple[F32, F32, F32]:
    """Return positions, rotations and scales of splats at rest before they were cut, and keep what
    is not kept yet."""
    kept = state.memory.setdefault(CAPTURED, np.zeros((len(state), 10), np.float32))
    fresh = ~kept[:, 3:7].any(axis=1)
    kept[fresh, :3] = 0
    kept[fresh, 3:7] = state.rest_rotations[fresh]
    kept[fresh, 7:] = state.rest_scales[fresh]
    return _f32(state.rest_positions + kept[:, :3]), _f32(kept[:, 3:7]), _f32(kept[:, 7:])


class _Inside:
    """Tells places inside the capture, where hardly any light comes, from those outside."""

    def __init__(self, device: Device, carriers: Carriers) -> None:
        self._device, self._carriers = device, carriers
        self._light = Light(carriers.positions, CELL * carriers.spacing, None)
        outside = carriers.positions + 2 * self._light.cell * carriers.normals
        self._dark = DIM * float(np.median(self._light.at(outside))) if len(carriers) else 0.0

    def depths(self, most: float) -> F64:
        """Return how deep the solid is below each carrier, at most `most` distances of carriers;
        0 below those inside, and where light comes to the other side, shape (c,) [unit]."""
        c, spacing = self._carriers, self._carriers.spacing
        depth, going = np.zeros(len(c)), c.outer.copy()
        for number in range(1, max(round(most / STEP), 2) + 1):
            deep = number * STEP * spacing
            at = c.positions - np.float32(deep) * c.normals
            near, apart = (each[:, 0] for each in nearest(self._device, c.positions, at, 1))
            height = np.einsum("ij,ij->i", at - c.positions[near], c.normals[near])
            going &= (apart >= MIDDLE * deep) & (height < 0)
            for deeper in (0, 1, 2):
                further = at - np.float32(deeper * self._light.cell) * c.normals
                going &= self._light.at(further) < self._dark
            depth[going] = deep
        own = np.repeat(np.arange(len(c)), np.diff(c.graph.rows))
        count = np.maximum(np.diff(c.graph.rows), 1)
        mean = np.bincount(own, depth[c.graph.neighbors], len(c)) / count
        return np.where(depth >= SOLID * spacing, np.minimum(depth, mean + 0.5 * spacing), 0)

    def hides(self, places: F32) -> Bools:
        """Return which places are inside, away from the outer surface, shape (n,)."""
        c = self._carriers
        surface = c.positions[c.outer]
        if not len(surface):
            return np.zeros(len(places), np.bool_)
        near, apart = (each[:, 0] for each in nearest(self._device, surface, places, 1))
        height = np.einsum("ij,ij->i", places - surface[near], c.normals[c.outer][near])
        away = (apart > HIDDEN * c.spacing) & (height < 0)
        return np.asarray(away & (self._light.at(places) < self._dark))


def _filled(
    device: Device, carriers: Carriers, piece: I32, seams: Seams, depths: F64, colors: F32,
    up: F32, seed: int,
) -> _Fill:  # fmt: skip
    """Return the splats that fill all pieces, if these have come loose."""
    spacing = carriers.spacing
    places, normals = carriers.positions.astype(np.float64), carriers.normals.astype(np.float64)
    # broken faces
    layers = np.ceil(depths[seams.carriers] / (STEP * spacing)).astype(np.int64)
    number = np.repeat(np.arange(len(seams)), layers * BESIDE)
    starts = np.cumsum(layers * BESIDE) - layers * BESIDE
    place = np.arange(len(number)) - starts[number]
    layer, beside = place // BESIDE, place % BESIDE - 0.5 * (BESIDE - 1)
    at_seam = seams.carriers[number]
    down, face = normals[at_seam], seams.normals[number].astype(np.float64)
    aside = np.cross(face, down)
    part = (layer + 0.5 * (number % 2)) / np.maximum(layers[number] - 0.5, 1)
    depth = TOP * spacing + part * (depths[at_seam] - TOP * spacing)
    walls = seams.positions[number] - depth[:, None] * down
    walls += (beside * STEP * spacing)[:, None] * aside
    # backs and the ground coat
    solid = np.repeat(np.flatnonzero(depths > 0), len(FINE))
    first, second = _tangents(normals[solid])
    corner = np.tile(FINE, (len(solid) // len(FINE), 1)) * spacing
    spread = places[solid] + corner[:, :1] * first + corner[:, 1:] * second
    owner = np.concatenate([at_seam, solid, solid])
    faces = np.concatenate([face, -normals[solid], normals[solid]])
    down = normals[solid]
    at = np.concatenate(
        [walls, spread - depths[solid][:, None] * down, spread - COAT * spacing * down]
    )
    kind = np.repeat([0, 1, 2], [len(walls), len(solid), len(solid)])
    none = np.full(len(solid), -1)
    noise: F32 = device.empty(4 * len(owner), np.float32)
    device.run(draw, np.arange(4 * len(owner), dtype=np.int64), seed, noise)
    chance = 2 * noise.reshape(-1, 4).astype(np.float64) - 1
    rough = np.where(kind == 2, 0.0, 1.0)[:, None]
    at = at + ROUGH * spacing * rough * chance[:, :1] * faces
    tilted = faces + TILT * rough * chance[:, 1:]
    tilted /= np.linalg.norm(tilted, axis=1, keepdims=True)
    tone = colors[owner].astype(np.float64)
    grey = tone.mean(axis=1, keepdims=True)
    lit = 1 - SHADE * (0.5 - 0.5 * tilted @ up.astype(np.float64))
    broken = (GREY * grey + (1 - GREY) * tone) * DARK * (lit * (1 + GRAIN * chance[:, 0]))[:, None]
    tone = np.where(kind[:, None] == 2, tone, broken)
    scales = np.empty((len(owner), 3), np.float32)
    scales[:, :2] = (np.array([WIDE, BACK, BACK])[kind] * spacing)[:, None]
    scales[:, 2] = FLAT * spacing
    return _Fill(
        carriers=owner.astype(np.int64),
        seams=np.concatenate([number, none, none]).astype(np.int64),
        pieces=np.concatenate([np.full(len(walls), -1), none, piece[solid]]).astype(np.int64),
        positions=_f32(at),
        rotations=_facing(tilted),
        scales=scales,
        colors=_f32(np.clip(tone, 0, 1)),
    )


def _tangents(normals: F64) -> tuple[F64, F64]:
    """Return two unit vectors across each normal and each other, shape (n, 3)."""
    aside = np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(normals, aside)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(normals, first)


def _facing(axes: F64) -> F32:
    """Return unit quaternions that rotate z to these unit vectors, shape (n, 4)."""
    w = 1 + axes[:, 2]
    turn = np.stack([w, -axes[:, 1], axes[:, 0], np.zeros(len(axes))], axis=1)
    turn[w < 1e-6] = (0, 1, 0, 0)
    return _f32(turn / np.linalg.norm(turn, axis=1, keepdims=True))


def _f32(values: npt.NDArray[Any]) -> F32:
    return np.ascontiguousarray(values, np.float32)
