"""Read UsdGeom cameras: transform, aperture, lens, exposure and shutter."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from pxr import Gf, Usd, UsdGeom

from usdsplat.core.errors import StageError
from usdsplat.core.findings import Finding, finding, from_error
from usdsplat.core.wording import counted
from usdsplat.delegate.scene_delegate.placing import column_matrix
from usdsplat.render.specs import CameraSpec, Matrix
from usdsplat.schema.stage_values import local_to_world

UNIT = 0.1
"""Unit of apertures, offsets and focal lengths: a tenth of a scene unit."""


def read_camera(prim: Usd.Prim, time: Usd.TimeCode, cache: UsdGeom.XformCache) -> CameraSpec:
    """Read a camera at a time.

    A lens needs an fStop and a focusDistance. If either is 0, the default of both, the camera is a
    pinhole, as is an orthographic one.

    Raises:
        StageError: If the camera cannot form an image: no aperture, no focal length, an empty
            clipping range, an exposure that is not finite, or a singular transform.
    """
    where = str(prim.GetPath())
    placed = local_to_world(prim, cache)  # first, because `GetCamera` computes it too
    lens = UsdGeom.Camera(prim).GetCamera(time)
    near, far = lens.clippingRange.min, lens.clippingRange.max
    if not near < far:
        raise StageError(where, f"clippingRange ({near:g}, {far:g})", "near less than far")
    return CameraSpec(
        path=where,
        world_to_camera=_view(where, placed),
        orthographic=lens.projection == Gf.Camera.Orthographic,
        window=_window(where, lens),
        clipping_range=(near, far),
        focal_length=0.0 if lens.projection == Gf.Camera.Orthographic else UNIT * lens.focalLength,
        exposure=_exposure(where, UsdGeom.Camera(prim), time),
        lens_radius=_lens_radius(lens),
        focus_distance=lens.focusDistance,
        shutter=_shutter(prim, time) if shutter_problem(prim, time) is None else (0.0, 0.0),
    )


def shutter_problem(prim: Usd.Prim, time: Usd.TimeCode) -> StageError | None:
    """Return an error if the camera's shutter is invalid at `time`.

    By UsdGeom's rules the picture would be black. Here the camera is still instead, so that a
    mistake in one attribute does not spoil a whole render.
    """
    opens, closes = _shutter(prim, time)
    if opens <= closes and math.isfinite(closes - opens):
        return None
    found = f"({opens:g}, {closes:g})"
    expected = "one that closes after it opens; (0, 0) is used"
    return StageError(f"{prim.GetPath()} shutter:open and shutter:close", found, expected)


def camera_findings(prim: Usd.Prim, time: Usd.TimeCode) -> Iterator[Finding]:
    """Yield a finding on an invalid shutter, and on each attribute that has no effect."""
    if wrong := shutter_problem(prim, time):
        yield from_error("bad-shutter", wrong)
    camera, path = UsdGeom.Camera(prim), prim.GetPath()
    planes, projection = camera.GetClippingPlanesAttr(), camera.GetProjectionAttr()
    if planes.Get(time):
        found = counted(len(planes.Get(time)), "plane")
        yield finding("unsupported-input", f"{path}.clippingPlanes", found, "none")
    kind, kinds = projection.Get(time), (UsdGeom.Tokens.perspective, UsdGeom.Tokens.orthographic)
    if kind is not None and kind not in kinds:
        expected = f"{' or '.join(kinds)}; {kinds[0]} is used"
        yield finding("unsupported-input", f"{path}.projection", repr(kind), expected)


def _exposure(where: str, camera: UsdGeom.Camera, time: Usd.TimeCode) -> float:
    scale = camera.ComputeLinearExposureScale(time)
    if not 0 <= scale < math.inf:
        raise StageError(where, f"an exposure with a scale of {scale:g}", "a finite one")
    return float(scale)


def _lens_radius(lens: Gf.Camera) -> float:
    """Return the radius of the entrance pupil [scene unit]; 0 for invalid fStop or
    focusDistance."""
    is_pinhole = lens.projection == Gf.Camera.Orthographic
    if is_pinhole or not (0 < lens.fStop < math.inf and 0 < lens.focusDistance < math.inf):
        return 0.0
    return float(UNIT * lens.focalLength / (2 * lens.fStop))


def _shutter(prim: Usd.Prim, time: Usd.TimeCode) -> tuple[float, float]:
    """Return shutter open and close [time code], relative to the frame; 0 without a number."""
    camera = UsdGeom.Camera(prim)
    values = (camera.GetShutterOpenAttr().Get(time), camera.GetShutterCloseAttr().Get(time))
    opens, closes = (found if isinstance(found, int | float) else 0.0 for found in values)
    return float(opens), float(closes)


def _window(where: str, lens: Gf.Camera) -> tuple[float, float, float, float]:
    """Return the aperture in the form of `CameraSpec.window`."""
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
    """Return world to camera without scale, as GfFrustum does.

    Depth and clipping range are then in scene units, even if the camera or an ancestor is
    scaled."""
    frustum = Gf.Frustum()
    with np.errstate(all="ignore"):
        can_be_undone = bool(np.linalg.det(column_matrix(local_to_world)))
    if can_be_undone:
        frustum.SetPositionAndRotationFromMatrix(local_to_world)
    view = column_matrix(frustum.ComputeViewMatrix())
    if not can_be_undone or not np.isfinite(view).all():
        raise StageError(where, "a transform without an inverse", "an invertible transform")
    return tuple(view.ravel().tolist())
