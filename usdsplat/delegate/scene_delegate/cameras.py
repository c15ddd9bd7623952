"""UsdGeom cameras."""

from __future__ import annotations

import math

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat.core.errors import StageError
from usdsplat.delegate.scene_delegate.placing import column_matrix
from usdsplat.delegate.specs import CameraSpec

UNIT = 0.1
"""Apertures, their offsets and focal lengths are authored in tenths of a scene unit."""


def read_camera(prim: Usd.Prim, time: Usd.TimeCode, cache: UsdGeom.XformCache) -> CameraSpec:
    """Return the camera that `prim` is at `time`.

    Raises:
        StageError: If it can make no image: no aperture, no focal length, no volume to see, or a
            transform without an inverse.
    """
    where = str(prim.GetPath())
    camera = UsdGeom.Camera(prim)
    orthographic = camera.GetProjectionAttr().Get(time) == UsdGeom.Tokens.orthographic
    width, height, x, y, focal = (
        float(attribute.Get(time))
        for attribute in (
            camera.GetHorizontalApertureAttr(),
            camera.GetVerticalApertureAttr(),
            camera.GetHorizontalApertureOffsetAttr(),
            camera.GetVerticalApertureOffsetAttr(),
            camera.GetFocalLengthAttr(),
        )
    )
    near, far = (float(depth) for depth in camera.GetClippingRangeAttr().Get(time))
    scale = UNIT if orthographic else 1.0 / focal if focal > 0 else 0.0
    left, right = scale * (x - width / 2), scale * (x + width / 2)
    bottom, top = scale * (y - height / 2), scale * (y + height / 2)
    if not (
        width > 0
        and height > 0
        and scale > 0
        and all(map(math.isfinite, (left, right, bottom, top)))
    ):
        found = f"aperture {width:g} x {height:g} and focal length {focal:g}"
        raise StageError(where, found, "positive numbers")
    if not near < far:
        raise StageError(where, f"clippingRange ({near:g}, {far:g})", "near less than far")
    return CameraSpec(
        path=where,
        world_to_camera=_inverse(where, column_matrix(cache.GetLocalToWorldTransform(prim))),
        orthographic=orthographic,
        window=(left, bottom, right, top),
        clipping_range=(near, far),
    )


def _inverse(where: str, matrix: np.ndarray) -> tuple[float, ...]:
    if not np.isfinite(matrix).all() or np.linalg.det(matrix) == 0:
        raise StageError(where, "a transform without an inverse", "one that can be undone")
    return tuple(np.linalg.inv(matrix).ravel().tolist())
