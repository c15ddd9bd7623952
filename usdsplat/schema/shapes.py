"""Read UsdGeom's meshes and shapes, checked, in the form of `core.surface`."""

from __future__ import annotations

from typing import cast

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat.core.cloud import F32, I32
from usdsplat.core.errors import StageError
from usdsplat.core.surface import gprims
from usdsplat.core.surface.topology import Boundary, FaceVarying, Scheme, Topology
from usdsplat.schema.values import integers, value, vectors

SCHEMES = ("none", "catmullClark", "loop", "bilinear")
BOUNDARIES = ("none", "edgeOnly", "edgeAndCorner")
FACE_VARYING = ("none", "cornersOnly", "cornersPlus1", "cornersPlus2", "boundaries", "all")


def topology(prim: Usd.Prim, time: Usd.TimeCode) -> Topology:
    """Read the topology of a mesh.

    Raises:
        StageError: If an attribute has the wrong type or an unknown token.
    """
    where = str(prim.GetPath())

    def whole(name: str) -> I32:
        return integers(f"{where}.{name}", value(prim.GetAttribute(name), time))

    def numbers(name: str) -> F32:
        found = value(prim.GetAttribute(name), time)
        return vectors(f"{where}.{name}", found, 1)[:, 0]

    def token(name: str, known: tuple[str, ...]) -> str:
        found = value(prim.GetAttribute(name), time)
        if found not in known:
            raise StageError(f"{where}.{name}", repr(found), f"one of {', '.join(known)}")
        return str(found)

    return Topology(
        counts=whole("faceVertexCounts"),
        indices=whole("faceVertexIndices"),
        scheme=cast(Scheme, token("subdivisionScheme", SCHEMES)),
        left_handed=value(prim.GetAttribute("orientation"), time) == UsdGeom.Tokens.leftHanded,
        holes=whole("holeIndices"),
        crease_indices=whole("creaseIndices"),
        crease_lengths=whole("creaseLengths"),
        crease_sharpnesses=numbers("creaseSharpnesses"),
        corner_indices=whole("cornerIndices"),
        corner_sharpnesses=numbers("cornerSharpnesses"),
        boundary=cast(Boundary, token("interpolateBoundary", BOUNDARIES)),
        face_varying=cast(FaceVarying, token("faceVaryingLinearInterpolation", FACE_VARYING)),
    )


def mesh_points(prim: Usd.Prim, time: Usd.TimeCode) -> F32:
    """Read the points of a mesh's cage, shape (n, 3), before skinning.

    Between samples, velocities extrapolate them from the last one under USD's conditions.

    Raises:
        StageError: If they are not finite vectors.
    """
    where = f"{prim.GetPath()}.points"
    points = vectors(where, value(prim.GetAttribute("points"), time), 3)
    velocities = prim.GetAttribute("velocities")
    if time.IsDefault() or not velocities or not velocities.HasAuthoredValue():
        return points
    vectors(f"{prim.GetPath()}.velocities", value(velocities, time), 3)
    moved = UsdGeom.PointBased(prim).ComputePointsAtTime(time, time)
    return vectors(where, moved, 3) if len(moved) == len(points) else points


def shape(prim: Usd.Prim, time: Usd.TimeCode) -> gprims.Shape:
    """Triangulate a sphere, cube, cylinder, cone, capsule or plane.

    Raises:
        StageError: If a size is not a finite number, or the axis is unknown.
    """

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
