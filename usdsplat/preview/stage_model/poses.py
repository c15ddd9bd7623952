"""Transforms of prims as translation, angles and factors, for fields that numbers are typed into.

A pose is that of a prim within its parent: it is sheared, scaled, turned about x, then y, then z,
and moved. Every matrix has one, also those of other transform ops; several have more than one, and
the nearest to a known pose is taken, so that the numbers of a field do not leap.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat.core.cloud import F64
from usdsplat.core.errors import StageError, UsageError
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.stage_model.placing import can_move, code_of, transform
from usdsplat.schema.stage_values import parent_to_world

Part = Literal["translate", "rotate", "scale"]
PARTS: tuple[Part, ...] = ("translate", "rotate", "scale")
VERBS: dict[Part, str] = {"translate": "Move", "rotate": "Turn", "scale": "Scale"}
"""What a change of a part does, for the name of its undo."""
_NOISE = 1e-12
"""Numbers are 0 below this fraction of those that they were computed from."""
_FLIP = 1e6
"""Cost of a scale of another sign, in squared degrees."""

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """A transform within the parent."""

    translate: Triple = (0.0, 0.0, 0.0)
    """[scene unit of the parent]"""
    rotate: Triple = (0.0, 0.0, 0.0)
    """Angles about x, y and z, in this order, as `xformOp:rotateXYZ` has them [degree]."""
    scale: Triple = (1.0, 1.0, 1.0)
    shear: Triple = (0.0, 0.0, 0.0)
    """Shear of y along x, of z along x, and of z along y, as fractions."""

    def with_number(self, part: Part, axis: int, value: float) -> Pose:
        """Return the pose with another number of a part."""
        numbers = list(getattr(self, part))
        numbers[axis] = value
        changes = {part: tuple(numbers)}
        return replace(self, **changes)


def matrix_of(pose: Pose) -> F64:
    """Return the matrix of a pose, for column vectors, shape (4, 4)."""
    xy, xz, yz = pose.shear
    shear = np.array([(1.0, xy, xz), (0.0, 1.0, yz), (0.0, 0.0, 1.0)])
    matrix = np.eye(4)
    matrix[:3, :3] = _turn(pose.rotate) @ np.diag(pose.scale) @ shear
    matrix[:3, 3] = pose.translate
    return matrix


def pose_of(matrix: F64, *, near: Pose | None = None) -> Pose:
    """Return the pose of a matrix.

    Args:
        matrix: For column vectors, shape (4, 4), finite.
        near: Pose that is wanted if there are several; None for no negative scales but those that
            are needed, and small angles.
    """
    turn, upper = np.linalg.qr(matrix[:3, :3])
    sizes = np.diag(upper).copy()
    shear = np.divide(upper, sizes[:, None], out=np.eye(3), where=sizes[:, None] != 0)
    known = near or Pose()
    found = []
    for signs in itertools.product((1.0, -1.0), repeat=3):
        turned, scale = turn * signs, sizes * signs
        if np.linalg.det(turned) > 0:
            flips = np.count_nonzero(scale * known.scale < 0)
            for angles in _angles(turned, known.rotate):
                away = float(np.sum(np.subtract(angles, known.rotate) ** 2))
                found.append((away + _FLIP * flips, angles, scale))
    _, angles, scale = min(found, key=lambda each: each[0])
    return Pose(
        translate=_clean(matrix[:3, 3], np.linalg.norm(matrix[:3, 3])),
        rotate=_clean(angles, 360.0),
        scale=_clean(scale, np.max(np.abs(scale))),
        shear=_clean(shear[(0, 0, 1), (1, 2, 2)], 1.0),
    )


def pose_at(
    stage: Usd.Stage, path: str, *, time: float | None = None, near: Pose | None = None
) -> Pose | None:
    """Return the translation, rotation and scale of a prim at a time. None if the prim cannot be
    moved or its transform is not finite.

    Raises:
        StageError: If USD does not know a transform op of the prim or of one above it.
    """
    prim = stage.GetPrimAtPath(path)
    if not can_move(prim):
        return None
    world, above = np.reshape(transform(stage, path, time=time), (4, 4)), _above(prim, time)
    if not np.isfinite([world, above]).all() or not np.linalg.det(above[:3, :3]):
        return None
    pose = pose_of(np.linalg.solve(above, world), near=near)
    places = np.linalg.solve(above[:3, :3], np.transpose([world[:3, 3], above[:3, 3]]))
    return replace(pose, translate=_clean(pose.translate, np.linalg.norm(places)))


def set_number(
    edits: Edits,
    path: str,
    part: Part,
    axis: int,
    value: float,
    *,
    time: float | None = None,
    near: Pose | None = None,
    merge: str | None = None,
) -> None:
    """Change one number of a prim's pose as the manipulator moves it, see `Edits.set_transform`.

    Args:
        edits: Edits of the stage.
        path: Path of the prim.
        part, axis: The number; axis 0 is x.
        value: The new number.
        time: Time at which the prim reaches the pose.
        near: As for `pose_of`: the pose that the user sees.
        merge: As for `Edits.step`.

    Raises:
        StageError: If the prim cannot be moved.
        UsageError: If no transform has this number.
    """
    name = f"{path} {part} {'XYZ'[axis]}"
    if not math.isfinite(value) or (part == "scale" and not value):
        expected = "a finite number" if part != "scale" else "a finite number other than 0"
        raise UsageError(name, f"{value:g}", expected)
    pose = pose_at(edits.stage, path, time=time, near=near)
    if pose is None:
        raise StageError(path, "a prim that cannot be moved", "one with a transform")
    world = _above(edits.stage.GetPrimAtPath(path), time) @ matrix_of(
        pose.with_number(part, axis, value)
    )
    placed = tuple(world.ravel().tolist())
    edits.set_transform(path, placed, time=time, merge=merge, verb=VERBS[part])


def _above(prim: Usd.Prim, time: float | None) -> F64:
    """Return the transform that acts on a prim's own, for column vectors, shape (4, 4)."""
    if UsdGeom.Xformable(prim).GetResetXformStack():
        return np.eye(4)
    return np.array(parent_to_world(prim, UsdGeom.XformCache(code_of(time)))).T


def _turn(rotate: Triple) -> F64:
    """Return the rotation by angles about x, then y, then z [degree], shape (3, 3)."""
    turn = np.eye(3)
    for axis, angle in enumerate(map(math.radians, rotate)):
        one, other = (axis + 1) % 3, (axis + 2) % 3
        each = np.eye(3)
        each[[one, other], [one, other]] = math.cos(angle)
        each[one, other], each[other, one] = -math.sin(angle), math.sin(angle)
        turn = each @ turn
    return turn


def _angles(turn: F64, near: Triple) -> tuple[Triple, ...]:
    """Return the angles of a rotation [degree], both solutions, each with the whole turns of known
    angles."""
    level = math.hypot(turn[0, 0], turn[1, 0])
    y = math.degrees(math.atan2(-turn[2, 0], level))
    if level > 1e-9:
        x = math.degrees(math.atan2(turn[2, 1], turn[2, 2]))
        z = math.degrees(math.atan2(turn[1, 0], turn[0, 0]))
    else:  # x and z turn about one axis: z is that of the known angles
        z, way = near[2], math.copysign(1.0, y)
        x = way * z + math.degrees(math.atan2(way * turn[0, 1], turn[1, 1]))
    return tuple(_near(angles, near) for angles in ((x, y, z), (x + 180.0, 180.0 - y, z + 180.0)))


def _near(angles: Triple, near: Triple) -> Triple:
    x, y, z = (
        angle + 360.0 * round((known - angle) / 360.0)
        for angle, known in zip(angles, near, strict=True)
    )
    return x, y, z


def _clean(numbers: F64 | Triple, size: float | np.floating) -> Triple:
    """Return numbers without what is left of the rounding of others of a size."""
    x, y, z = (0.0 if abs(each) <= _NOISE * size else float(each) for each in numbers)
    return x, y, z
