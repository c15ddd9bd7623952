"""Write a stage with a turntable around a capture, and render products for it."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdRender

from usdsplat.core.cloud import F64
from usdsplat.delegate.default_camera import NEAREST
from usdsplat.delegate.engine import Engine
from usdsplat.interchange.files import open_stage
from usdsplat.render.scene import RenderScene, matrix
from usdsplat.render.specs import CameraSpec
from usdsplat.schema.tokens import SETTINGS_API
from usdsplat.schema.usd_files import export_layer

FOCAL_LENGTH = 50.0
"""Focal length of the camera prim [0.1 scene unit]. With the aperture it defines the field of
view."""
CAMERA = "/World/Turntable/Camera"
STILL = (1920, 1080)
MOVING = (640, 360)
"""Resolutions of the products [pixel]."""
MARGIN = 1.05
"""Factor on the distance at which the subject just fits."""
TIPS = 0.25
"""Distance beyond its bounds that still belongs to the subject, as a fraction of its size."""
POINTS, TURNS = 5000, 24
"""Number of splats, and of angles, that are tested to find the camera distance."""

_PRODUCTS = {
    "still": (STILL, ("color",)),
    "layers": (STILL, ("color", "depth", "primId", "elementId")),
    "sequence": (MOVING, ("color",)),
}
"""Product -> resolution [pixel] and the sources of its vars, under Hydra's names."""


def author_turntable(target: Path, capture: Path, *, frames: int) -> None:
    """Write a stage in which a camera goes once around a capture.

    Args:
        target: A .usda file, written when complete. It refers to `capture` by a relative path.
        capture: A USD file with a default prim, in the same folder, upAxis Y.
        frames: Number of frames of a full turn; frame `frames + 1` would equal the first.

    Raises:
        StageError: If `capture` cannot be opened.
        OutputError: If the target cannot be written.
    """
    spec, center = _camera_around(open_stage(capture))
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(frames)
    world = UsdGeom.Xform.Define(stage, "/World").GetPrim()
    Usd.ModelAPI(world).SetKind(Kind.Tokens.group)  # a capture is a component
    stage.SetDefaultPrim(world)
    subject = UsdGeom.Xform.Define(stage, "/World/Subject").GetPath()
    _author_camera(stage, spec, center, frames)
    _author_settings(stage)
    layer = Sdf.Layer.CreateAnonymous(".usda")  # of no stage, which would look for the capture
    layer.TransferContent(stage.GetRootLayer())
    references = layer.GetPrimAtPath(subject).referenceList
    references.prependedItems = [Sdf.Reference(f"./{capture.name}")]
    export_layer(layer, target)


def _camera_around(stage: Usd.Stage) -> tuple[CameraSpec, F64]:
    """Return the nearest camera that sees the whole subject at every turn, and the subject's
    centre."""
    with Engine(stage) as engine:
        scene = engine.render_scene
        spec, subject = engine.view(resolution=STILL).camera, scene.subject()
        points = _some_points(scene)
    if subject is None:
        return spec, np.zeros(3)
    center = (subject[0] + subject[1]) / 2
    # The subject's bounds cut off a few splats on every side, which may be a visible tip.
    reach = (0.5 + TIPS) * (subject[1] - subject[0])
    is_subject = (np.abs(points - center) <= reach).all(axis=1)
    camera = matrix(spec.world_to_camera)
    x, y, z = _swept(points - center, camera[:3, :3])
    _, _, right, top = spec.window
    # A point is inside if |x| <= right (distance - z) and |y - middle| <= top (distance - z).
    ahead = np.tile(is_subject, TURNS)
    above, below = np.max((top * z + y)[ahead]), np.max((top * z - y)[ahead])
    middle = (above - below) / 2
    beside = np.max((z + np.abs(x) / right)[ahead])
    distance = MARGIN * max((above + below) / (2 * top), beside)
    camera[:3, 3] = -camera[:3, :3] @ center - (0.0, middle, distance)
    near = max(0.5 * (distance - z.max()), NEAREST * distance)
    far = 1.1 * (distance - z.min())
    numbers = tuple(camera.ravel().tolist())
    return replace(spec, world_to_camera=numbers, clipping_range=(near, far)), center


def _some_points(scene: RenderScene) -> F64:
    """Return world centres of splats, a few thousand per instance, and the corners of the boxes of
    splat trees, shape (n, 3)."""
    parts = [np.empty((0, 3))]
    for _, field, instance in scene.drawn():
        positions = field.spec.cloud.positions
        positions = positions[:: 1 + len(positions) // POINTS].astype(np.float64)
        to_world = matrix(instance.transform)
        placed = positions @ to_world[:3, :3].T + to_world[:3, 3]
        parts.append(placed[np.isfinite(placed).all(axis=1)])
    for _, tree in scene.drawn_trees():
        box = np.array(list(itertools.product(*zip(*tree.box, strict=True))))
        for instance in tree.instances:
            to_world = matrix(instance.transform)
            placed = box @ to_world[:3, :3].T + to_world[:3, 3]
            parts.append(placed[np.isfinite(placed).all(axis=1)])
    return np.concatenate(parts)


def _swept(points: F64, rotation: F64) -> F64:
    """Return the points at every turn around the up axis, in camera axes, shape (3, TURNS * n)."""
    angles = 2 * np.pi * np.arange(TURNS) / TURNS
    cos, sin, zero, one = np.cos(angles), np.sin(angles), np.zeros(TURNS), np.ones(TURNS)
    turns = np.array([[cos, zero, sin], [zero, one, zero], [-sin, zero, cos]])
    return np.einsum("ij,jkt,nk->itn", rotation, turns, points).reshape(3, -1)


def _author_camera(stage: Usd.Stage, spec: CameraSpec, center: F64, frames: int) -> None:
    """Author a turntable at `center` that turns once, and the camera on it."""
    turntable = UsdGeom.Xform.Define(stage, Sdf.Path(CAMERA).GetParentPath())
    turntable.AddTranslateOp().Set(Gf.Vec3d(*center))
    turn = turntable.AddRotateYOp()
    turn.Set(0.0, 1)
    turn.Set(360.0, frames + 1)
    camera = UsdGeom.Camera.Define(stage, CAMERA)
    to_world = Gf.Matrix4d(np.reshape(spec.world_to_camera, (4, 4)).T.tolist()).GetInverse()
    camera.AddTransformOp().Set(to_world * Gf.Matrix4d().SetTranslate(-Gf.Vec3d(*center)))
    left, bottom, right, top = spec.window
    camera.GetFocalLengthAttr().Set(FOCAL_LENGTH)
    camera.GetHorizontalApertureAttr().Set(FOCAL_LENGTH * (right - left))
    camera.GetVerticalApertureAttr().Set(FOCAL_LENGTH * (top - bottom))
    camera.GetClippingRangeAttr().Set(Gf.Vec2f(*spec.clipping_range))


def _author_settings(stage: Usd.Stage) -> None:
    """Author render settings with the three products."""
    settings = UsdRender.Settings.Define(stage, "/Render/Settings")
    settings.GetCameraRel().SetTargets([CAMERA])
    settings.GetResolutionAttr().Set(Gf.Vec2i(*STILL))
    settings.GetPrim().AddAppliedSchema(SETTINGS_API)
    background = settings.GetPrim().CreateAttribute(
        "splat:background", Sdf.ValueTypeNames.String, custom=False,
        variability=Sdf.VariabilityUniform,
    )  # fmt: skip
    background.Set("grey")  # of the pictures for displays, which people look at first
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
