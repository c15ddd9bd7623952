"""Define the options of `usdsplat relight`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from usdsplat.cli.arguments import flags_of, option, positional
from usdsplat.cli.job_options import JobOptions
from usdsplat.cli.reporting import ReportingOptions
from usdsplat.cli.stage_options import StageOptions
from usdsplat.render.settings import RenderSettings

_Light: Any = flags_of(
    RenderSettings,
    ("ambient", "self_shadows", "shadow_resolution", "light_samples", "dome_samples"),
    about="Light and shadows.",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat relight`."""

    stage: Annotated[Path, positional("STAGE")]
    """stage with splat fields and lights"""
    output: Annotated[Path, option("FILE", short="-o")]
    """layer to write, .usda, .usdc or .usd; missing folders are made"""
    captured_hdri: Annotated[Path | None, option("FILE")] = None
    """latlong picture of the light in which fields were photographed that name no lights"""
    prim: Annotated[tuple[str, ...], option("/PRIM")] = ()
    """only this field, or those below this prim; may be repeated; default: all"""
    frame: Annotated[float | None, option("FRAME")] = None
    """time code at which fields that do not change are lit; default: the stage's first frame"""
    device: Annotated[str, option("NAME")] = "auto"
    """device that computes, auto, cpu or cuda; default: auto"""
    threads: Annotated[int | None, option("N")] = None
    """number of threads; default: USDSPLAT_THREADS, or all cores"""
    part: Annotated[str | None, option("K/N")] = None
    """light only part K, from 1, of N parts of the times, which may be done side by side, for a
    farm; then the command without a part writes the layer"""
    json: Annotated[bool, option()] = False
    """print one JSON object with the result"""
    light: _Light = field(default_factory=_Light)
    opening: StageOptions = field(default_factory=StageOptions)
    job: JobOptions = field(default_factory=JobOptions)
    reporting: ReportingOptions = field(default_factory=ReportingOptions)
