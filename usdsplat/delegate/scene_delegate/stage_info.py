"""Read the values of a stage that headers of pictures contain."""

from __future__ import annotations

from pxr import Usd, UsdGeom

from usdsplat.delegate.stage_info import StageInfo
from usdsplat.schema.value_clips import clip_files


def read_stage_info(stage: Usd.Stage, *, prims: tuple[str, ...]) -> StageInfo:
    """Return the rates, the unit and the files of a stage, and its drawable prims as given."""
    session = stage.GetSessionLayer()
    # Without clips, which are used layers only once something was read from them.
    layers = [layer for layer in stage.GetUsedLayers(False) if layer != session]
    is_saved = all(layer.realPath and not layer.dirty for layer in layers)
    return StageInfo(
        frames_per_second=stage.GetFramesPerSecond(),
        time_codes_per_second=stage.GetTimeCodesPerSecond(),
        start=stage.GetStartTimeCode() if stage.HasAuthoredTimeCodeRange() else 0.0,
        meters_per_unit=UsdGeom.GetStageMetersPerUnit(stage),
        files=tuple(sorted({_file(layer.realPath) for layer in layers})) if is_saved else (),
        clips=tuple(sorted(set(map(_file, clip_files(stage))))),
        prims=prims,
    )


def _file(path: str) -> str:
    """Return the file of a layer: for a layer inside a package, the outermost package."""
    return path.split("[", 1)[0]
