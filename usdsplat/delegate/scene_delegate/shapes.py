"""The shapes that UsdGeom gives by their sizes, as triangles."""

from __future__ import annotations

from typing import cast

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat.core.cloud import F32, I32
from usdsplat.core.errors import StageError
from usdsplat.core.surface import gprims
from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.scene_delegate.geometry import Context, Geometry, checked_rows, unit
from usdsplat.delegate.scene_delegate.readings import Sources
from usdsplat.delegate.scene_delegate.values import value


class ShapeGeometry(Geometry):
    """A sphere, cube, cylinder, cone, capsule or plane."""

    uvs: F32 | None = None

    def update(self, prim: Usd.Prim, bits: DirtyBits, context: Context, sources: Sources) -> bool:
        """Implements `Geometry.update`."""
        if not bits & ~DirtyBits.NORMALS:
            return False
        context.pulls["points"] += 1
        shape = _shape(prim, context.time)
        points, normals = shape.points, shape.normals
        skin = context.skeletons.skin(prim, sources)
        if skin:
            count = len(points)
            at = shape.triangles.ravel()
            if normals is not None:
                turned = skin.normals(normals.reshape(-1, 3), at, count, context.time)
                normals = unit(turned.reshape(normals.shape), None)
            points = skin.points(points, context.time)
        self.points, self.triangles, self.normals = points, shape.triangles, normals
        self.uvs = shape.uvs
        self.faces = np.zeros(len(shape.triangles), np.int32)
        return True

    def corners(self, values: F32, interpolation: str, indices: I32 | None) -> F32:
        """Implements `Geometry.corners`: a shape has one value of everything."""
        if indices is not None:
            values = values[checked_rows(self.where, indices, len(values))]
        if len(values) != 1:
            raise StageError(self.where, f"{len(values)} values of a primvar", "1 on such a shape")
        return np.broadcast_to(values[0], (len(self.triangles), 3, values.shape[1])).copy()


def _shape(prim: Usd.Prim, time: Usd.TimeCode) -> gprims.Shape:
    """The triangles of a shape of the size that `prim` says."""

    def size(name: str) -> float:
        found = value(prim.GetAttribute(name), time)
        if not isinstance(found, (int, float)) or not np.isfinite(found):
            raise StageError(f"{prim.GetPath()}.{name}", repr(found), "a finite number")
        return float(found)

    if prim.IsA(UsdGeom.Sphere):
        return gprims.sphere(radius=size("radius"))
    if prim.IsA(UsdGeom.Cube):
        return gprims.cube(size=size("size"))
    found = str(value(prim.GetAttribute("axis"), time))
    if found not in ("X", "Y", "Z"):
        raise StageError(f"{prim.GetPath()}.axis", repr(found), "X, Y or Z")
    axis = cast(gprims.Axis, found)
    if prim.IsA(UsdGeom.Plane):
        return gprims.plane(width=size("width"), length=size("length"), axis=axis)
    height = size("height")
    if prim.IsA(UsdGeom.Cone):
        return gprims.cone(radius=size("radius"), height=height, axis=axis)
    if prim.IsA(UsdGeom.Cylinder):
        return gprims.cylinder(radius=size("radius"), height=height, axis=axis)
    if prim.IsA(UsdGeom.Capsule):
        return gprims.capsule(radius=size("radius"), height=height, axis=axis)
    radius, top = size("radiusBottom"), size("radiusTop")
    make = gprims.cylinder if prim.IsA(UsdGeom.Cylinder_1) else gprims.capsule
    return make(radius=radius, height=height, axis=axis, top=top)
