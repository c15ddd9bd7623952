"""Read meshes and shapes as triangles, at any time, in the simulation's space."""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat.core.cloud import F32, I32
from usdsplat.core.errors import StageError
from usdsplat.core.surface.refine import Surface as Triangulation
from usdsplat.schema import shapes
from usdsplat.schema.values import value
from usdsplat.sim.specs import Surface
from usdsplat.sim.stage.skeletons import Rigs
from usdsplat.sim.stage.spaces import Space, transform_points

SHAPES = ("Sphere", "Cube", "Cylinder", "Cylinder_1", "Cone", "Capsule", "Capsule_1", "Plane")
SIZES = ("radius", "radiusBottom", "radiusTop", "height", "size", "width", "length", "axis")
TOPOLOGY = ("faceVertexCounts", "faceVertexIndices", "holeIndices", "orientation")


class Triangles:
    """The triangles of one prim in its own space; a mesh is its control cage."""

    def __init__(self, prim: Usd.Prim, rigs: Rigs) -> None:
        self.prim = prim
        self._is_mesh = bool(prim.IsA(UsdGeom.Mesh))
        if not self._is_mesh and prim.GetTypeName() not in SHAPES:
            kind = f"a prim of type {prim.GetTypeName()!s}"
            raise StageError(str(prim.GetPath()), kind, "a Mesh, or a UsdGeom shape")
        skinned = rigs.skin(prim) if self._is_mesh else None
        self._skin = skinned[0] if skinned else None
        self.placer = skinned[1] if skinned else prim
        """Prim in whose space the points are."""
        self._built: tuple[int, I32] | None = None

    @property
    def varies(self) -> bool:
        """Whether the points may change over time."""
        names = (*TOPOLOGY, "points") if self._is_mesh else SIZES
        found = [self.prim.GetAttribute(name) for name in names]
        moves = self.prim.GetAttribute("velocities")
        return (
            self._skin is not None
            or any(each and each.ValueMightBeTimeVarying() for each in found)
            or bool(self._is_mesh and moves and moves.HasAuthoredValue())
        )

    def at(self, time: Usd.TimeCode) -> tuple[F32, I32]:
        """Return points, shape (p, 3), and triangles, shape (t, 3), counter-clockwise from outside.

        Raises:
            StageError: If there are none, or they are inconsistent.
        """
        if not self._is_mesh:
            shape = shapes.shape(self.prim, time)
            return shape.points, shape.triangles
        points = shapes.mesh_points(self.prim, time)
        triangles = self._triangles(points, time)
        return (self._skin.points(points, time) if self._skin else points), triangles

    def rest(self, time: Usd.TimeCode) -> tuple[F32, I32]:
        """Return points and triangles before skinning, in the prim's own space."""
        points = shapes.mesh_points(self.prim, time)
        return points, self._triangles(points, time)

    def _triangles(self, points: F32, time: Usd.TimeCode) -> I32:
        """Triangulate the polygons; the result is the same at all times at which the topology
        is."""
        stays = not any(
            attribute and attribute.ValueMightBeTimeVarying()
            for attribute in (self.prim.GetAttribute(name) for name in TOPOLOGY)
        )
        if stays and self._built is not None and self._built[0] == len(points):
            return self._built[1]
        where = str(self.prim.GetPath())
        default = value(self.prim.GetAttribute("points"), Usd.TimeCode.Default())
        rest = points
        if default is not None and len(default) == len(points):
            rest = np.array(
                default, np.float32
            )  # the result must not depend on the time of the first read
        cut = Triangulation(
            shapes.topology(self.prim, time), points=len(points), levels=0, rest=rest, where=where
        )
        if not len(cut.triangles):
            raise StageError(where, "a mesh without faces", "a mesh with faces")
        self._built = len(points), cut.triangles
        return cut.triangles


class SurfaceReader:
    """Reader of the surface of one prim in the simulation's space, or of all meshes and shapes
    below it; returns the same object while nothing moves.

    Raises:
        StageError: If the prim neither is nor has a mesh or a shape.
    """

    def __init__(self, prim: Usd.Prim, space: Space, rigs: Rigs) -> None:
        self._parts = [Triangles(each, rigs) for each in _surfaces(prim)]
        self._space = space
        self._last: Surface | None = None

    def at(self, time: Usd.TimeCode) -> Surface:
        """Return the surface at a time.

        Raises:
            StageError: If a prim has no triangles.
        """
        points, triangles, first = [], [], 0
        for part in self._parts:
            own, faces = part.at(time)
            matrix = self._space.from_prim(part.placer, time)
            points.append(transform_points(matrix, own))
            triangles.append(facing_outwards(faces, matrix) + np.int32(first))
            first += len(own)
        is_one = len(self._parts) == 1
        made = Surface(
            points=points[0] if is_one else np.concatenate(points),
            triangles=triangles[0] if is_one else np.concatenate(triangles),
        )
        self._last = unchanged_or(self._last, made)
        return self._last


def _surfaces(prim: Usd.Prim) -> list[Usd.Prim]:
    """Return a mesh or shape, or those below a group."""
    if prim.IsA(UsdGeom.Mesh) or prim.GetTypeName() in SHAPES:
        return [prim]
    every = Usd.PrimRange(prim, Usd.TraverseInstanceProxies())
    found = [each for each in every if each.IsA(UsdGeom.Mesh) or each.GetTypeName() in SHAPES]
    return found or [prim]  # which Triangles rejects


def facing_outwards(triangles: I32, matrix: np.ndarray) -> I32:
    """Return triangles that are counter-clockwise from outside after `matrix`, as they were before
    it."""
    if np.linalg.det(matrix[:3, :3]) >= 0:
        return triangles
    return np.ascontiguousarray(triangles[:, ::-1])


def unchanged_or(last: Surface | None, made: Surface) -> Surface:
    """Return the last surface if the new one is equal to it, so that results cached for it remain
    valid."""
    if last is None:
        return made
    equal = np.array_equal(last.points, made.points)
    return last if equal and np.array_equal(last.triangles, made.triangles) else made


def related(prim: Usd.Prim, name: str) -> Usd.Prim | None:
    """Return the target of a relationship, or None.

    Raises:
        StageError: If it has several targets, or one that does not exist.
    """
    relationship = prim.GetRelationship(name)
    targets = relationship.GetForwardedTargets() if relationship else []
    if not targets:
        return None
    where = f"{prim.GetPath()}.{name}"
    if len(targets) > 1:
        raise StageError(where, f"{len(targets)} targets", "one")
    found = prim.GetStage().GetPrimAtPath(targets[0].GetPrimPath())
    if not found:
        raise StageError(where, f"the target {targets[0]}, which does not exist", "a prim")
    return found
