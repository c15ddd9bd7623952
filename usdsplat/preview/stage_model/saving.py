"""Write the user's edits of a stage to files, never over the stage's own files."""

from __future__ import annotations

import os
from pathlib import Path

from pxr import Sdf, Usd, UsdGeom

from usdsplat.core.errors import StageError
from usdsplat.core.readable import check_referable
from usdsplat.interchange.files import check_not_input, check_suffix, layer_files, save
from usdsplat.preview.stage_model.cameras import author_camera, camera_path, check_camera
from usdsplat.render.specs import CameraSpec
from usdsplat.schema.stage_values import stage_unit, up_axis

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
    """Write the user's edits as a layer, without what a running simulation made.

    Args:
        stage: The stage; it is not changed.
        target: File to write, replacing an older one.
        over_stage: Whether the stage becomes a sublayer, so that the file shows all of it; else the
            file is meant to be stacked over the stage.

    Raises:
        UnknownFormatError: If the suffix is not a USD suffix.
        OutputError: If it cannot be written, or is a file of the stage.
        StageError: If the stage has no file and would have to be a sublayer.
    """
    _check(stage, target)
    root = stage.GetRootLayer()
    if over_stage and not root.realPath:
        raise StageError(
            str(target), "a stage without a file", "a stage that was opened from a file"
        )
    layer = user_edits(stage)
    if over_stage:
        _copy_frame(root, layer)
        layer.subLayerPaths.append(_from(target, root.realPath))
    save(layer, target)


def user_edits(stage: Usd.Stage) -> Sdf.Layer:
    """Return a copy of the session layer without what a running simulation made."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.TransferContent(stage.GetSessionLayer())
    for number in reversed(range(len(layer.subLayerPaths))):
        if Sdf.Layer.IsAnonymousLayerIdentifier(layer.subLayerPaths[number]):
            del layer.subLayerPaths[number]
    return layer


def is_without_edits(stage: Usd.Stage) -> bool:
    """Return whether the user's edits say nothing of any prim, and bring in no layer."""
    layer = user_edits(stage)
    return not layer.rootPrims and not layer.subLayerPaths


def save_camera_layer(
    stage: Usd.Stage, spec: CameraSpec, target: Path, *, name: str = "Camera"
) -> str:
    """Write a layer with only a camera, to stack over the stage, and return the camera's path.

    Args:
        stage: Source of up axis and unit; it is not changed.
        spec: The view, such as `Picture.camera`.
        target: File to write, replacing an older one.
        name: Name of the prim, a root of the layer.

    Raises:
        UsageError: If `name` is not a valid prim name, or `spec` is not a camera.
        UnknownFormatError: If the suffix is not a USD suffix.
        OutputError: If it cannot be written, or is a file of the stage.
    """
    _check(stage, target)
    check_camera(spec)
    path = camera_path(name)
    alone = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(alone, up_axis(stage))
    UsdGeom.SetStageMetersPerUnit(alone, stage_unit(stage))
    author_camera(alone, path, spec)
    save(alone.GetRootLayer(), target)
    return str(path)


def _check(stage: Usd.Stage, target: Path) -> None:
    check_suffix(target)
    check_not_input(target, layer_files(stage))


def _copy_frame(source: Sdf.Layer, target: Sdf.Layer) -> None:
    """Copy the stage's metadata about coordinates, times and start to a layer."""
    root, ours = source.pseudoRoot, target.pseudoRoot
    for key in _FRAME:
        if root.HasInfo(key) and not ours.HasInfo(key):
            ours.SetInfo(key, root.GetInfo(key))


def _from(target: Path, path: str) -> str:
    """Return a file's path relative to the target's folder, so that both can be moved together.

    Raises:
        StageError: If a layer cannot refer to a file of this name.
    """
    folder = target.resolve().parent
    check_referable(path, folder)
    try:
        relative = Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # another drive
        return path
    return relative if relative.startswith("../") else f"./{relative}"
