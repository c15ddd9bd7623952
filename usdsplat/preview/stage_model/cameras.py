"""Cameras of a stage, and a new one that sees what a viewport sees."""

from __future__ import annotations

import math

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

from usdsplat.core.errors import UsageError
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.stage_model.placing import code_of
from usdsplat.render.specs import CameraSpec

FOCAL_LENGTH = 50.0
"""Of every camera made here: a view says what it sees, not by which lens [tenth of a unit]."""
UNIT = 0.1
"""Apertures and focal lengths are authored in tenths of a scene unit."""


def cameras(stage: Usd.Stage) -> tuple[str, ...]:
    """Paths of the stage's cameras, those in instances too, in the order of the stage."""
    everything = Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies())
    return tuple(str(prim.GetPath()) for prim in everything if prim.IsA(UsdGeom.Camera))


def save_camera(
    edits: Edits, spec: CameraSpec, *, name: str = "Camera", time: float | None = None
) -> str:
    """Author a camera that sees what `spec` sees, on the session layer; returns its path.

    Args:
        edits: Of the stage.
        spec: Such as `Picture.camera`.
        name: Of the prim, a root of the stage; or its whole path, such as "/World/Cameras/Shot",
            in whose parent it then moves along. A number is added where it is taken.
        time: When it sees that, if its parent moves.

    Raises:
        UsageError: If it is no name of a prim, or `spec` is no camera.
        StageError: If no prim can be made there.
    """
    check_camera(spec)
    path = _free(edits.stage, camera_path(name))
    above = [edits.stage.GetPrimAtPath(each) for each in path.GetPrefixes()[:-1]]
    made = [str(prim.GetPath()) for prim in above if prim and not prim.IsDefined()]
    with edits.step(f"Save {path.name}", *made, str(path)):  # to define one defines those above
        author_camera(edits.stage, path, spec, time=time)
    return str(path)


def author_camera(
    stage: Usd.Stage, path: Sdf.Path, spec: CameraSpec, *, time: float | None = None
) -> UsdGeom.Camera:
    """Author a camera on the edit target; see `save_camera`."""
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
    above = UsdGeom.XformCache(code_of(time)).GetParentToWorldTransform(camera.GetPrim())
    camera.AddTransformOp().Set(_camera_to_world(spec) * above.GetInverse())
    return camera


def check_camera(spec: CameraSpec) -> None:
    """Refuse what no camera of a stage can be.

    Raises:
        UsageError: If a number is not finite, or nothing can be seen by it.
    """
    left, bottom, right, top = spec.window
    near, far = spec.clipping_range
    numbers = (*spec.world_to_camera, *spec.window, near, far, spec.exposure, spec.lens_radius)
    is_camera = len(spec.world_to_camera) == 16 and all(map(math.isfinite, numbers))
    if not (is_camera and left < right and bottom < top and near < far and spec.exposure > 0):
        raise UsageError("camera", "a view of nothing", "one with an aperture and a depth")


def _camera_to_world(spec: CameraSpec) -> Gf.Matrix4d:
    view = np.reshape(spec.world_to_camera, (4, 4))
    return Gf.Matrix4d(view.T.tolist()).GetInverse()


def camera_path(name: str) -> Sdf.Path:
    """Where a camera of that name goes.

    Raises:
        UsageError: If it is no name of a prim.
    """
    text = name if name.startswith("/") else f"/{name}"
    path = Sdf.Path(text) if Sdf.Path.IsValidPathString(text) else Sdf.Path()
    is_name = path.IsPrimPath() and not path.ContainsPrimVariantSelection()
    if not is_name or ("/" in name and not name.startswith("/")):
        raise UsageError("camera", repr(name), "a name such as Shot, or a path such as /World/Shot")
    return path


def _free(stage: Usd.Stage, path: Sdf.Path) -> Sdf.Path:
    """The path, with the first number that makes it nobody's."""
    free, number = path, 1
    while stage.GetPrimAtPath(free):
        free, number = path.ReplaceName(f"{path.name}{number}"), number + 1
    return free
