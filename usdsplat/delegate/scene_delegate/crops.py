"""Read crop volumes at a time, in a form for tests of splat centres."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat.core.cloud import F64
from usdsplat.core.errors import StageError
from usdsplat.core.findings import Finding, finding, from_error
from usdsplat.delegate.scene_delegate.placing import column_matrix
from usdsplat.delegate.scene_delegate.volumes import SHAPES, Crop, Volume
from usdsplat.render.specs import CropShape, CropSpec, Matrix
from usdsplat.schema.stage_values import local_to_world

NOWHERE: Matrix = (0.0, 0.0, 0.0, 2.0) * 3 + (0.0, 0.0, 0.0, 1.0)
"""Matrix that maps the whole world to a point outside every canonical shape."""

AXES = {"X": [[0, 0, 1], [1, 0, 0], [0, 1, 0]], "Y": [[0, 1, 0], [0, 0, 1], [1, 0, 0]]}
"""Axis of a gprim -> rotation from z to it; Z needs none."""


def read_crop(
    crop: Crop, time: Usd.TimeCode, cache: UsdGeom.XformCache
) -> tuple[tuple[CropSpec, ...], tuple[Finding, ...]]:
    """Return the volumes of a crop at `time`, and its problems.

    The visibility of volumes is ignored: mattes are usually hidden.
    """
    specs, findings = [], list(crop.findings)
    for volume in crop.volumes:
        where = str(volume.prim.GetPath())
        try:
            spec = _read_volume(volume, time, cache)
        except StageError as error:  # its place is unknown
            findings.append(from_error("bad-transform", error))
            shape = SHAPES[volume.prim.GetTypeName()]
            specs.append(CropSpec(shape=shape, world_to_shape=NOWHERE, keeps=volume.keeps))
            continue
        specs.append(spec)
        if spec.world_to_shape == NOWHERE:
            found, expected = "an empty crop volume", "a volume with a size"
            findings.append(finding("empty-crop", where, found, expected))
    return tuple(specs), tuple(findings)


def _read_volume(volume: Volume, time: Usd.TimeCode, cache: UsdGeom.XformCache) -> CropSpec:
    """Return a volume; NOWHERE if it has no size.

    Raises:
        StageError: If USD does not know one of its transform ops.
    """
    prim = volume.prim
    shape = SHAPES[prim.GetTypeName()]
    size, length = _size(prim, shape, time)
    world_to_shape = NOWHERE
    if all(0 < each < np.inf for each in size) and 0 <= length < np.inf:
        placed = column_matrix(local_to_world(prim, cache)) @ _turn(prim, time)
        world_to_shape = _inverse(placed @ np.diag([*size, 1.0]))
    return CropSpec(
        shape=shape,
        world_to_shape=world_to_shape,
        keeps=volume.keeps,
        length=0.0 if world_to_shape == NOWHERE else length,
    )


def _size(
    prim: Usd.Prim, shape: CropShape, time: Usd.TimeCode
) -> tuple[tuple[float, float, float], float]:
    """Return the scale of the canonical shape along x, y and z, and a capsule's `length`."""
    if shape == "plane":
        return (1.0, 1.0, 1.0), 0.0
    if shape == "cube":
        half = 0.5 * _value(prim, "size", time)
        return (half, half, half), 0.0
    radius = _value(prim, "radius", time)
    if shape == "sphere":
        return (radius, radius, radius), 0.0
    half = 0.5 * _value(prim, "height", time)
    if shape == "capsule":
        return (radius, radius, radius), half / radius if radius else 0.0
    return (radius, radius, half), 0.0


def _turn(prim: Usd.Prim, time: Usd.TimeCode) -> F64:
    """Return the rotation from a shape about z to one about the prim's axis."""
    turn = np.eye(4)
    if prim.HasAttribute("axis"):
        turn[:3, :3] = AXES.get(_value(prim, "axis", time), np.eye(3))
    return turn


def _value(prim: Usd.Prim, name: str, time: Usd.TimeCode) -> Any:
    """Return a schema attribute; its fallback if it is blocked or of the wrong type."""
    value = prim.GetAttribute(name).Get(time)
    fallback = prim.GetPrimDefinition().GetAttributeFallbackValue(name)
    return value if isinstance(value, type(fallback)) else fallback


def _inverse(matrix: F64) -> Matrix:
    """Return the inverse, or NOWHERE if it is singular."""
    with np.errstate(all="ignore"):
        if not np.isfinite(matrix).all() or not np.linalg.det(matrix):
            return NOWHERE
        inverse = np.linalg.inv(matrix)
    return tuple(inverse.ravel().tolist()) if np.isfinite(inverse).all() else NOWHERE
