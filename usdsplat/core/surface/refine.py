"""Convert a mesh to triangles: refine a subdivision surface, then triangulate."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, F64, I32, I64
from usdsplat.core.errors import StageError
from usdsplat.core.surface import masks
from usdsplat.core.surface.face_varying import cut, hard, split, weld
from usdsplat.core.surface.level import (
    INFINITE,
    Bools,
    Level,
    coarsest,
    edge_numbers,
    open_edges,
    quad_corners,
    quads,
    sharpen,
    sizes,
    triangle_corners,
    triangles,
)
from usdsplat.core.surface.stencil import Step, refine
from usdsplat.core.surface.topology import Polygons, Topology, check, creases
from usdsplat.core.surface.triangulate import triangulate

Values = npt.NDArray[Any]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Refined:
    """A refinement: the steps for values, and the value index at each final corner."""

    steps: tuple[Step, ...]
    corners: I64


class Surface:
    """A triangulated topology that evaluates points and primvars at triangle corners.

    The topology is processed once; points and values may change any number of times. Catmull-Clark
    and Loop surfaces are refined uniformly, as in OpenSubdiv, bilinear ones without smoothing. With
    `levels` 0 the result is the cage. A quad is split from its first corner to its third.

    Args:
        topology: Faces and their subdivision scheme.
        points: Number of points.
        levels: Number of refinements; each replaces a face by four.
        rest: Points, shape (points, 3), used to triangulate concave polygons of a mesh that is not
            a subdivision surface; without them all polygons are assumed convex. The triangulation
            stays the same when points move.
        where: Name of the prim in error messages.

    Raises:
        StageError: If the topology is inconsistent.
    """

    triangles: I32
    """Rows of refined points, counter-clockwise from outside, shape (t, 3)."""
    faces: I32
    """Authored face of each triangle, shape (t,)."""

    def __init__(
        self,
        topology: Topology,
        *,
        points: int,
        levels: int = 2,
        rest: F32 | None = None,
        where: str = "mesh",
    ) -> None:
        self._where, self._topology, self._points = where, topology, points
        self._polygons = check(topology, points, where)
        self._smooth = topology.scheme != "none"
        self._levels = levels if self._smooth else 0

        shape = None
        if rest is not None and self._levels == 0:
            shape = np.asarray(self._rows(rest, points, "rest points"), np.float64)
        self._counts, ancestors = self._pieces()
        cuts, owner = triangulate(self._counts, self._vertex.corners, shape)
        polygon = ancestors[owner]
        drawn = self._drawn()
        if not drawn.all():
            cuts, polygon = cuts[drawn[polygon]], polygon[drawn[polygon]]
        self._corners = cuts[:, [0, 2, 1]] if topology.left_handed else cuts
        self.triangles = np.take(self._vertex.corners, self._corners).astype(np.int32)
        self.faces = self._polygons.faces[polygon].astype(np.int32)

    def points(self, points: F32) -> F32:
        """Return refined points, shape (p, 3), of points of shape (n, 3).

        The first n of them are the refined positions of the given points."""
        return refine(self._vertex.steps, self._rows(points, self._points, "points"))

    def normals(self, points: F32) -> F32 | None:
        """Return unit normals at triangle corners, shape (t, 3, 3), of refined points, or None.

        Normals are area-weighted means of the faces around. They differ across infinitely sharp
        edges, with the bilinear scheme across all edges of the cage. The result is None for a mesh
        that is not a subdivision surface: its triangles have face normals.
        """
        if not self._smooth:
            return None
        numbers = self._sides
        shapes = np.asarray(points, np.float32)
        with np.errstate(over="ignore", invalid="ignore"):
            normals = _corner_normals(self._counts, self._vertex.corners, numbers, shapes)
        if self._topology.left_handed:
            normals = -normals
        return np.take(normals, numbers[self._corners], axis=0)

    def corners(self, values: Values, interpolation: str, indices: I32 | None = None) -> F32:
        """Evaluate a primvar at triangle corners, shape (t, 3, k).

        Face-varying values of a subdivision surface are smooth inside connected regions and follow
        the topology's rule at their borders. Without indices, equal values at a vertex are one
        value.

        Args:
            values: Shape (n,) or (n, k).
            interpolation: A UsdGeom token.
            indices: Row of `values` of each element, or None when they are in order.

        Raises:
            StageError: If the number of values is wrong, or the interpolation is unknown.
        """
        values = np.asarray(values, np.float32)
        values = values.reshape(len(values), math.prod(values.shape[1:]))
        order = None if indices is None else np.asarray(indices, np.int64)
        if order is not None:
            outside = (order < 0) | (order >= len(values))
            if outside.any():
                raise StageError(
                    self._where,
                    f"primvar index {order[outside][0]}",
                    f"0 or more and less than {len(values)}",
                )
        if interpolation == "faceVarying":
            return self._face_varying(values, order)
        values = values if order is None else values[order]
        if interpolation == "constant":
            row = self._rows(values, 1, "constant values")[0]
            return np.tile(row, (len(self.triangles), 3, 1))
        if interpolation == "uniform":
            rows = self._rows(values, len(self._topology.counts), "uniform values")
            return np.repeat(rows[self.faces][:, None], 3, axis=1)
        if interpolation == "vertex":
            rows = self._rows(values, self._points, "vertex values")
            return np.take(refine(self._vertex.steps, rows), self.triangles, axis=0)
        if interpolation == "varying":
            rows = self._rows(values, self._points, "varying values")
            return np.take(refine(self._linear.steps, rows), self.triangles, axis=0)
        raise StageError(
            self._where,
            f"interpolation {interpolation!r}",
            "constant, uniform, varying, vertex or faceVarying",
        )

    # --- private ---------------------------------------------------------------------------

    @cached_property
    def _cage(self) -> Level:
        """The coarsest level of a subdivision surface."""
        return _sharpened(self._topology, self._polygons, self._points)

    @cached_property
    def _vertex(self) -> _Refined:
        """Refinement of points."""
        if self._levels == 0:
            return _Refined(steps=(), corners=self._polygons.indices)
        return self._refine(self._cage)

    @cached_property
    def _linear(self) -> _Refined:
        """Refinement of values that are interpolated linearly."""
        return self._vertex if self._levels == 0 else self._refine(hard(self._cage))

    @cached_property
    def _sides(self) -> I64:
        """Number of the normal at each final corner: differs across permanently sharp edges."""
        stays = (self._cage.edge_sharpness >= INFINITE) & ~open_edges(self._cage)
        if not stays.any():
            return self._vertex.corners
        return self._finest(cut(self._cage, split(self._cage), "none")[0])

    def _face_varying(self, values: F32, indices: I64 | None) -> F32:
        authored = len(self._topology.indices)
        if indices is None:
            self._rows(values, authored, "face-varying values")
            at_corners = values[self._polygons.corners]
        else:
            self._rows(indices, authored, "face-varying indices")
            at_corners = values[indices[self._polygons.corners]]
        if self._levels == 0:
            return np.take(at_corners, self._corners, axis=0)
        if indices is None:
            numbers = weld(self._polygons.indices, at_corners)
        else:
            numbers = indices[self._polygons.corners]
        level, first = cut(self._cage, numbers, self._topology.face_varying)
        refined = self._refine(level)
        fine = refine(refined.steps, at_corners[first])
        return np.take(fine, refined.corners[self._corners], axis=0)

    def _rows(self, values: Values, count: int, what: str) -> Values:
        """Return `values` if there are `count` of them, else raise an error."""
        if len(values) != count:
            raise StageError(self._where, f"{len(values)} {what}", str(count))
        return values

    def _refine(self, level: Level) -> _Refined:
        """Return the stencils from a level to the finest, and the finest corners."""
        mask = masks.loop if self._topology.scheme == "loop" else masks.catmull_clark
        levels = self._down_from(level)
        steps = tuple(mask(each) for each in levels)
        return _Refined(steps=steps, corners=self._cut(levels[-1]))

    def _finest(self, level: Level) -> I64:
        """Return the corners of the finest level."""
        return self._cut(self._down_from(level)[-1]) if self._levels else level.corners

    def _down_from(self, level: Level) -> list[Level]:
        """Return all levels except the finest: only the corners of that one are needed."""
        finer = triangles if self._topology.scheme == "loop" else quads
        levels = [level]
        while len(levels) < self._levels:
            levels.append(finer(levels[-1]))
        return levels

    def _cut(self, level: Level) -> I64:
        """Return the corners of the next level."""
        finer = triangle_corners if self._topology.scheme == "loop" else quad_corners
        return finer(level).ravel()

    def _pieces(self) -> tuple[I64, I64]:
        """Return the number of corners of each final face, and its polygon."""
        polygons, counts = np.arange(len(self._polygons.counts)), self._polygons.counts
        if self._levels == 0:
            return counts, polygons
        loop = self._topology.scheme == "loop"
        first = 4 if loop else counts
        pieces = np.repeat(polygons, first * 4 ** (self._levels - 1))
        return np.full(len(pieces), 3 if loop else 4), pieces

    def _drawn(self) -> Bools:
        """Return which polygons are visible: not holes, nor boundary faces that interpolateBoundary
        drops."""
        drawn = ~np.isin(self._polygons.faces, self._topology.holes)
        if self._smooth and self._topology.boundary == "none":
            authored = _creased(self._topology, _bare(self._polygons, self._points))
            loose = open_edges(self._cage) & (authored.edge_sharpness < INFINITE)
            at = np.zeros(self._points, bool)
            at[self._cage.ends[loose].ravel()] = True
            drawn[self._cage.face_of[at[self._cage.corners]]] = False
        return drawn


def _bare(polygons: Polygons, points: int) -> Level:
    """Return the level of a mesh's faces, without sharpness."""
    return coarsest(polygons.counts, polygons.indices, points)


def _creased(topology: Topology, level: Level) -> Level:
    """Return the level with authored sharpness; creases on missing edges are ignored."""
    first, second, sharpness = creases(topology)
    edge_sharpness, vertex_sharpness = level.edge_sharpness.copy(), level.vertex_sharpness.copy()
    edge = edge_numbers(level, first, second)
    edge_sharpness[edge[edge >= 0]] = sharpness[edge >= 0]
    vertex_sharpness[topology.corner_indices] = topology.corner_sharpnesses
    for each in (edge_sharpness, vertex_sharpness):
        each[~(each > 0)] = 0  # negative values and NaN mean smooth
    return replace(level, edge_sharpness=edge_sharpness, vertex_sharpness=vertex_sharpness)


def _sharpened(topology: Topology, polygons: Polygons, points: int) -> Level:
    """Return the coarsest level with authored and boundary sharpness."""
    level = _bare(polygons, points)
    if topology.scheme == "bilinear":
        return hard(level)
    level = _creased(topology, level)
    sharpen(level, corners=topology.boundary == "edgeAndCorner")
    return level


def _corner_normals(counts: I64, corners: I64, numbers: I64, points: F32) -> F32:
    """Return unit normals of smooth pieces: means of the faces' area vectors.

    Args:
        counts: Corners of each face, shape (f,).
        corners: Point at each corner, shape (c,).
        numbers: Number of the piece at each corner, shape (c,).
        points: Shape (p, 3).
    """
    start = np.cumsum(counts) - counts
    total: F64 = np.zeros((int(numbers.max(initial=-1)) + 1, 3))
    for n in sizes(counts):
        rows = start[counts == n] + np.arange(n)[:, None]
        spokes = np.take(points, corners[rows], axis=0)
        spokes = spokes[1:] - spokes[0]
        area = np.cross(spokes[:-1], spokes[1:]).sum(axis=0)
        at = numbers[rows].ravel()
        for axis in range(3):
            total[:, axis] += np.bincount(at, np.tile(area[:, axis], n), minlength=len(total))
    length = np.sqrt(np.einsum("nk,nk->n", total, total))
    total[length == 0] = (0.0, 0.0, 1.0)  # arbitrary direction for a piece without area
    return np.asarray(total / np.where(length == 0, 1, length)[:, None], np.float32)
