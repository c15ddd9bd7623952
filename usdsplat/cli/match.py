"""Grade the splats of a stage until they look like a plate, or like a colour chart.

examples:
  usdsplat match shot.usda -o graded.usda --reference plate.exr --camera /World/Cam
      as the plate that this camera took of the same place
  usdsplat match shot.usda -o graded.usda --reference plate.exr --fit exposure,whiteBalance
      the same without a matrix
  usdsplat match scan.usda -o graded.usda --chart classic24 --patches chart.json --camera /Cam
      by a colour chart that was captured with the rest, where the camera sees it

notes:
  The result is a new layer of grades (SplatGradeAPI) over STAGE, which stays as it is. It takes the
  place of grades that the fields have already.
  Patches are regions of pixels of the camera's picture, x0,y0,x1,y1 with semicolons between, in the
  order of the chart; a file has a JSON list of them, null for one that cannot be seen, or an object
  with the chart's own names for keys.
  A matrix is left at identity where the colours are too few or too alike to tell one.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from usdsplat.cli import console
from usdsplat.cli.arguments import option, positional
from usdsplat.cli.stage_options import StageOptions
from usdsplat.cli.values import resolution_of, time_code
from usdsplat.core.errors import UsageError
from usdsplat.core.wording import counted

if TYPE_CHECKING:
    from usdsplat.products.matching import MatchReport


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat match`."""

    stage: Annotated[Path, positional("STAGE")]
    """stage with the splats to grade"""
    output: Annotated[Path, option("FILE", short="-o")]
    """layer to write, .usda, .usdc or .usd"""
    reference: Annotated[Path | None, option("PICTURE")] = None
    """plate of the same view; its size is that of the picture it is compared with"""
    reference_space: Annotated[str | None, option("SPACE")] = None
    """space of the plate's colours, such as lin_ap1_scene; default: what the file says"""
    chart: Annotated[str | None, option("NAME")] = None
    """chart to match instead of a plate, such as classic24"""
    patches: Annotated[str | None, option("REGIONS|FILE")] = None
    """where the chart's patches are"""
    camera: Annotated[str | None, option("CAMERA")] = None
    """path or name; default: the stage's only one"""
    resolution: Annotated[str | None, option("WIDTHxHEIGHT")] = None
    """of the picture in which the patches are; default: 1920x1080"""
    prim: Annotated[tuple[str, ...], option("/PRIM")] = ()
    """grade only this field, or those beneath this prim; may be repeated; default: all that show"""
    fit: Annotated[str, option("PARTS")] = "exposure,whiteBalance,matrix"
    """what may change, commas between; default: exposure,whiteBalance,matrix"""
    frame: Annotated[float | None, option("FRAME")] = None
    """time code of the picture; default: the stage's first"""
    device: Annotated[str, option("NAME")] = "auto"
    """what draws, auto, cpu or cuda; default: auto, the fastest here"""
    threads: Annotated[int | None, option("N")] = None
    """how many to use; default: all"""
    json: Annotated[bool, option()] = False
    """print one JSON object about what was found"""
    opening: StageOptions = field(default_factory=StageOptions)


def run(options: Options) -> int:
    """Fit, write the layer, print what was found."""
    from usdsplat.cli.stages import open_stage
    from usdsplat.delegate.engine import Engine
    from usdsplat.interchange.files import check_not_input, check_suffix, layer_files
    from usdsplat.kernels.compiling import on_compile
    from usdsplat.products.matching import MatchRequest, match

    _check_flags(options)
    check_suffix(options.output)
    time = time_code(options.frame)
    keep = (options.camera,) if options.camera and options.camera[0] == "/" else ()
    stage = open_stage(options.stage, options.opening, keep=keep)
    check_not_input(options.output, layer_files(stage))
    if time is None and stage.HasAuthoredTimeCodeRange():
        time = stage.GetStartTimeCode()
    with (
        on_compile(console.announce_compilation()),
        Engine(stage, device=options.device, threads=options.threads, time=time) as engine,
    ):
        for warning in engine.warnings:
            console.remark(warning)
        report = match(
            engine,
            stage,
            MatchRequest(
                target=options.output,
                camera=options.camera,
                prims=options.prim,
                parts=tuple(part.strip() for part in options.fit.split(",")),
                reference=options.reference,
                reference_space=options.reference_space,
                chart=options.chart,
                patches=options.patches,
                resolution=resolution_of(options.resolution) or (1920, 1080),
            ),
        )
    if options.json:
        console.print_json(asdict(report))
    else:
        print(_told(report))
    return 0


def _check_flags(options: Options) -> None:
    """Refuse what does not go together."""
    if (options.reference is None) == (options.chart is None):
        found = "neither --reference nor --chart" if options.chart is None else "both"
        raise UsageError("match", found, "--reference PICTURE or --chart NAME")
    if (options.chart is None) != (options.patches is None):
        found = "no --patches" if options.patches is None else "no --chart"
        raise UsageError("match", found, "--chart and --patches together")
    if options.reference is None and options.reference_space is not None:
        raise UsageError("--reference-space", "no --reference", "one")
    if options.reference is not None and options.resolution is not None:
        raise UsageError("--resolution", "a --reference, which has a size", "only one of them")
    if options.output.suffix.lower() == ".usdz":
        raise UsageError("--output", str(options.output), "a .usda, .usdc or .usd layer")


def _told(report: MatchReport) -> str:
    """The report for people, a few lines."""
    before, after = report.delta_e["before"], report.delta_e["after"]
    samples = f"{report.used} of {report.samples} {report.kind}"
    lines = [
        f"{report.target}: {counted(len(report.prim_paths), 'field')} graded by {samples}",
        *(f"  prim         {path}" for path in report.prim_paths),
        f"  exposure     {report.exposure:+.3f} stops",
        f"  temperature  {report.temperature:.0f} K",
        f"  tint         {report.tint:+.4f} Duv",
        "  matrix       " + "; ".join(" ".join(f"{n:.4f}" for n in row) for row in report.matrix),
        f"  ΔE2000       {before['mean']:.2f} mean, {before['median']:.2f} median before; "
        f"{after['mean']:.2f} mean, {after['median']:.2f} median after",
    ]
    return "\n".join([*lines, *(f"  note         {note}" for note in report.notes)])
