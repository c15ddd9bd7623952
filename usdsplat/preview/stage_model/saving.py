"""What a user made of a stage, written to files of its own; never over those of the stage."""

from __future__ import annotations

import os
from pathlib import Path

from pxr import Sdf, Usd, UsdGeom

from usdsplat.core.errors import StageError
from usdsplat.interchange.files import check_not_input, check_suffix, layer_files, save
from usdsplat.preview.stage_model.cameras import author_camera, camera_path, check_camera
from usdsplat.render.specs import CameraSpec

_FRAME = (
    "upAxis",
    "metersPerUnit",
    "timeCodesPerSecond",
    "framesPerSecond",
    "startTimeCode",
    "endTimeCode",
    "defaultPrim",
)


def save_session(stage: Usd.Stage, target: Path, *, over_stage: bool = False) -> None:
    """Write the user's edits as a layer; what a running simulation made stays out.

    Args:
        stage: Is not changed.
        target: An older file there is replaced.
        over_stage: Whether the stage is made a sublayer, so that the file shows all of it; else the
            file is to be stacked over it.

    Raises:
        UnknownFormatError: If the suffix is none of USD's.
        OutputError: If it cannot be written, or the stage is made of that file.
        StageError: If the stage has no file and should be a sublayer.
    """
    _check(stage, target)
    root = stage.GetRootLayer()
    if over_stage and not root.realPath:
        raise StageError(str(target), "edits of a stage without a file", "a stage that is a file")
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.TransferContent(stage.GetSessionLayer())
    for number in reversed(range(len(layer.subLayerPaths))):
        if Sdf.Layer.IsAnonymousLayerIdentifier(layer.subLayerPaths[number]):
            del layer.subLayerPaths[number]
    if over_stage:
        _copy_frame(root, layer)
        layer.subLayerPaths.append(_from(target, root.realPath))
    save(layer, target)


def save_camera_layer(
    stage: Usd.Stage, spec: CameraSpec, target: Path, *, name: str = "Camera"
) -> str:
    """Write a layer with nothing but a camera, to stack over the stage; returns its path there.

    Args:
        stage: Says its up axis and its unit; is not changed.
        spec: Such as `Picture.camera`.
        target: An older file there is replaced.
        name: Of the prim, a root of the layer.

    Raises:
        UsageError: If `name` is no name of a prim, or `spec` is no camera.
        UnknownFormatError: If the suffix is none of USD's.
        OutputError: If it cannot be written, or the stage is made of that file.
    """
    _check(stage, target)
    check_camera(spec)
    path = camera_path(name)
    alone = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(alone, UsdGeom.GetStageUpAxis(stage))
    UsdGeom.SetStageMetersPerUnit(alone, UsdGeom.GetStageMetersPerUnit(stage))
    author_camera(alone, path, spec)
    save(alone.GetRootLayer(), target)
    return str(path)


def _check(stage: Usd.Stage, target: Path) -> None:
    check_suffix(target)
    check_not_input(target, layer_files(stage))


def _copy_frame(source: Sdf.Layer, target: Sdf.Layer) -> None:
    """Let a layer say what its stage's coordinates and times mean, and where it begins."""
    root, ours = source.pseudoRoot, target.pseudoRoot
    for key in _FRAME:
        if root.HasInfo(key) and not ours.HasInfo(key):
            ours.SetInfo(key, root.GetInfo(key))


def _from(target: Path, path: str) -> str:
    """How the target calls a file: from its own folder, so that both can be moved together."""
    try:
        relative = Path(os.path.relpath(path, target.resolve().parent)).as_posix()
    except ValueError:  # another drive
        return path
    return relative if relative.startswith("../") else f"./{relative}"
