"""How coordinates of a capture become those of a stage, and where on it the field goes."""

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

ROOT = "World"
"""Default prim where a stage has none."""
_SUFFIX = "axes"
OP = f"xformOp:transform:{_SUFFIX}"
"""The op that turns a capture's axes and unit into the stage's."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Placement:
    """A map from a capture's coordinates to a stage's."""

    matrix: F64
    """Signed permutation times a scale, column vectors, shape (4, 4)."""
    text: str
    """The same for people."""

    @property
    def is_identity(self) -> bool:
        """Whether there is nothing to do."""
        return np.array_equal(self.matrix, np.eye(4))


def placement(stage: Usd.Stage, frame: str, meters_per_unit: float | None) -> Placement:
    """From a capture's frame and unit to those of the stage.

    Args:
        stage: Says its up axis and unit.
        frame: Where the capture's x, y and z point.
        meters_per_unit: Of the capture; None takes the stage's.

    Raises:
        UsageError: If `frame` names no frame, or the unit is not positive.
    """
    target = stage_frame(stage)
    matrix = np.eye(4)
    matrix[:3, :3] = axes.change(frame, target)
    text = f"{frame} to {target}" if frame != target else f"{frame}, as the stage's"
    if meters_per_unit is not None:
        factor = checked_unit(meters_per_unit) / UsdGeom.GetStageMetersPerUnit(stage)
        if factor != 1:
            matrix[:3] *= factor
            text += f", {factor:g} times as large"
    return Placement(matrix=matrix, text=text)


def stage_frame(stage: Usd.Stage) -> str:
    """Where x, y and z of a stage point."""
    return axes.UP_AXIS_FRAME[str(UsdGeom.GetStageUpAxis(stage))]


def checked_unit(meters_per_unit: float) -> float:
    """The same number, if it can be one.

    Raises:
        UsageError: If it is not positive and finite.
    """
    if not 0 < meters_per_unit < np.inf:
        raise UsageError("meters_per_unit", f"{meters_per_unit:g}", "a positive number [m]")
    return meters_per_unit


def set_op(prim: Usd.Prim, matrix: F64 | None) -> None:
    """Make the matrix the first thing that happens to the prim's points, replacing an older one.

    Other ops stay; None, or the identity, takes the op away.
    """
    xformable = UsdGeom.Xformable(prim)
    others = [op for op in xformable.GetOrderedXformOps() if op.GetOpName() != OP]
    if len(others) < len(xformable.GetOrderedXformOps()):
        xformable.SetXformOpOrder(others, xformable.GetResetXformStack())
        prim.RemoveProperty(OP)
    if matrix is None or np.array_equal(matrix, np.eye(4)):
        return
    op = xformable.AddTransformOp(UsdGeom.XformOp.PrecisionDouble, _SUFFIX)
    op.Set(Gf.Matrix4d(matrix.T.tolist()))  # Gf's vectors are rows


def field_path(stage: Usd.Stage, source: Path, asked: str | None) -> Sdf.Path:
    """Where the field goes: where asked, else under the default prim, named as the file.

    Raises:
        UsageError: If `asked` is no path of a prim.
        StageError: If something that is no splat field is there.
    """
    if asked is None:
        root = stage.GetDefaultPrim()
        parent = root.GetPath() if root else Sdf.Path(f"/{ROOT}")
        return _free(stage, parent.AppendChild(prim_name(source)))
    path = checked_path(asked)
    prim = stage.GetPrimAtPath(path)
    if prim and prim.GetTypeName() and not schema.is_splat_field(prim):
        raise StageError(asked, f"a {prim.GetTypeName()}", "no prim or a splat field")
    return path


def checked_path(text: str) -> Sdf.Path:
    """The same as a path.

    Raises:
        UsageError: If it is not the absolute path of a prim.
    """
    path = Sdf.Path(text) if Sdf.Path.IsValidPathString(text) else Sdf.Path()
    if not path.IsAbsolutePath() or not path.IsPrimPath():
        raise UsageError("prim_path", repr(text), "the path of a prim, such as /World/Tree")
    return path


def prim_name(source: Path) -> str:
    """A prim's name from a file's: without its suffix, `statue.compressed.ply` as `statue`."""
    name = source.parent.name if source.name == "meta.json" else source.name
    fitting = (s for s in formats.suffixes_read() if name.lower().endswith(s))
    name = name[: len(name) - len(max(fitting, key=len, default=""))]
    return identifier(name) if name else "Splats"


def identifier(text: str) -> str:
    """A name for a prim: letters without accents; what starts with a digit keeps it behind a `_`.

    USD's own rule would put the `_` in the digit's place: 0001 and 1001 would be one name.
    """
    letters = unicodedata.normalize("NFKD", text)
    plain = "".join(letter for letter in letters if not unicodedata.combining(letter))
    return str(Tf.MakeValidIdentifier(f"_{plain}" if plain[:1].isdecimal() else plain))


def define_ancestors(stage: Usd.Stage, path: Sdf.Path) -> None:
    """Groups down to a prim that is to be; the first is the default prim where there is none."""
    ancestors: Iterable[Sdf.Path] = path.GetParentPath().GetPrefixes()
    for ancestor in ancestors:
        prim = stage.GetPrimAtPath(ancestor)
        if not prim or not prim.IsDefined():
            UsdGeom.Xform.Define(stage, ancestor)


def set_default_prim(stage: Usd.Stage, path: Sdf.Path) -> None:
    """Make the root above `path` the default prim, if there is none and the root layer is open."""
    if not stage.HasDefaultPrim() and stage.GetEditTarget().GetLayer() == stage.GetRootLayer():
        stage.SetDefaultPrim(stage.GetPrimAtPath(path.GetPrefixes()[0]))


def _free(stage: Usd.Stage, path: Sdf.Path) -> Sdf.Path:
    """The path, numbered if there is a prim already."""
    free, number = path, 1
    while stage.GetPrimAtPath(free):
        free, number = path.ReplaceName(f"{path.name}_{number}"), number + 1
    return free
