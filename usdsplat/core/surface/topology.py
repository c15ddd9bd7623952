"""Mesh topology in terms of UsdGeomMesh, and its validation."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from usdsplat.core.cloud import F32, I32, I64
from usdsplat.core.errors import StageError

Scheme = Literal["none", "catmullClark", "loop", "bilinear"]
Boundary = Literal["none", "edgeOnly", "edgeAndCorner"]
FaceVarying = Literal["none", "cornersOnly", "cornersPlus1", "cornersPlus2", "boundaries", "all"]


def _no_integers() -> I32:
    return np.zeros(0, np.int32)


def _no_numbers() -> F32:
    return np.zeros(0, np.float32)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Topology:
    """Faces of a mesh and how to subdivide them; values are those of UsdGeomMesh."""

    counts: I32
    """Corners of each face, shape (f,)."""
    indices: I32
    """Point at each corner, shape (sum(counts),)."""
    scheme: Scheme = "catmullClark"
    left_handed: bool = False
    """Whether faces are clockwise seen from outside."""
    holes: I32 = field(default_factory=_no_integers)
    """Faces that are not drawn but influence their neighbours."""
    crease_indices: I32 = field(default_factory=_no_integers)
    """Points along the creases, one crease after another."""
    crease_lengths: I32 = field(default_factory=_no_integers)
    """Points of each crease, two or more."""
    crease_sharpnesses: F32 = field(default_factory=_no_numbers)
    """One for each crease, or one for each edge; 10 and more is infinitely sharp."""
    corner_indices: I32 = field(default_factory=_no_integers)
    corner_sharpnesses: F32 = field(default_factory=_no_numbers)
    boundary: Boundary = "edgeAndCorner"
    """Rule at open edges (interpolateBoundary)."""
    face_varying: FaceVarying = "cornersPlus1"
    """Rule of linear face-varying interpolation (faceVaryingLinearInterpolation)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Polygons:
    """Faces without degenerate ones; corners that repeat the one before are removed."""

    counts: I64
    """Corners of each face, three or more, shape (g,)."""
    indices: I64
    """Point at each corner, shape (c,)."""
    faces: I64
    """Authored face that each face comes from, shape (g,)."""
    corners: I64
    """Authored corner that each corner comes from, shape (c,)."""


def check(topology: Topology, points: int, where: str) -> Polygons:
    """Return the faces of a topology, checked against `points` points.

    Faces of fewer than three different corners have no area and are dropped.

    Raises:
        StageError: If counts are inconsistent, an index is out of range, or the Loop scheme has
            faces that are not triangles.
    """
    counts = np.asarray(topology.counts, np.int64).ravel()
    indices = np.asarray(topology.indices, np.int64).ravel()
    if (counts < 0).any():
        raise StageError(where, f"a face of {counts.min()} corners", "none below 0")
    if counts.sum() != len(indices):
        raise StageError(
            where,
            f"{len(indices)} face vertex indices",
            f"{counts.sum()}, the sum of the face vertex counts",
        )
    _in_range(where, "face vertex index", indices, points)
    _in_range(where, "hole", topology.holes, len(counts))
    _in_range(where, "crease index", topology.crease_indices, points)
    _in_range(where, "corner index", topology.corner_indices, points)
    _check_sharpness(topology, where)
    polygons = _without_slivers(counts, indices)
    if topology.scheme == "loop" and (polygons.counts != 3).any():
        raise StageError(
            where, f"a face of {polygons.counts.max()} corners", "triangles, for the loop scheme"
        )
    return polygons


def creases(topology: Topology) -> tuple[I64, I64, F32]:
    """Return first point, second point and sharpness of each creased edge of a checked topology."""
    lengths = np.asarray(topology.crease_lengths, np.int64)
    points = np.asarray(topology.crease_indices, np.int64)
    sharpness = np.asarray(topology.crease_sharpnesses, np.float32)
    if len(sharpness) == len(lengths):
        sharpness = np.repeat(sharpness, lengths - 1)
    starts = np.ones(len(points), bool)
    starts[np.cumsum(lengths) - 1] = False
    first = np.flatnonzero(starts)
    return points[first], points[first + 1], sharpness


def _in_range(where: str, what: str, values: I32 | I64, end: int) -> None:
    wrong = values[(values < 0) | (values >= end)]
    if len(wrong):
        raise StageError(where, f"{what} {wrong[0]}", f"0 or more and less than {end}")


def _check_sharpness(topology: Topology, where: str) -> None:
    lengths, sharp = np.asarray(topology.crease_lengths), topology.crease_sharpnesses
    if (lengths < 2).any():
        raise StageError(where, f"a crease of {lengths.min()} points", "two points or more")
    if lengths.sum() != len(topology.crease_indices):
        raise StageError(
            where,
            f"{len(topology.crease_indices)} crease indices",
            f"{lengths.sum()}, the sum of the crease lengths",
        )
    edges = int((lengths - 1).sum())
    if len(sharp) not in (len(lengths), edges):
        raise StageError(
            where,
            f"{len(sharp)} crease sharpnesses",
            f"{len(lengths)}, one for each crease, or {edges}, one for each edge",
        )
    if len(topology.corner_sharpnesses) != len(topology.corner_indices):
        raise StageError(
            where,
            f"{len(topology.corner_sharpnesses)} corner sharpnesses",
            f"{len(topology.corner_indices)}, one for each corner",
        )


def _without_slivers(counts: I64, indices: I64) -> Polygons:
    """Drop corners that repeat their predecessor, then faces of fewer than three corners."""
    faces, corners = np.arange(len(counts)), np.arange(len(indices))
    if len(indices):
        owner = np.repeat(faces, counts)
        before = corners - 1
        filled = counts > 0
        first = (np.cumsum(counts) - counts)[filled]
        before[first] = (np.cumsum(counts) - 1)[filled]
        kept = indices != indices[before]
        counts = np.bincount(owner[kept], minlength=len(counts))
        kept &= counts[owner] >= 3
        corners, indices = corners[kept], indices[kept]
    real = counts >= 3
    return Polygons(counts=counts[real], indices=indices, faces=faces[real], corners=corners)
