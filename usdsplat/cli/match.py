"""Grade the splats of a stage to match a plate or a colour chart.

examples:
  usdsplat match shot.usda -o graded.usda --reference plate.exr --camera /World/Cam
      match a plate of the same place with the same view as this camera
  usdsplat match shot.usda -o graded.usda --reference plate.exr --fit exposure,whiteBalance
      the same without a matrix
  usdsplat match scan.usda -o graded.usda --chart classic24 --patches chart.json --camera /Cam
      match a colour chart that is part of the capture and visible to the camera

notes:
  The result is a new layer of grades (SplatGradeAPI) over STAGE, which is not changed. The new
  grades replace existing grades of the fields.
  Patches are pixel regions of the camera's picture, x0,y0,x1,y1 separated by semicolons, in the
  order of the chart. Alternatively a JSON file has a list of them, with null for a hidden patch, or
  an object with the chart's patch names as keys.
  The matrix remains the identity if the colours are too few or too similar to determine it.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from usdsplat.cli import console
from usdsplat.cli.arguments import option, positional
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.cli.stage_options import StageOptions
from usdsplat.cli.values import resolution_of, time_code
from usdsplat.core.errors import UsageError
from usdsplat.core.text import shown
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
    """plate of the same view; the stage is rendered at its size"""
    reference_space: Annotated[str | None, option("SPACE")] = None
    """colour space of the plate, such as lin_ap1_scene; default: as stated in the file"""
    chart: Annotated[str | None, option("NAME")] = None
    """chart to match instead of a plate, such as classic24"""
    patches: Annotated[str | None, option("REGIONS|FILE")] = None
    """pixel regions of the chart's patches"""
    camera: Annotated[str | None, option("CAMERA")] = None
    """path or name; default: the stage's only one"""
    resolution: Annotated[str | None, option("WIDTHxHEIGHT")] = None
    """size of the picture that contains the patches; default: 1920x1080"""
    prim: Annotated[tuple[str, ...], option("/PRIM")] = ()
    """grade only this field, or those below this prim; may be repeated; default: all visible"""
    fit: Annotated[str, option("PARTS")] = "exposure,whiteBalance,matrix"
    """parts of the grade to fit, separated by commas; default: exposure,whiteBalance,matrix"""
    frame: Annotated[float | None, option("FRAME")] = None
    """time code of the picture; default: the stage's first"""
    device: Annotated[str, option("NAME")] = "auto"
    """device that renders, auto, cpu or cuda; default: auto, the one that finishes first"""
    threads: Annotated[int | None, option("N")] = None
    """number of threads; default: USDSPLAT_THREADS, or all cores"""
    json: Annotated[bool, option()] = False
    """print one JSON object with the result"""
    opening: StageOptions = field(default_factory=StageOptions)
    reporting: ReportingOptions = field(default_factory=ReportingOptions)


def run(options: Options, reporter: Reporter) -> int:
    """Fit a grade, write the layer, and print the result."""
    from usdsplat.cli.stages import open_stage
    from usdsplat.delegate.engine import Engine
    from usdsplat.interchange.files import check_not_input, check_suffix, layer_files
    from usdsplat.kernels.compiling import on_compile
    from usdsplat.products.matching import MatchRequest, match

    _check_flags(options)
    check_suffix(options.output, packages=False)
    time = time_code(options.frame)
    keep = (options.camera,) if options.camera and options.camera[0] == "/" else ()
    stage = open_stage(options.stage, options.opening, reporter, keep=keep)
    check_not_input(options.output, layer_files(stage))
    if time is None and stage.HasAuthoredTimeCodeRange():
        time = stage.GetStartTimeCode()
    with (
        on_compile(reporter.announce_compilation()),
        Engine(stage, device=options.device, threads=options.threads, time=time) as engine,
    ):
        if engine.remark:
            reporter.remark(engine.remark)
        reporter.findings.extend(engine.findings)
        reporter.findings.check()
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
    reporter.findings.extend(report.findings)
    if options.json:
        reporter.print_json(asdict(report))
    else:
        console.say(_told(report))
    return 0


def _check_flags(options: Options) -> None:
    """Raise an error for flags that contradict each other."""
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


_SOURCES = {
    "given": "as given",
    "file": "as the file states",
    "format": "as usual for its format",
    "assumed": "assumed, because the file names none",
    "": "",
}
"""Where the colour space of the reference is from -> text."""


def _told(report: MatchReport) -> str:
    """Return the report as a few lines of text."""
    before, after = report.delta_e["before"], report.delta_e["after"]
    plate = f"{report.reference_space}, {_SOURCES[report.reference_space_source]}"
    samples = f"{report.used} of {report.samples} {report.kind}"
    lines = [
        f"{shown(report.target)}: {counted(len(report.prim_paths), 'field')} graded by {samples}",
        *(f"  prim         {path}" for path in report.prim_paths),
        *([f"  plate        {plate}"] if report.reference_space else []),
        f"  exposure     {report.exposure:+.3f} stops",
        f"  temperature  {report.temperature:.0f} K",
        f"  tint         {report.tint:+.4f} Duv",
        "  matrix       " + "; ".join(" ".join(f"{n:.4f}" for n in row) for row in report.matrix),
        f"  ΔE2000       {before['mean']:.2f} mean, {before['median']:.2f} median before; "
        f"{after['mean']:.2f} mean, {after['median']:.2f} median after",
    ]
    return "\n".join([*lines, *(f"  note         {note}" for note in report.notes)])
