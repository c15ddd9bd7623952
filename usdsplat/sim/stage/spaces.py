"""Where prims are: matrices for column vectors, float64, shape (4, 4)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat.core.cloud import F32, F64
from usdsplat.core.errors import StageError

UNIFORM = 1e-4
"""Relative spread of stretches up to which a scale counts as uniform: that of files in single
precision, and no more than anybody sees."""


def to_world(prim: Usd.Prim, time: Usd.TimeCode) -> F64:
    """A prim's local-to-world transform."""
    return np.array(UsdGeom.XformCache(time).GetLocalToWorldTransform(prim), np.float64).T


def placing_times(prims: Iterable[Usd.Prim]) -> list[float]:
    """Time codes at which a transform of these prims, or of one above them, has a sample or, where
    it is a spline, a knot."""
    times: set[float] = set()
    for prim in prims:
        while prim and not prim.IsPseudoRoot():
            if xformable := UsdGeom.Xformable(prim):
                times.update(xformable.GetTimeSamples())
                for attribute in (op.GetAttr() for op in xformable.GetOrderedXformOps()):
                    if attribute.HasSpline():
                        times.update(attribute.GetSpline().GetKnots().keys())
            prim = prim.GetParent()
    return sorted(times)


class Space:
    """The simulation's space: the field's own, or the stage's as the field sees it at the start."""

    def __init__(
        self, field: Usd.Prim, kind: Literal["local", "world"], start: Usd.TimeCode
    ) -> None:
        self.field, self.kind, self.start = field, kind, start

    def to_world(self, time: Usd.TimeCode) -> F64:
        """From the simulation's space to the stage's."""
        return to_world(self.field, self.start if self.kind == "world" else time)

    def from_prim(self, prim: Usd.Prim, time: Usd.TimeCode) -> F64:
        """From a prim's space to the simulation's.

        Raises:
            StageError: If the field is squashed flat there, or one of both is nowhere.
        """
        ours, theirs = self.to_world(time), to_world(prim, time)
        for one, matrix in ((self.field, ours), (prim, theirs)):
            if not np.isfinite(matrix).all():
                where = f"{one.GetPath()} at {time}"
                raise StageError(where, "a transform that is not finite", "a finite one")
        if not abs(np.linalg.det(ours[:3, :3])) > 0:
            where = f"{self.field.GetPath()} at {time}"
            raise StageError(where, "a transform that cannot be undone", "one without a scale of 0")
        if np.array_equal(ours, theirs):
            return np.eye(4)  # to the bit: nothing is to be carried
        return np.asarray(np.linalg.solve(ours, theirs))

    def times(self, prim: Usd.Prim) -> list[float]:
        """When the prim's place in it may turn: samples of its transform, and of the field's."""
        return placing_times([prim, self.field] if self.kind == "local" else [prim])


def carry(matrix: F64, points: F32) -> F32:
    """Points, shape (n, 3), through a matrix."""
    return (points @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32)


def parts(matrix: F64) -> tuple[F64, F64]:
    """A rotation and what is left: `linear = rotation @ stretch`, both (3, 3).

    The stretch is symmetric, but for a mirroring of x in front of it where the matrix mirrors.
    """
    left, sizes, right = np.linalg.svd(matrix[:3, :3])
    rotation, stretch = left @ right, right.T @ np.diag(sizes) @ right
    if np.linalg.det(rotation) < 0:
        flip = np.diag([-1.0, 1.0, 1.0])
        rotation, stretch = rotation @ flip, flip @ stretch
    return rotation, stretch


def is_uniform(matrix: F64) -> bool:
    """Whether a matrix scales by as much in all directions, mirroring or not."""
    sizes = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    return bool(sizes[0] - sizes[2] <= UNIFORM * sizes[0])


def size_of(matrix: F64) -> float:
    """By how much a matrix scales lengths: the cube root of what it does to volumes."""
    return float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))


def placed(rotation: F64, at: F64) -> F64:
    """A rotation, (3, 3), and then a move, (3,)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, at
    return matrix
