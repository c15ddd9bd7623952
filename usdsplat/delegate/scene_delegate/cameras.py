"""UsdGeom cameras: where they are, what they see, and how much light they let in."""

from __future__ import annotations

import math

import numpy as np
from pxr import Gf, Usd, UsdGeom

from usdsplat.core.errors import StageError
from usdsplat.delegate.scene_delegate.placing import column_matrix
from usdsplat.render.specs import CameraSpec, Matrix

UNIT = 0.1
"""Apertures, their offsets and focal lengths are authored in tenths of a scene unit."""


def read_camera(prim: Usd.Prim, time: Usd.TimeCode, cache: UsdGeom.XformCache) -> CameraSpec:
    """Return the camera that `prim` is at `time`.

    A lens needs an fStop and a focusDistance: with either 0, as both are where nobody authors
    them, the camera is a pinhole, and so is an orthographic one.

    Raises:
        StageError: If it can make no image: no aperture, no focal length, no volume to see, an
            exposure that is no number, or a transform without an inverse.
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
        exposure=_exposure(where, UsdGeom.Camera(prim), time),
        lens_radius=_lens_radius(lens),
        focus_distance=lens.focusDistance,
        shutter=_shutter(prim, time) if shutter_problem(prim, time) is None else (0.0, 0.0),
    )


def shutter_problem(prim: Usd.Prim, time: Usd.TimeCode) -> StageError | None:
    """Why the camera's shutter cannot be used at `time`.

    UsdGeom would have such a picture black. Here the camera is then still, so that a slip in one
    attribute does not cost a night on the farm.
    """
    opens, closes = _shutter(prim, time)
    if opens <= closes and math.isfinite(closes - opens):
        return None
    found = f"({opens:g}, {closes:g})"
    expected = "one that closes after it opens; it is taken for (0, 0)"
    return StageError(f"{prim.GetPath()} shutter:open and shutter:close", found, expected)


def _exposure(where: str, camera: UsdGeom.Camera, time: Usd.TimeCode) -> float:
    scale = camera.ComputeLinearExposureScale(time)
    if not 0 <= scale < math.inf:
        raise StageError(where, f"an exposure with a scale of {scale:g}", "a finite one")
    return float(scale)


def _lens_radius(lens: Gf.Camera) -> float:
    """Of the entrance pupil [scene unit]; fStop and focusDistance that are no numbers are 0."""
    is_pinhole = lens.projection == Gf.Camera.Orthographic
    if is_pinhole or not (0 < lens.fStop < math.inf and 0 < lens.focusDistance < math.inf):
        return 0.0
    return float(UNIT * lens.focalLength / (2 * lens.fStop))


def _shutter(prim: Usd.Prim, time: Usd.TimeCode) -> tuple[float, float]:
    """Opening and closing [time code], relative to the frame; blocked ones are USD's 0."""
    camera = UsdGeom.Camera(prim)
    opens, closes = (
        attribute.Get(time) or 0.0
        for attribute in (camera.GetShutterOpenAttr(), camera.GetShutterCloseAttr())
    )
    return float(opens), float(closes)


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
