"""List a stage's cameras, and author one that matches a viewport's view."""

from __future__ import annotations

import math

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

from usdsplat.core.errors import UsageError
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.stage_model.placing import code_of
from usdsplat.render.specs import CameraSpec
from usdsplat.schema.stage_values import parent_to_world

FOCAL_LENGTH = 50.0
"""Focal length of every authored camera [tenth of a unit]; a view does not specify a lens."""
UNIT = 0.1
"""Unit of apertures and focal lengths, in scene units."""


def cameras(stage: Usd.Stage) -> tuple[str, ...]:
    """Return the paths of the stage's cameras, including those in instances, in stage order."""
    everything = Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies())
    return tuple(str(prim.GetPath()) for prim in everything if prim.IsA(UsdGeom.Camera))


def save_camera(
    edits: Edits, spec: CameraSpec, *, name: str = "Camera", time: float | None = None
) -> str:
    """Author a camera with the view of `spec` on the session layer and return its path.

    Args:
        edits: Edits of the stage.
        spec: The view, such as `Picture.camera`.
        name: Name of the prim, a root of the stage; or its whole path, such as
            "/World/Cameras/Shot", which moves with its parent. A number is appended if the name is
            taken.
        time: Time at which the view is matched, if the parent moves.

    Raises:
        UsageError: If it is not a valid prim name, or `spec` is not a camera.
        StageError: If no prim can be made there.
    """
    check_camera(spec)
    path = _free(edits.stage, camera_path(name))
    above = [edits.stage.GetPrimAtPath(each) for each in path.GetPrefixes()[:-1]]
    made = [str(prim.GetPath()) for prim in above if prim and not prim.IsDefined()]
    with edits.step(f"Save {path.name}", *made, str(path)):  # defining one defines its parents
        author_camera(edits.stage, path, spec, time=time)
    return str(path)


def author_camera(
    stage: Usd.Stage, path: Sdf.Path, spec: CameraSpec, *, time: float | None = None
) -> UsdGeom.Camera:
    """Author a camera on the edit target, as `save_camera` does."""
    camera = UsdGeom.Camera.Define(stage, path)
    left, bottom, right, top = spec.window
    scale = 1.0 / UNIT if spec.orthographic else FOCAL_LENGTH
    camera.CreateProjectionAttr("orthographic" if spec.orthographic else "perspective")
    camera.CreateFocalLengthAttr(FOCAL_LENGTH)
    camera.CreateHorizontalApertureAttr(scale * (right - left))
    camera.CreateVerticalApertureAttr(scale * (top - bottom))
    camera.CreateHorizontalApertureOffsetAttr(scale * (left + right) / 2)
    camera.CreateVerticalApertureOffsetAttr(scale * (bottom + top) / 2)
    camera.CreateClippingRangeAttr(Gf.Vec2f(*spec.clipping_range))
    if spec.lens_radius > 0:
        camera.CreateFStopAttr(UNIT * FOCAL_LENGTH / (2 * spec.lens_radius))
        camera.CreateFocusDistanceAttr(spec.focus_distance)
    if spec.exposure != 1.0:
        camera.CreateExposureAttr(math.log2(spec.exposure))
    if spec.shutter != (0.0, 0.0):
        camera.CreateShutterOpenAttr(spec.shutter[0])
        camera.CreateShutterCloseAttr(spec.shutter[1])
    above = parent_to_world(camera.GetPrim(), UsdGeom.XformCache(code_of(time)))
    camera.AddTransformOp().Set(_camera_to_world(spec) * above.GetInverse())
    return camera


def author_view(stage: Usd.Stage, spec: CameraSpec, *, name: str = "Camera") -> str:
    """Author a camera under an unused name on the edit target, and return its path.

    Raises:
        UsageError: If it is not a valid prim name, or `spec` is not a camera.
    """
    check_camera(spec)
    path = _free(stage, camera_path(name))
    author_camera(stage, path, spec)
    return str(path)


def check_camera(spec: CameraSpec) -> None:
    """Check that `spec` can be authored as a camera.

    Raises:
        UsageError: If a number is not finite, or the frustum is empty.
    """
    left, bottom, right, top = spec.window
    near, far = spec.clipping_range
    numbers = (*spec.world_to_camera, *spec.window, near, far, spec.exposure, spec.lens_radius)
    is_camera = len(spec.world_to_camera) == 16 and all(map(math.isfinite, numbers))
    if not (is_camera and left < right and bottom < top and near < far and spec.exposure > 0):
        raise UsageError("camera", "an empty view", "an aperture and a depth range above 0")


def _camera_to_world(spec: CameraSpec) -> Gf.Matrix4d:
    view = np.reshape(spec.world_to_camera, (4, 4))
    return Gf.Matrix4d(view.T.tolist()).GetInverse()


def camera_path(name: str) -> Sdf.Path:
    """Return the prim path for a camera's name.

    Raises:
        UsageError: If it is not a valid prim name.
    """
    text = name if name.startswith("/") else f"/{name}"
    path = Sdf.Path(text) if Sdf.Path.IsValidPathString(text) else Sdf.Path()
    is_name = path.IsPrimPath() and not path.ContainsPrimVariantSelection()
    if not is_name or ("/" in name and not name.startswith("/")):
        raise UsageError("camera", repr(name), "a name such as Shot, or a path such as /World/Shot")
    return path


def _free(stage: Usd.Stage, path: Sdf.Path) -> Sdf.Path:
    """Return the path, with the first number appended that makes it unused."""
    free, number = path, 1
    while stage.GetPrimAtPath(free):
        free, number = path.ReplaceName(f"{path.name}{number}"), number + 1
    return free
