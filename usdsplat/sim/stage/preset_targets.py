"""Place the target of a preset: a mesh or a capture from another file, where the capture is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

from usdsplat import schema
from usdsplat.core.cloud import F64
from usdsplat.core.errors import StageError
from usdsplat.core.readable import check_referable
from usdsplat.schema.stage_values import up_axis
from usdsplat.sim.parameters import SimParameters
from usdsplat.sim.stage import spaces
from usdsplat.sim.stage.skeletons import Rigs
from usdsplat.sim.stage.targets import SHAPES, Triangles
from usdsplat.sim.stage.trees import is_simulated, simulated_cut

GUIDE = UsdGeom.Tokens.guide
LARGER = 1.5
"""Size of meshes relative to the capture's: figures are more slender than most captures."""
LEAST, MOST = 5, 95
"""Percentiles at the ends of the box of a capture."""


def author_target(
    stage: Usd.Stage, path: Sdf.Path, target: Usd.Stage, low: F64, high: F64, *, time: float
) -> Usd.Prim:
    """Reference the content of another file so that it stands where a box stands, as large as it.

    It is a guide, which pictures do not show.

    Args:
        stage: Stage to author on.
        path: Path of the new prim.
        target: A stage from a file.
        low, high: Corners of the box in the space of the new prim's parent [unit].
        time: Time at which the target is measured [time code].

    Returns:
        The prim to conform to: the splat field, or a group with all meshes.

    Raises:
        StageError: If the target has neither a mesh nor exactly one splat field or tree, or has no
            size.
    """
    where = target.GetRootLayer().identifier
    file = Path(target.GetRootLayer().realPath)
    check_referable(file)
    root = target.GetDefaultPrim() or next(iter(target.GetPseudoRoot().GetChildren()), None)
    if not root:
        raise StageError(where, "no prims", "a mesh or a splat field")
    every = list(Usd.PrimRange(root, Usd.TraverseInstanceProxies()))
    fields = [prim for prim in every if is_simulated(prim)]
    meshes = [prim for prim in every if prim.IsA(UsdGeom.Mesh) or prim.GetTypeName() in SHAPES]
    if len(fields) > 1 or not (fields or meshes):
        found = f"{len(fields)} splat fields and {len(meshes)} meshes"
        raise StageError(where, found, "meshes, or one splat field")
    code = Usd.TimeCode(time)
    box = _field_box(fields[0], code) if fields else _mesh_box(meshes, code)
    holder = UsdGeom.Xform.Define(stage, path)
    holder.CreatePurposeAttr(GUIDE)
    _stand(
        holder, box, (low, high), up_axis(target), up_axis(stage), where,
        larger=1.0 if fields else LARGER,
    )  # fmt: skip
    child = stage.DefinePrim(path.AppendChild("Content"))
    child.GetReferences().AddReference(str(file), root.GetPath())
    if not fields:
        return child
    return stage.GetPrimAtPath(fields[0].GetPath().ReplacePrefix(root.GetPath(), child.GetPath()))


def _stand(
    holder: UsdGeom.Xform,
    box: tuple[F64, F64],
    there: tuple[F64, F64],
    up: str,
    stage_up: str,
    where: str,
    *,
    larger: float,
) -> None:
    """Author the transform that puts a box onto the bottom of another one, `larger` than it."""
    turn = np.eye(3)
    if up != stage_up:  # x stays, and the other two axes change places
        turn = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], float)
        turn = turn if up == "Z" else turn.T
    corners = np.array([turn @ corner for corner in box])
    low, high = corners.min(axis=0), corners.max(axis=0)
    size = float((high - low).max())
    if not (np.isfinite(size) and size > 0):
        raise StageError(where, "a target without a size", "a mesh or capture with a size")
    scale = larger * float((there[1] - there[0]).max()) / size
    foot, base = (low + high) / 2, (there[0] + there[1]) / 2
    axis = "XYZ".index(stage_up)
    foot[axis], base[axis] = low[axis], there[0][axis]
    matrix = np.eye(4)
    matrix[:3, :3] = (scale * turn).T
    matrix[3, :3] = base - scale * foot
    holder.AddTransformOp().Set(Gf.Matrix4d(matrix.tolist()))


def _field_box(prim: Usd.Prim, code: Usd.TimeCode) -> tuple[F64, F64]:
    is_tree = schema.is_tree(prim)
    cloud = simulated_cut(prim, SimParameters()).cloud() if is_tree else schema.fetch(prim, code)
    points = spaces.transform_points(spaces.to_world(prim, code), cloud.positions)
    points = points[np.isfinite(points).all(axis=1)].astype(np.float64)
    if not len(points):
        raise StageError(str(prim.GetPath()), "no splats", "at least one splat")
    low, high = np.percentile(points, (LEAST, MOST), axis=0)
    return low, high


def _mesh_box(meshes: list[Usd.Prim], code: Usd.TimeCode) -> tuple[F64, F64]:
    rigs, found = Rigs(), []
    for prim in meshes:
        part = Triangles(prim, rigs)
        points, _ = part.at(code)
        found.append(spaces.transform_points(spaces.to_world(part.placer, code), points))
    points = np.concatenate(found).astype(np.float64)
    return points.min(axis=0), points.max(axis=0)
