"""A torus to conform to."""

from __future__ import annotations

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

AROUND, ACROSS = 192, 48
"""Quads around the ring and around its tube."""


def author_torus(
    stage: Usd.Stage, path: Sdf.Path, *, radius: float, tube: float, axis: str
) -> UsdGeom.Mesh:
    """Author a torus about the origin, as a mesh of quads that face outwards.

    Args:
        stage: Stage to author on.
        path: Path of the mesh.
        radius: Distance from the axis to the centre of the tube [unit].
        tube: Radius of the tube [unit].
        axis: "X", "Y" or "Z".
    """
    u = 2 * np.pi * np.arange(AROUND)[:, None] / AROUND
    v = 2 * np.pi * np.arange(ACROSS)[None, :] / ACROSS
    reach = radius + tube * np.cos(v)
    parts = [
        reach * np.cos(u),
        reach * np.sin(u),
        np.broadcast_to(tube * np.sin(v), u.shape[:1] + v.shape[1:]),
    ]
    turn = "XYZ".index(axis) + 1
    points = np.stack([parts[(i - turn) % 3] for i in range(3)], axis=-1).reshape(-1, 3)
    i, j = np.divmod(np.arange(AROUND * ACROSS), ACROSS)
    beside, above = (i + 1) % AROUND * ACROSS, (j + 1) % ACROSS
    quads = np.stack([i * ACROSS + j, beside + j, beside + above, i * ACROSS + above], axis=1)
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(points, np.float32)))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(len(quads), 4))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(quads.ravel().astype(np.int32)))
    mesh.CreateSubdivisionSchemeAttr("none")
    box = np.stack([points.min(axis=0), points.max(axis=0)]).astype(float)
    mesh.CreateExtentAttr([Gf.Vec3f(*corner) for corner in box.tolist()])
    mesh.CreateDisplayColorAttr([Gf.Vec3f(0.12, 0.3, 0.6)])
    return mesh
