"""Read the values of a stage that headers of pictures contain."""

from __future__ import annotations

from collections.abc import Iterable

from pxr import Usd

from usdsplat.delegate.instancing import Placement
from usdsplat.delegate.scene_delegate.light_groups import light_aovs
from usdsplat.delegate.stage_info import StageInfo
from usdsplat.schema.stage_values import stage_unit
from usdsplat.schema.value_clips import clip_files, file_of, layers_without_clips


def first_frame(stage: Usd.Stage) -> float | None:
    """Return the first frame of the stage's range; None, the default time, without a range."""
    return stage.GetStartTimeCode() if stage.HasAuthoredTimeCodeRange() else None


def read_stage_info(
    stage: Usd.Stage,
    placed: Iterable[Placement],
    lights: Iterable[Usd.Prim],
    clipped: Iterable[Usd.Prim],
) -> StageInfo:
    """Return the rates, the unit and the files of a stage, and the names of what can be drawn.

    Args:
        stage: The stage.
        placed: Placements of all prims that can be drawn.
        lights: All lights.
        clipped: All prims with value clips.
    """
    prims = {each.path: each.asset or each.path for each in placed}
    session = stage.GetSessionLayer()
    layers = [layer for layer in layers_without_clips(stage) if layer != session]
    is_saved = all(layer.realPath and not layer.dirty for layer in layers)
    return StageInfo(
        frames_per_second=stage.GetFramesPerSecond(),
        time_codes_per_second=stage.GetTimeCodesPerSecond(),
        start=stage.GetStartTimeCode() if stage.HasAuthoredTimeCodeRange() else 0.0,
        meters_per_unit=stage_unit(stage),
        files=tuple(sorted({file_of(layer.realPath) for layer in layers})) if is_saved else (),
        clips=tuple(sorted(clip_files(clipped))),
        prims=tuple(sorted(prims)),
        lights=light_aovs(lights),
        assets=tuple(sorted(set(prims.values()))),
    )
