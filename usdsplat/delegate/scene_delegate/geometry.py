"""Read the triangles of a prim: the base class, and UsdGeom meshes.

A topology is refined once and kept while points change.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat.core.cloud import F32, I32
from usdsplat.core.errors import StageError, UsdSplatError
from usdsplat.core.surface.refine import Surface
from usdsplat.core.surface.topology import Topology
from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.scene_delegate.readings import Sources
from usdsplat.delegate.scene_delegate.skeletons import Skeletons
from usdsplat.schema.shapes import mesh_points, topology
from usdsplat.schema.skin import Skin
from usdsplat.schema.values import integers, value, vectors

SHAPE = DirtyBits.TOPOLOGY | DirtyBits.POINTS | DirtyBits.NORMALS | DirtyBits.DISPLAY_STYLE
"""Bits that triangles and normals depend on."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Context:
    """Parameters of reading: time, refinement level, skeletons and counters."""

    time: Usd.TimeCode
    levels: int
    skeletons: Skeletons
    pulls: Counter[str]


class Geometry(ABC):
    """The triangles of a prim, updated when it changes."""

    points: F32
    triangles: I32
    faces: I32
    normals: F32 | None = None

    def __init__(self, where: str) -> None:
        self.where = where
        self.problems: list[UsdSplatError] = []
        """Problems of parts that are not drawn, although the prim is."""

    @abstractmethod
    def update(self, prim: Usd.Prim, bits: DirtyBits, context: Context, sources: Sources) -> bool:
        """Read the data that `bits` marks; return whether the triangles differ from before.

        Raises:
            StageError: If the prim cannot be drawn.
        """

    @abstractmethod
    def corners(self, values: F32, interpolation: str, indices: I32 | None) -> F32:
        """Evaluate a primvar at triangle corners, shape (t, 3, k).

        Raises:
            StageError: If the number of values is wrong.
        """


class MeshGeometry(Geometry):
    """The triangles of a UsdGeom.Mesh."""

    def __init__(self, where: str) -> None:
        super().__init__(where)
        self._topology: Topology | None = None
        self._surface: Surface | None = None
        self._built: tuple[object, ...] = ()
        self._rest: F32 | None = None
        self._may_cut_otherwise = False
        self._count = 0
        self._skin: Skin | None = None

    def update(self, prim: Usd.Prim, bits: DirtyBits, context: Context, sources: Sources) -> bool:
        """Implement `Geometry.update`."""
        moved: F32 | None = None
        if bits & DirtyBits.TOPOLOGY or self._topology is None:
            context.pulls["topology"] += 1
            self._topology = topology(prim, context.time)
            self._surface = None
        if bits & (DirtyBits.POINTS | DirtyBits.TOPOLOGY | DirtyBits.DISPLAY_STYLE):
            context.pulls["points"] += 1
            self._skin = context.skeletons.skin(prim, sources)
            moved = self._read_points(prim, context.time)
        if self._count == 0:  # a mesh without points is valid and empty
            self._surface, self.normals = None, None
            self.points, self.triangles = np.empty((0, 3), np.float32), np.empty((0, 3), np.int32)
            return True
        rebuilt = self._build(context.levels)
        surface = self._surface
        assert surface is not None
        if moved is not None:
            self.points = surface.points(moved)
        self.triangles, self.faces = surface.triangles, surface.faces
        if rebuilt or bits & DirtyBits.NORMALS or moved is not None:
            self._update_normals(
                prim, surface, context, changed=rebuilt or bits & DirtyBits.NORMALS
            )
        return rebuilt

    def corners(self, values: F32, interpolation: str, indices: I32 | None) -> F32:
        """Implement `Geometry.corners`."""
        assert self._surface is not None
        return self._surface.corners(values, interpolation, indices)

    # --- private ---------------------------------------------------------------------------

    def _read_points(self, prim: Usd.Prim, time: Usd.TimeCode) -> F32:
        """Return the current points of the cage; store the rest points for triangulation."""
        where = f"{self.where}.points"
        attribute = prim.GetAttribute("points")
        points = mesh_points(prim, time)
        rest = vectors(where, value(attribute, Usd.TimeCode.Default()), 3)
        rest_or_none = rest if len(rest) == len(points) else None
        if not _same(rest_or_none, self._rest):
            self._rest = rest_or_none
            self._may_cut_otherwise = True
        self._count = len(points)
        return self._skin.points(points, time) if self._skin else points

    def _build(self, levels: int) -> bool:
        """Rebuild the surface if it has changed; return whether it was rebuilt."""
        topology = self._topology
        assert topology is not None
        rest = self._rest if topology.scheme == "none" else None
        levels = 0 if topology.scheme == "none" else levels
        before = self._surface if self._built == (self._count, levels) else None
        if before is not None and (rest is None or not self._may_cut_otherwise):
            return False
        surface = Surface(topology, points=self._count, levels=levels, rest=rest, where=self.where)
        self._may_cut_otherwise = False
        if before is not None and np.array_equal(before.triangles, surface.triangles):
            return False
        self._surface = surface
        self._built = (self._count, levels)
        return True

    def _update_normals(
        self, prim: Usd.Prim, surface: Surface, context: Context, *, changed: Any
    ) -> None:
        topology = self._topology
        assert topology is not None
        if topology.scheme != "none":  # authored normals apply to polygons only
            self.normals = surface.normals(self.points)
            return
        if changed or self._skin:
            self.problems = []
            try:
                self.normals = self._authored_normals(prim, topology, surface, context)
            except UsdSplatError as error:
                self.problems.append(error)
                self.normals = None

    def _authored_normals(
        self, prim: Usd.Prim, topology: Topology, surface: Surface, context: Context
    ) -> F32 | None:
        context.pulls["normals"] += 1
        values, interpolation, indices = _normals_of(prim, context.time)
        if values is None:
            return None
        where = f"{self.where}.normals"
        normals = vectors(where, values, 3)
        if self._skin:
            normals = (
                normals if indices is None else normals[checked_rows(where, indices, len(normals))]
            )
            at = _points_at(interpolation, topology, self._count)
            if at is None or len(at) != len(normals):
                return None
            normals, indices = self._skin.normals(normals, at, self._count, context.time), None
        corners = surface.corners(normals, interpolation, indices)
        return unit(corners, self.points[self.triangles])


def _normals_of(prim: Usd.Prim, time: Usd.TimeCode) -> tuple[Any, str, I32 | None]:
    """Return authored normals, interpolation and indices; the primvar takes precedence."""
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("normals")
    if primvar and primvar.HasAuthoredValue():
        indices = value(primvar.GetIndicesAttr(), time) if primvar.IsIndexed() else None
        checked = None if indices is None else integers(f"{prim.GetPath()}.normals", indices)
        return value(primvar.GetAttr(), time), str(primvar.GetInterpolation()), checked
    attribute = prim.GetAttribute("normals")
    interpolation = str(UsdGeom.PointBased(prim).GetNormalsInterpolation())
    return value(attribute, time), interpolation, None


def _points_at(interpolation: str, topology: Topology, count: int) -> I32 | None:
    """Return the point index of each normal; None if they are not at points."""
    if interpolation == UsdGeom.Tokens.faceVarying:
        return topology.indices
    at_points = interpolation in (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying)
    return np.arange(count, dtype=np.int32) if at_points else None


def checked_rows(where: str, indices: I32, count: int) -> I32:
    wrong = indices[(indices < 0) | (indices >= count)]
    if len(wrong):
        raise StageError(where, f"an index of {wrong[0]}", f"0 or more and less than {count}")
    return indices


def unit(normals: F32, triangles: F32 | None) -> F32:
    """Normalise; zero normals are replaced by those of their triangles."""
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    flat = length[..., 0] == 0
    if triangles is not None and flat.any():
        a, b, c = (triangles[:, i] for i in range(3))
        own = np.broadcast_to(np.cross(b - a, c - a)[:, None], normals.shape)
        normals = np.where(flat[..., None], own, normals)
        length = np.linalg.norm(normals, axis=-1, keepdims=True)
    return (normals / np.where(length > 0, length, 1)).astype(np.float32)


def _same(one: F32 | None, two: F32 | None) -> bool:
    if one is None or two is None:
        return one is two
    return np.array_equal(one, two)
