"""UsdGeom cameras."""

from __future__ import annotations

import math

import numpy as np
from pxr import Gf, Usd, UsdGeom

from usdsplat.core.errors import StageError
from usdsplat.delegate.scene_delegate.placing import column_matrix
from usdsplat.delegate.specs import CameraSpec, Matrix

UNIT = 0.1
"""Apertures, their offsets and focal lengths are authored in tenths of a scene unit."""


def read_camera(prim: Usd.Prim, time: Usd.TimeCode, cache: UsdGeom.XformCache) -> CameraSpec:
    """Return the camera that `prim` is at `time`.

    Raises:
        StageError: If it can make no image: no aperture, no focal length, no volume to see, or a
            transform without an inverse.
    """
    where = str(prim.GetPath())
    lens = UsdGeom.Camera(prim).GetCamera(time)
    near, far = lens.clippingRange.min, lens.clippingRange.max
    if not near < far:
        raise StageError(where, f"clippingRange ({near:g}, {far:g})", "near less than far")
    return CameraSpec(
        path=where,
        world_to_camera=_view(where, cache.GetLocalToWorldTransform(prim)),
        orthographic=lens.projection == Gf.Camera.Orthographic,
        window=_window(where, lens),
        clipping_range=(near, far),
    )


def _window(where: str, lens: Gf.Camera) -> tuple[float, float, float, float]:
    """The aperture as `CameraSpec.window` has it."""
    orthographic = lens.projection == Gf.Camera.Orthographic
    scale = UNIT if orthographic else 1.0 / lens.focalLength if lens.focalLength > 0 else math.nan
    width, height = scale * lens.horizontalAperture, scale * lens.verticalAperture
    x, y = scale * lens.horizontalApertureOffset, scale * lens.verticalApertureOffset
    if not (width > 0 and height > 0 and all(map(math.isfinite, (width, height, x, y)))):
        size = f"{lens.horizontalAperture:g} x {lens.verticalAperture:g}"
        found = f"aperture {size} and focal length {lens.focalLength:g}"
        raise StageError(where, found, "positive numbers")
    return x - width / 2, y - height / 2, x + width / 2, y + height / 2


def _view(where: str, local_to_world: Gf.Matrix4d) -> Matrix:
    """World to camera: position and rotation only, as GfFrustum has it, so that depth and clipping
    range are in scene units however the camera, or a group above it, is scaled."""
    frustum = Gf.Frustum()
    with np.errstate(all="ignore"):
        can_be_undone = bool(np.linalg.det(column_matrix(local_to_world)))
    if can_be_undone:
        frustum.SetPositionAndRotationFromMatrix(local_to_world)
    view = column_matrix(frustum.ComputeViewMatrix())
    if not can_be_undone or not np.isfinite(view).all():
        raise StageError(where, "a transform without an inverse", "one that can be undone")
    return tuple(view.ravel().tolist())
