"""Read UsdGeom's parametric shapes as triangles."""

from __future__ import annotations

import numpy as np
from pxr import Usd

from usdsplat.core.cloud import F32, I32
from usdsplat.core.errors import StageError
from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.scene_delegate.geometry import Context, Geometry, checked_rows, unit
from usdsplat.delegate.scene_delegate.readings import Sources
from usdsplat.schema.shapes import shape


class ShapeGeometry(Geometry):
    """The triangles of a sphere, cube, cylinder, cone, capsule or plane."""

    uvs: F32 | None = None

    def update(self, prim: Usd.Prim, bits: DirtyBits, context: Context, sources: Sources) -> bool:
        """Implement `Geometry.update`."""
        if not bits & ~DirtyBits.NORMALS:
            return False
        context.pulls["points"] += 1
        found = shape(prim, context.time)
        points, normals = found.points, found.normals
        skin = context.skeletons.skin(prim, sources)
        if skin:
            count = len(points)
            at = found.triangles.ravel()
            if normals is not None:
                turned = skin.normals(normals.reshape(-1, 3), at, count, context.time)
                normals = unit(turned.reshape(normals.shape), None)
            points = skin.points(points, context.time)
        self.points, self.triangles, self.normals = points, found.triangles, normals
        self.uvs = found.uvs
        self.faces = np.zeros(len(found.triangles), np.int32)
        return True

    def corners(self, values: F32, interpolation: str, indices: I32 | None) -> F32:
        """Implement `Geometry.corners`: a primvar of a shape has one value."""
        if indices is not None:
            values = values[checked_rows(self.where, indices, len(values))]
        if len(values) != 1:
            raise StageError(self.where, f"{len(values)} values of a primvar", "1 on such a shape")
        return np.broadcast_to(values[0], (len(self.triangles), 3, values.shape[1])).copy()
