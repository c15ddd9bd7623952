"""Read BasisCurves as segments, at any time, in the simulation's space."""

from __future__ import annotations

import itertools

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat.core.cloud import F64
from usdsplat.core.errors import StageError
from usdsplat.schema.shapes import mesh_points
from usdsplat.schema.values import integers, value
from usdsplat.sim.specs import Surface
from usdsplat.sim.stage.spaces import Space, transform_points

PARTS = 8
"""Straight pieces of a cubic segment."""
_BASES: dict[str, tuple[int, F64]] = {
    "bezier": (3, np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]], float)),
    "bspline": (
        1,
        np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]], float) / 6,
    ),
    "catmullRom": (
        1,
        np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]], float) / 2,
    ),
}
"""Basis -> vertices from one segment to the next, and the factors of 1, t, t², t³ of its four
vertices."""


def read_curves(prim: Usd.Prim, time: Usd.TimeCode, space: Space) -> Surface:
    """Return the segments of curves as triangles without area.

    Args:
        prim: BasisCurves; widths are ignored.
        time: The time.
        space: The simulation's space.

    Raises:
        StageError: If it is not BasisCurves, has no segment, or an inconsistent number of vertices.
    """
    where = str(prim.GetPath())
    if not prim.IsA(UsdGeom.BasisCurves):
        kind = str(prim.GetTypeName()) or "no type"
        raise StageError(where, f"a prim of type {kind}", "BasisCurves")
    points = transform_points(space.from_prim(prim, time), mesh_points(prim, time))
    counts = integers(
        f"{where}.curveVertexCounts", value(prim.GetAttribute("curveVertexCounts"), time)
    )
    if (counts < 0).any() or counts.sum() != len(points):
        raise StageError(f"{where}.points", f"{len(points)} points", f"{counts.sum()}, as counted")
    kinds = [str(value(prim.GetAttribute(name), time)) for name in ("type", "basis", "wrap")]
    starts = np.concatenate([[0], np.cumsum(counts)])
    lines = [
        _line(where, points[first:end].astype(np.float64), *kinds)
        for first, end in itertools.pairwise(starts.tolist())
    ]
    lines = [line for line in lines if len(line) > 1]
    if not lines:
        raise StageError(where, "no segment of a curve", "at least one")
    ends = np.cumsum([len(line) for line in lines])
    first = np.setdiff1d(np.arange(ends[-1]), ends - 1).astype(np.int32)
    return Surface(
        points=np.concatenate(lines).astype(np.float32),
        triangles=np.stack([first, first + 1, first + 1], axis=1),
    )


def _line(where: str, vertices: F64, kind: str, basis: str, wrap: str) -> F64:
    """Return the points of one curve, in order, shape (n, 3)."""
    closes = wrap == "periodic"
    if kind == "linear":
        return np.concatenate([vertices, vertices[:1]]) if closes else vertices
    if kind != "cubic" or basis not in _BASES:
        raise StageError(where, f"curves of type {kind} and basis {basis}", "known ones")
    step, factors = _BASES[basis]
    if wrap == "pinned" and step == 1 and len(vertices) > 1:
        before = 2 * vertices[0] - vertices[1]
        after = 2 * vertices[-1] - vertices[-2]
        vertices = np.concatenate([[before], vertices, [after]])
    if closes:
        vertices = np.concatenate([vertices, vertices[: 4 - step]])
    count = (len(vertices) - 4) // step + 1 if len(vertices) >= 4 else 0
    t = np.arange(PARTS)[:, None] / PARTS
    powers = np.concatenate([t**k for k in range(4)], axis=1) @ factors
    pieces = [powers @ vertices[step * k : step * k + 4] for k in range(count)]
    if count:
        end = np.ones(4) @ factors
        pieces.append(end[None] @ vertices[step * (count - 1) : step * (count - 1) + 4])
    return np.concatenate(pieces) if pieces else vertices[:0]
