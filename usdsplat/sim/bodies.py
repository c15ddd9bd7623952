"""Pack affectors into the table that kernels read: the pose of each solid at both ends of a
substep."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F64
from usdsplat.kernels.sim import blend_solids as column
from usdsplat.kernels.sim.solids import BOX, MESH, PLANE, ROUND
from usdsplat.sim.fields import Field, Fields, FieldTable
from usdsplat.sim.specs import Affector, Solid

KINDS = {"sphere": ROUND, "capsule": ROUND, "box": BOX, "plane": PLANE, "mesh": MESH}
STICKS = 1e30
"""Friction coefficient that means no slip at all."""
THINNEST = 1e-6
"""Least thickness of a solid, as a fraction of its radius."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Bodies:
    """The solids of several affectors, in their order."""

    table: F64
    """One row for each solid, shape (k, COLUMNS)."""
    fields: FieldTable
    blend: float
    """Largest blend radius [unit]."""
    clearance: float
    """Largest clearance [sigma]."""
    size: float
    """Radius of the smallest solid, or a fraction of its thickness [unit]."""

    def __len__(self) -> int:
        return len(self.table)


@dataclass(frozen=True, slots=True, eq=False)
class _Shape:
    """A solid at one time, in the kernels' terms."""

    turn: F64
    place: F64
    sizes: tuple[float, float, float, float]
    low: F64
    high: F64
    thin: float


def friction_coefficient(friction: float) -> float:
    """Convert a friction parameter, 0 for sliding to 1 for sticking, to Coulomb's coefficient f /
    (1 - f)."""
    return min(friction / (1.0 - friction), STICKS) if friction < 1.0 else STICKS


def pack_bodies(
    fields: Fields, before: Sequence[Affector], after: Sequence[Affector], dt: float
) -> Bodies:
    """Pack affectors. Fields that none of them needs are dropped.

    Args:
        fields: Distance fields of the simulation.
        before, after: The same affectors at the start and the end of a substep.
        dt: Its duration [s]; inf where nothing moves.

    Raises:
        StageError, UsageError: As `bake_field`.
    """
    used: list[Field] = []
    rows = []
    for old, new in zip(before, after, strict=True):
        for was, now in zip(old.solids, new.solids, strict=True):
            rows.append(_row(fields, used, new, was, now, dt))
    table = np.array(rows).reshape(-1, column.COLUMNS)
    largest = table.max(axis=0, initial=0.0)
    thin = table[:, column.THIN].min(initial=1.0)
    return Bodies(
        table=table,
        fields=fields.table(used),
        blend=float(largest[column.BLEND]),
        clearance=float(largest[column.CLEARANCE]),
        size=float(2.0 * thin),
    )


def _row(
    fields: Fields, used: list[Field], affector: Affector, was: Solid, now: Solid, dt: float
) -> F64:
    knobs = affector.parameters
    row = np.zeros(column.COLUMNS)
    baked = [_field(fields, used, affector, solid) for solid in (was, now)]
    old, new = _shape(was, baked[0]), _shape(now, baked[1])
    row[column.KIND] = KINDS[now.kind]
    row[column.FIELD_BEFORE], row[column.FIELD] = (
        -1 if field is None else used.index(field) for field in baked
    )
    row[column.BLEND], row[column.CLEARANCE] = knobs.blend, knobs.clearance
    row[column.FRICTION] = friction_coefficient(knobs.friction)
    row[column.RESTITUTION] = knobs.restitution
    row[column.SWEPT] = knobs.ccd and now.kind != "plane"
    row[column.THIN] = new.thin
    row[column.RESHAPES] = old.sizes != new.sizes or baked[0] is not baked[1]
    row[column.SIZE : column.SIZE + 4] = new.sizes
    row[column.SIZE_BEFORE : column.SIZE_BEFORE + 4] = old.sizes
    row[column.LOW : column.LOW + 3] = new.low
    row[column.HIGH : column.HIGH + 3] = new.high
    if now.kind == "plane":
        row[column.BOUND] = math.inf
        centre = np.zeros(3)
    else:
        row[column.BOUND] = 0.5 * np.linalg.norm(new.high - new.low)
        centre = 0.5 * (new.low + new.high)
    row[column.CENTRE : column.CENTRE + 3] = new.turn @ centre + new.place
    row[column.TURN : column.TURN + 9] = new.turn.reshape(-1)
    row[column.PLACE : column.PLACE + 3] = new.place
    row[column.TURN_BEFORE : column.TURN_BEFORE + 9] = old.turn.reshape(-1)
    row[column.PLACE_BEFORE : column.PLACE_BEFORE + 3] = old.place
    back = old.turn @ new.turn.T
    row[column.SLIP : column.SLIP + 9] = ((np.eye(3) - back) / dt).reshape(-1)
    row[column.SHIFT : column.SHIFT + 3] = (back @ new.place - old.place) / dt
    return row


def _field(fields: Fields, used: list[Field], affector: Affector, solid: Solid) -> Field | None:
    if solid.surface is None:
        return None
    field = fields.of(solid.surface, affector.parameters.voxel_size, affector.path)
    if field not in used:
        used.append(field)
    return field


def _shape(solid: Solid, field: Field | None) -> _Shape:
    turn, place = solid.matrix[:3, :3], solid.matrix[:3, 3]
    sizes = (0.0, 0.0, 0.0, 0.0)
    if field is not None:
        return _Shape(turn, place, sizes, *field.box, field.voxel)
    if solid.kind == "plane":
        far = np.full(3, math.inf)
        return _Shape(turn, place, sizes, -far, np.array([math.inf, math.inf, 0.0]), math.inf)
    if solid.kind == "box":
        half = np.array(solid.size)
        thin = max(0.5 * half.min(), THINNEST * half.max(), 1e-12)
        return _Shape(turn, place, (*solid.size, 0.0), -half, half, thin)
    first, second, half_length = solid.size
    if solid.kind == "sphere":
        second, half_length = first, 0.0
    if 2.0 * half_length <= abs(first - second):
        # the larger ball contains the smaller
        end = -half_length if first > second else half_length
        place = place + turn @ np.array([0.0, 0.0, end])
        first = second = max(first, second)
        half_length = 0.0
    grow = (first - second) / (2.0 * half_length) if half_length > 0.0 else 0.0
    widest = max(first, second)
    return _Shape(
        turn,
        place,
        (0.5 * (first + second), grow, half_length, grow / math.sqrt(1.0 - grow * grow)),
        np.array([-widest, -widest, -half_length - first]),
        np.array([widest, widest, half_length + second]),
        max(0.5 * min(first, second), THINNEST * (widest + half_length), 1e-12),
    )
