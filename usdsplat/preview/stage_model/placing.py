"""Read the transforms of prims, and move prims with one transform op.

A dragged prim gets the op `xformOp:transform:edit` as the first of its order, on top of its
existing ops. Those stay unchanged: animation continues from the new place, and removing the op
restores the old place. The op acts in the parent's space, as the edit operators of other packages
do. Later drags change the same op.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from pxr import Gf, Usd, UsdGeom

from usdsplat.core.errors import StageError, UsageError
from usdsplat.render.specs import Matrix
from usdsplat.schema.stage_values import local_to_world, ordered_ops, parent_to_world

EDIT = "xformOp:transform:edit"
_SUFFIX = "edit"
_SINGULAR = 1e-12
"""A matrix is singular if its determinant is at most this fraction of the product of its row
lengths."""


def transform(stage: Usd.Stage, path: str, *, time: float | None = None) -> Matrix:
    """Return a prim's local-to-world matrix: 16 numbers, row-major, for column vectors.

    Raises:
        StageError: If there is no such prim, or USD does not know one of its transform ops.
    """
    prim = stage.GetPrimAtPath(path)
    if not prim:
        raise StageError(path, "no prim", "a prim of the stage")
    matrix = local_to_world(prim, UsdGeom.XformCache(code_of(time)))
    return tuple(np.array(matrix).T.ravel().tolist())


def can_move(prim: Usd.Prim) -> bool:
    """Return whether a prim has a transform of its own that edits can change."""
    return bool(prim) and not prim.IsInstanceProxy() and prim.HasAttribute("xformOpOrder")


def edit_of(prim: Usd.Prim, matrix: Matrix, code: Usd.TimeCode) -> Gf.Matrix4d:
    """Return the op's value that moves a prim to a matrix.

    Args:
        prim: The prim, an `Xformable`.
        matrix: Local to world, as `transform` gives it.
        code: Time at which the prim reaches the matrix.

    Raises:
        StageError: If no op can, because the prim or its parent has a singular transform.
        UsageError: If the matrix has no inverse.
    """
    where = str(prim.GetPath())
    asked = _checked(where, matrix)
    xformable = UsdGeom.Xformable(prim)
    others = _product(ops_below(xformable), code)
    above = Gf.Matrix4d(1.0)
    if not xformable.GetResetXformStack():
        above = parent_to_world(prim, UsdGeom.XformCache(code))
    return _inverse(where, others) * asked * _inverse(where, above)


def ops_below(xformable: UsdGeom.Xformable) -> list[UsdGeom.XformOp]:
    """Return the prim's ops without the edit op."""
    ops = ordered_ops(xformable.GetPrim())
    return ops[1:] if ops and ops[0].GetOpName() == EDIT else ops


def author_edit(prim: Usd.Prim) -> Usd.Attribute:
    """Return the edit op's attribute, made the first op on the edit target.

    Raises:
        StageError: If the prim has an op of that name in another place.
    """
    xformable = UsdGeom.Xformable(prim)
    ops = ordered_ops(xformable.GetPrim())
    others = ops_below(xformable)
    if any(op.GetOpName() == EDIT for op in others):
        raise StageError(f"{prim.GetPath()}.xformOpOrder", f"{EDIT} within", f"{EDIT} first")
    if len(others) < len(ops):
        return ops[0].GetAttr()
    op = xformable.AddTransformOp(UsdGeom.XformOp.PrecisionDouble, _SUFFIX)
    xformable.SetXformOpOrder([op, *others], xformable.GetResetXformStack())
    return op.GetAttr()


def code_of(time: float | None) -> Usd.TimeCode:
    """Return a `Usd.TimeCode`; None is the default time."""
    return Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)


def _product(ops: Iterable[UsdGeom.XformOp], code: Usd.TimeCode) -> Gf.Matrix4d:
    """Return the product of ops. Gf vectors are rows, so the first op acts last."""
    result = Gf.Matrix4d(1.0)
    for op in ops:
        result = op.GetOpTransform(code) * result
    return result


def _inverse(where: str, matrix: Gf.Matrix4d) -> Gf.Matrix4d:
    array = np.array(matrix)
    if not np.isfinite(array).all() or _is_singular(array):
        raise StageError(where, "a transform without an inverse", "an invertible transform")
    return matrix.GetInverse()


def _checked(where: str, matrix: Matrix) -> Gf.Matrix4d:
    """Return the 16 numbers as a Gf matrix, checked."""
    is_matrix = len(matrix) == 16 and all(math.isfinite(number) for number in matrix)
    array = np.reshape(matrix, (4, 4)) if is_matrix else np.zeros((4, 4))
    if not is_matrix or tuple(array[3]) != (0.0, 0.0, 0.0, 1.0) or _is_singular(array):
        expected = "16 finite numbers of an invertible transform"
        raise UsageError(where, "an invalid transform matrix", expected)
    return Gf.Matrix4d(array.T.tolist())


def _is_singular(array: np.ndarray) -> bool:
    linear = array[:3, :3]
    lengths = np.linalg.norm(linear, axis=1)
    return bool(abs(np.linalg.det(linear)) <= _SINGULAR * lengths.prod())
