"""Transforms of prims: matrices for column vectors, float64, shape (4, 4)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat.core.cloud import F32, F64
from usdsplat.core.errors import StageError
from usdsplat.schema.stage_values import local_to_world, ordered_ops

UNIFORM = 1e-4
"""Relative spread of stretches up to which a scale counts as uniform: above the rounding of single
precision, and too small to be visible."""


def to_world(prim: Usd.Prim, time: Usd.TimeCode) -> F64:
    """Return a prim's local-to-world transform.

    Raises:
        StageError: If it has a transform op that USD does not know.
    """
    return np.array(local_to_world(prim, UsdGeom.XformCache(time)), np.float64).T


def placing_times(prims: Iterable[Usd.Prim]) -> list[float]:
    """Return the time codes at which the transforms of these prims or their ancestors have a sample
    or a spline knot."""
    times: set[float] = set()
    for prim in prims:
        while prim and not prim.IsPseudoRoot():
            if xformable := UsdGeom.Xformable(prim):
                ops = ordered_ops(prim)  # raises an error for ops that USD does not know
                times.update(xformable.GetTimeSamples())
                for attribute in (op.GetAttr() for op in ops):
                    if attribute.HasSpline():
                        times.update(attribute.GetSpline().GetKnots().keys())
            prim = prim.GetParent()
    return sorted(times)


class Space:
    """The simulation's space: the field's own, or the stage's as seen from the field at the
    start."""

    def __init__(
        self, field: Usd.Prim, kind: Literal["local", "world"], start: Usd.TimeCode
    ) -> None:
        self.field, self.kind, self.start = field, kind, start

    def to_world(self, time: Usd.TimeCode) -> F64:
        """Return the matrix from the simulation's space to the stage's."""
        return to_world(self.field, self.start if self.kind == "world" else time)

    def from_prim(self, prim: Usd.Prim, time: Usd.TimeCode) -> F64:
        """Return the matrix from a prim's space to the simulation's.

        Raises:
            StageError: If the field's transform is singular, or either is not finite.
        """
        ours, theirs = self.to_world(time), to_world(prim, time)
        for one, matrix in ((self.field, ours), (prim, theirs)):
            if not np.isfinite(matrix).all():
                where = f"{one.GetPath()} at {time}"
                raise StageError(where, "a transform that is not finite", "a finite one")
        if not abs(np.linalg.det(ours[:3, :3])) > 0:
            where = f"{self.field.GetPath()} at {time}"
            raise StageError(where, "a singular transform", "an invertible one")
        if np.array_equal(ours, theirs):
            return np.eye(4)  # exactly the identity, so that nothing is transformed
        return np.asarray(np.linalg.solve(ours, theirs))

    def times(self, prim: Usd.Prim) -> list[float]:
        """Return the times at which the prim's placement in the space may change: samples of its
        transform and of the field's."""
        return placing_times([prim, self.field] if self.kind == "local" else [prim])


def transform_points(matrix: F64, points: F32) -> F32:
    """Transform points, shape (n, 3), by a matrix."""
    return (points @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32)


def rotation_and_stretch(matrix: F64) -> tuple[F64, F64]:
    """Split a matrix into rotation and stretch: `linear = rotation @ stretch`, both (3, 3).

    The stretch is symmetric, multiplied by a reflection of x if the matrix mirrors.
    """
    left, sizes, right = np.linalg.svd(matrix[:3, :3])
    rotation, stretch = left @ right, right.T @ np.diag(sizes) @ right
    if np.linalg.det(rotation) < 0:
        flip = np.diag([-1.0, 1.0, 1.0])
        rotation, stretch = rotation @ flip, flip @ stretch
    return rotation, stretch


def is_uniform(matrix: F64) -> bool:
    """Return whether a matrix scales equally in all directions, mirrored or not."""
    sizes = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    return bool(sizes[0] - sizes[2] <= UNIFORM * sizes[0])


def size_of(matrix: F64) -> float:
    """Return the mean factor by which a matrix scales lengths: the cube root of the magnitude of
    its determinant."""
    return float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))


def up_in(matrix: F64, axis: str) -> tuple[float, float, float]:
    """Return the unit vector that a matrix maps to the direction of the stage's up axis."""
    up = np.zeros(3)
    up["XYZ".index(axis)] = 1.0
    x, y, z = np.linalg.lstsq(matrix[:3, :3], up, rcond=None)[0].tolist()
    length = math.sqrt(x * x + y * y + z * z) or 1.0
    return x / length, y / length, z / length


def rigid(rotation: F64, at: F64) -> F64:
    """Return the matrix of a rotation, (3, 3), followed by a translation, (3,)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, at
    return matrix
