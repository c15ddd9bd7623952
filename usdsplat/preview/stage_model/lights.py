"""Add lights to a stage, on the session layer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, UsdLux

from usdsplat.core.cloud import F64
from usdsplat.preview.camera import Vector
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.render.specs import CameraSpec
from usdsplat.schema.stage_values import up_axis

ABOVE_LEFT = (-0.55, 0.7, 0.45)
"""Direction to a key light: right, up and back of the view."""
AWAY = 0.3
"""Distance of its figure from the middle of the view, as a fraction of the camera's."""
SUN = 50_000.0
"""Radiance of a key light, which with `ANGLE` gives an irradiance of about pi: white is white."""
ANGLE = 0.53
"""Diameter of a key light, that of the sun [deg]."""


def add_key_light(edits: Edits, camera: CameraSpec, middle: Vector) -> str:
    """Add a distant light from above left of a view, and return its path.

    Args:
        edits: Edits of the stage.
        camera: The view.
        middle: Middle of the view in the world, near which the light has its figure.
    """
    path = _free(edits, "KeyLight")
    view = np.reshape(camera.world_to_camera, (4, 4))
    eye = np.linalg.inv(view)[:3, 3]
    way: F64 = np.asarray(ABOVE_LEFT) / np.linalg.norm(ABOVE_LEFT) @ view[:3, :3]
    place = np.asarray(middle) + AWAY * float(np.linalg.norm(eye - middle)) * way
    with edits.step("Add a key light", str(path)):
        light = UsdLux.DistantLight.Define(edits.stage, path)
        light.CreateIntensityAttr(SUN)
        light.CreateAngleAttr(ANGLE)
        light.AddTransformOp().Set(_facing(way, place))
    return str(path)


def add_dome_light(edits: Edits, texture: Path | None = None) -> str:
    """Add a dome light around everything, and return its path.

    Args:
        edits: Edits of the stage.
        texture: Picture of the surroundings; None for a uniform sky.
    """
    path = _free(edits, "DomeLight")
    with edits.step("Add a dome light", str(path)):
        light = UsdLux.DomeLight.Define(edits.stage, path)
        light.CreateIntensityAttr(1.0)
        if texture is not None:
            light.CreateTextureFileAttr(Sdf.AssetPath(str(texture)))
            light.CreateTextureFormatAttr(UsdLux.Tokens.latlong)
        if up_axis(edits.stage) == "Z":
            light.AddRotateXOp().Set(90.0)
    return str(path)


def _facing(way: F64, place: F64) -> Gf.Matrix4d:
    """Return the transform of a light at a place that shines against `way`."""
    side = np.cross((0.0, 1.0, 0.0) if abs(way[1]) < 0.9 else (0.0, 0.0, 1.0), way)
    side /= np.linalg.norm(side)
    rows = np.eye(4)  # Gf vectors are rows
    rows[:3, :3] = side, np.cross(way, side), way
    rows[3, :3] = place
    return Gf.Matrix4d(rows.tolist())


def _free(edits: Edits, name: str) -> Sdf.Path:
    """Return a path at the root that is unused."""
    free, number = Sdf.Path(f"/{name}"), 1
    while edits.stage.GetPrimAtPath(free):
        free, number = Sdf.Path(f"/{name}{number}"), number + 1
    return free
