"""Place captures on a stage: the transformation of coordinates, and the prim path."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom

from usdsplat import formats, schema
from usdsplat.core import axes
from usdsplat.core.cloud import F64
from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.text import shown
from usdsplat.formats.sog.lod_meta import LOD_META
from usdsplat.formats.sog.meta import META
from usdsplat.interchange.models import FIELD
from usdsplat.schema.stage_values import ordered_ops, stage_unit, up_axis

_SUFFIX = "axes"
OP = f"xformOp:transform:{_SUFFIX}"
"""Transform op from a capture's axes and unit to the stage's."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Placement:
    """A transformation from a capture's coordinates to a stage's."""

    matrix: F64
    """Signed permutation times a scale, column vectors, shape (4, 4)."""
    text: str
    """Description for display."""

    @property
    def is_identity(self) -> bool:
        """Whether the transformation is the identity."""
        return np.array_equal(self.matrix, np.eye(4))


def placement(stage: Usd.Stage, frame: str, meters_per_unit: float | None) -> Placement:
    """Return the transformation from a capture's axes and unit to the stage's.

    Args:
        stage: Stage with up axis and unit.
        frame: Axes of the capture.
        meters_per_unit: Metres per unit of the capture; None is the stage's.

    Raises:
        UsageError: If `frame` is not a name of axes, or the unit is not positive.
    """
    target = stage_frame(stage)
    matrix = np.eye(4)
    matrix[:3, :3] = axes.change(frame, target)
    text = f"{frame} to {target}" if frame != target else f"{frame}, as the stage's"
    if meters_per_unit is not None:
        factor = checked_unit(meters_per_unit) / stage_unit(stage)
        if factor != 1:
            matrix[:3] *= factor
            text += f", {factor:g} times as large"
    return Placement(matrix=matrix, text=text)


def stage_frame(stage: Usd.Stage) -> str:
    """Return the axes of a stage."""
    return axes.UP_AXIS_FRAME[up_axis(stage)]


def checked_unit(meters_per_unit: float) -> float:
    """Return `meters_per_unit` if it is valid.

    Raises:
        UsageError: If it is not positive and finite.
    """
    if not 0 < meters_per_unit < np.inf:
        raise UsageError("meters_per_unit", f"{meters_per_unit:g}", "a positive number [m]")
    return meters_per_unit


def set_op(prim: Usd.Prim, matrix: F64 | None) -> None:
    """Author the matrix as the innermost transform op of a prim, replacing an older one.

    Other ops stay; None or the identity removes the op.
    """
    xformable = UsdGeom.Xformable(prim)
    others = [op for op in ordered_ops(prim) if op.GetOpName() != OP]
    if len(others) < len(ordered_ops(prim)):
        xformable.SetXformOpOrder(others, xformable.GetResetXformStack())
        prim.RemoveProperty(OP)
    if matrix is None or np.array_equal(matrix, np.eye(4)):
        return
    op = xformable.AddTransformOp(UsdGeom.XformOp.PrecisionDouble, _SUFFIX)
    op.Set(Gf.Matrix4d(matrix.T.tolist()))  # Gf uses row vectors


def from_capture(prim: Usd.Prim) -> Gf.Matrix4d:
    """Return the matrix of `set_op`, for row vectors; the identity without one, or with ops within
    it."""
    ops = ordered_ops(prim)
    if not ops or ops[-1].GetOpName() != OP:
        return Gf.Matrix4d(1)
    return Gf.Matrix4d(ops[-1].GetOpTransform(Usd.TimeCode.Default()))


def field_path(stage: Usd.Stage, source: Path, asked: str | None) -> Sdf.Path:
    """Return the path of a field: `asked`, or in a new model named like the file.

    The model is below the default prim, or at the root of a stage without one.

    Raises:
        UsageError: If `asked` is not the path of a prim.
        StageError: If a prim of another type is there.
    """
    if asked is None:
        parent = stage.GetDefaultPrim()
        if not parent or parent.IsA(UsdGeom.Boundable):  # which must not have others below it
            parent = stage.GetPseudoRoot()
        return _free(stage, parent.GetPath().AppendChild(prim_name(source))).AppendChild(FIELD)
    path = checked_path(asked)
    prim = stage.GetPrimAtPath(path)
    if prim and prim.GetTypeName() and not schema.is_splat_field(prim):
        raise StageError(asked, f"a {prim.GetTypeName()}", "no prim or a splat field")
    return path


def checked_path(text: str) -> Sdf.Path:
    """Parse the path of a prim.

    Raises:
        UsageError: If it is not the absolute path of a prim.
    """
    path = Sdf.Path(text) if Sdf.Path.IsValidPathString(text) else Sdf.Path()
    if not path.IsAbsolutePath() or not path.IsPrimPath():
        raise UsageError("prim_path", repr(text), "the path of a prim, such as /World/Tree")
    return path


def prim_name(source: Path) -> str:
    """Return a prim name for a file: without its suffix, `statue.compressed.ply` as `statue`."""
    name = source.parent.name if source.name in (META, LOD_META) else source.name
    fitting = (s for s in formats.suffixes_read() if name.lower().endswith(s))
    name = name[: len(name) - len(max(fitting, key=len, default=""))]
    return identifier(name) if name else "Splats"


def identifier(text: str) -> str:
    """Return a valid prim name: no accents, and a `_` before a leading digit.

    USD's own function would replace the digit by `_`: 0001 and 1001 would be equal.
    """
    letters = unicodedata.normalize("NFKD", shown(text))
    plain = "".join(letter for letter in letters if not unicodedata.combining(letter))
    return str(Tf.MakeValidIdentifier(f"_{plain}" if plain[:1].isdecimal() else plain))


def define_ancestors(stage: Usd.Stage, path: Sdf.Path) -> None:
    """Define Xforms for the missing ancestors of a path."""
    ancestors: Iterable[Sdf.Path] = path.GetParentPath().GetPrefixes()
    for ancestor in ancestors:
        prim = stage.GetPrimAtPath(ancestor)
        if not prim or not prim.IsDefined():
            UsdGeom.Xform.Define(stage, ancestor)


def set_default_prim(stage: Usd.Stage, path: Sdf.Path) -> None:
    """Set the root above `path` as default prim if there is none and the root layer is edited."""
    if not stage.HasDefaultPrim() and stage.GetEditTarget().GetLayer() == stage.GetRootLayer():
        stage.SetDefaultPrim(stage.GetPrimAtPath(path.GetPrefixes()[0]))


def _free(stage: Usd.Stage, path: Sdf.Path) -> Sdf.Path:
    """Return the path, with a number appended if a prim exists there."""
    free, number = path, 1
    while stage.GetPrimAtPath(free):
        free, number = path.ReplaceName(f"{path.name}_{number}"), number + 1
    return free
