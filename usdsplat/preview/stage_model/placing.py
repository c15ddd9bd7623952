"""Where prims are, and the one transform op that moves them by hand.

What a user drags gets the op `xformOp:transform:edit`, the first of its order, on top of whatever
ops it has: those stay as they are, so that what is animated goes on moving, from where it was put,
and what was dragged goes back where it came from when the op goes. It acts in the space of the
parent, as the edit operators of other packages do. Later drags change the same op.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from pxr import Gf, Usd, UsdGeom

from usdsplat.core.errors import StageError, UsageError
from usdsplat.render.specs import Matrix

EDIT = "xformOp:transform:edit"
_SUFFIX = "edit"
_SINGULAR = 1e-12
"""A determinant this small, as a part of what its rows' lengths allow, has no inverse."""


def transform(stage: Usd.Stage, path: str, *, time: float | None = None) -> Matrix:
    """Where a prim is: local to world, 16 numbers, row-major, for column vectors.

    Raises:
        StageError: If there is no such prim.
    """
    prim = stage.GetPrimAtPath(path)
    if not prim:
        raise StageError(path, "no prim", "a prim of the stage")
    matrix = UsdGeom.XformCache(code_of(time)).GetLocalToWorldTransform(prim)
    return tuple(np.array(matrix).T.ravel().tolist())


def edit_of(prim: Usd.Prim, matrix: Matrix, code: Usd.TimeCode) -> Gf.Matrix4d:
    """The value of the op that puts a prim somewhere.

    Args:
        prim: One that can be moved.
        matrix: Local to world, as `transform` gives it.
        code: When it is to be there.

    Raises:
        StageError: If no op could put it there, because it has no size, or its parent.
        UsageError: If the matrix is none that can be undone.
    """
    where = str(prim.GetPath())
    asked = _checked(where, matrix)
    xformable = UsdGeom.Xformable(prim)
    others = _product(ops_below(xformable), code)
    above = Gf.Matrix4d(1.0)
    if not xformable.GetResetXformStack():
        above = UsdGeom.XformCache(code).GetParentToWorldTransform(prim)
    return _inverse(where, others) * asked * _inverse(where, above)


def ops_below(xformable: UsdGeom.Xformable) -> list[UsdGeom.XformOp]:
    """The ops of a prim but the first, if that is the one of edits."""
    ops = xformable.GetOrderedXformOps()
    return ops[1:] if ops and ops[0].GetOpName() == EDIT else ops


def author_edit(prim: Usd.Prim) -> Usd.Attribute:
    """The op of edits, made the first of its prim's on the edit target.

    Raises:
        StageError: If the prim has an op of that name in another place.
    """
    xformable = UsdGeom.Xformable(prim)
    ops = xformable.GetOrderedXformOps()
    others = ops_below(xformable)
    if any(op.GetOpName() == EDIT for op in others):
        raise StageError(f"{prim.GetPath()}.xformOpOrder", f"{EDIT} within", f"{EDIT} first")
    if len(others) < len(ops):
        return ops[0].GetAttr()
    op = xformable.AddTransformOp(UsdGeom.XformOp.PrecisionDouble, _SUFFIX)
    xformable.SetXformOpOrder([op, *others], xformable.GetResetXformStack())
    return op.GetAttr()


def code_of(time: float | None) -> Usd.TimeCode:
    """A time code of USD's; None is the default time."""
    return Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)


def _product(ops: Iterable[UsdGeom.XformOp], code: Usd.TimeCode) -> Gf.Matrix4d:
    """What ops do together; Gf's vectors are rows, and the first op acts last."""
    result = Gf.Matrix4d(1.0)
    for op in ops:
        result = op.GetOpTransform(code) * result
    return result


def _inverse(where: str, matrix: Gf.Matrix4d) -> Gf.Matrix4d:
    array = np.array(matrix)
    if not np.isfinite(array).all() or _is_singular(array):
        raise StageError(where, "a transform without an inverse", "one that can be undone")
    return matrix.GetInverse()


def _checked(where: str, matrix: Matrix) -> Gf.Matrix4d:
    """The 16 numbers as Gf has them."""
    is_matrix = len(matrix) == 16 and all(math.isfinite(number) for number in matrix)
    array = np.reshape(matrix, (4, 4)) if is_matrix else np.zeros((4, 4))
    if not is_matrix or tuple(array[3]) != (0.0, 0.0, 0.0, 1.0) or _is_singular(array):
        expected = "16 finite numbers of a transform that can be undone"
        raise UsageError(where, "a matrix that is none of a place", expected)
    return Gf.Matrix4d(array.T.tolist())


def _is_singular(array: np.ndarray) -> bool:
    linear = array[:3, :3]
    lengths = np.linalg.norm(linear, axis=1)
    return bool(abs(np.linalg.det(linear)) <= _SINGULAR * lengths.prod())
