"""A stage that shows a capture: one camera around it, and what to draw of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdRender

from usdsplat.core.output import atomic_path
from usdsplat.delegate.default_camera import Box, frame_subject
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.specs import CameraSpec
from usdsplat.interchange.files import open_stage

FOCAL_LENGTH = 50.0
"""[tenth of a scene unit]; a camera prim says its field of view by this and its aperture."""
CAMERA = "/World/Turntable/Camera"
STILL = (1920, 1080)
MOVING = (640, 360)

_PRODUCTS = {
    "still": (STILL, ("color",)),
    "layers": (STILL, ("color", "depth", "primId", "elementId")),
    "sequence": (MOVING, ("color",)),
}
"""Product -> resolution [pixel] and the sources of its vars, in Hydra's words."""


def author_turntable(target: Path, capture: Path, *, frames: int) -> None:
    """Write a stage in which a camera goes once around a capture.

    Args:
        target: A .usda file, replaced when complete; it refers to `capture` by a relative path.
        capture: A USD file with a default prim, in the same folder, upAxis Y.
        frames: Length of the way around; frame `frames + 1` would be the first again.

    Raises:
        StageError: If `capture` cannot be opened.
        OutputError: If the target cannot be written.
    """
    spec, center = _camera_around(open_stage(capture))
    with atomic_path(target) as path:
        stage = Usd.Stage.CreateNew(str(path))
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        stage.SetStartTimeCode(1)
        stage.SetEndTimeCode(frames)
        stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
        subject = UsdGeom.Xform.Define(stage, "/World/Subject").GetPrim()
        subject.GetReferences().AddReference(f"./{capture.name}")
        _author_camera(stage, spec, center, frames)
        _author_settings(stage)
        stage.GetRootLayer().Save()


def _camera_around(stage: Usd.Stage) -> tuple[CameraSpec, Gf.Vec3d]:
    """A camera that has the subject in the picture all the way around, and what it turns around."""
    with Engine(stage) as engine:
        scene = engine.render_scene
        subject, bounds = scene.subject(), scene.bounds()
    aspect = STILL[0] / STILL[1]
    if subject is None or bounds is None:
        return frame_subject(None, None, up_axis="Y", aspect=aspect), Gf.Vec3d(0)
    middle = (subject[0] + subject[1]) / 2
    spec = frame_subject(
        _swept(subject, middle), _swept(bounds, middle), up_axis="Y", aspect=aspect
    )
    return spec, Gf.Vec3d(*middle)


def _swept(box: Box, axis: np.ndarray) -> Box:
    """The box around what a box sweeps as it turns around the upright axis through a point."""
    low, high = box[0] - axis, box[1] - axis
    reach = np.hypot(*np.maximum(np.abs(low), np.abs(high))[[0, 2]]) / np.sqrt(2)
    corner = np.array([reach, 0.0, reach])
    upright = np.array([0.0, 1.0, 0.0])
    return axis - corner + low * upright, axis + corner + high * upright


def _author_camera(stage: Usd.Stage, spec: CameraSpec, center: Gf.Vec3d, frames: int) -> None:
    """A turntable at `center` that turns once, and on it the camera."""
    turntable = UsdGeom.Xform.Define(stage, Sdf.Path(CAMERA).GetParentPath())
    turntable.AddTranslateOp().Set(center)
    turn = turntable.AddRotateYOp()
    turn.Set(0.0, 1)
    turn.Set(360.0, frames + 1)
    camera = UsdGeom.Camera.Define(stage, CAMERA)
    to_world = Gf.Matrix4d(np.reshape(spec.world_to_camera, (4, 4)).T.tolist()).GetInverse()
    camera.AddTransformOp().Set(to_world * Gf.Matrix4d().SetTranslate(-center))
    left, bottom, right, top = spec.window
    camera.GetFocalLengthAttr().Set(FOCAL_LENGTH)
    camera.GetHorizontalApertureAttr().Set(FOCAL_LENGTH * (right - left))
    camera.GetVerticalApertureAttr().Set(FOCAL_LENGTH * (top - bottom))
    camera.GetClippingRangeAttr().Set(Gf.Vec2f(*spec.clipping_range))


def _author_settings(stage: Usd.Stage) -> None:
    """Render settings with the three products."""
    settings = UsdRender.Settings.Define(stage, "/Render/Settings")
    settings.GetCameraRel().SetTargets([CAMERA])
    settings.GetResolutionAttr().Set(Gf.Vec2i(*STILL))
    stage.SetMetadata("renderSettingsPrimPath", str(settings.GetPath()))
    for name, (resolution, sources) in _PRODUCTS.items():
        product = UsdRender.Product.Define(stage, f"/Render/{name}")
        product.CreateResolutionAttr(Gf.Vec2i(*resolution))
        suffix = "exr" if name == "layers" else "png"
        product.GetProductNameAttr().Set(f"{name}.####.{suffix}")
        for source in sources:
            var = UsdRender.Var.Define(stage, f"/Render/Vars/{source}")
            var.GetSourceNameAttr().Set(source)
            product.GetOrderedVarsRel().AddTarget(var.GetPath())
        settings.GetProductsRel().AddTarget(product.GetPath())
