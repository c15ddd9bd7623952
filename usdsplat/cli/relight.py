"""Author the colours of splats under the lights of a stage, in a layer of their own.

examples:
  usdsplat relight shot.usda -o relit.usdc --captured-hdri set.exr
      all splat fields, which were photographed in the light of set.exr, under the shot's lights
  usdsplat relight shot.usda -o relit.usdc --prim /World/Statue
      only this field; the light of its photographs is estimated from its colours

notes:
  The result is a layer of harmonics over STAGE, which is not changed. All renderers that draw
  splats show it. It is the root of the new stage: to mute it, make it a sublayer. Colours are those
  of render --lighting relit up to the printed error: harmonics in an encoded colour space cannot
  hold all of them.
  Lights in which a field was photographed are named by its relationship splat:lighting:captured.
  For fields without it, name a picture with --captured-hdri, or the light is estimated.
  Author normals first, with usdsplat normals.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from usdsplat.cli import console
from usdsplat.cli.arguments import flags_of, given, option, positional
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.cli.stage_options import StageOptions
from usdsplat.core.errors import UsageError
from usdsplat.core.knobs import checked
from usdsplat.core.text import shown
from usdsplat.core.wording import counted
from usdsplat.render.settings import RenderSettings

if TYPE_CHECKING:
    from usdsplat.products.relighting import RelightReport


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
    """layer to write, .usda, .usdc or .usd"""
    captured_hdri: Annotated[Path | None, option("FILE")] = None
    """latlong picture of the light in which fields were photographed that name no lights"""
    prim: Annotated[tuple[str, ...], option("/PRIM")] = ()
    """only this field, or those below this prim; may be repeated; default: all"""
    frame: Annotated[float | None, option("FRAME")] = None
    """time code at which fields that do not change are lit; default: the stage's first frame"""
    device: Annotated[str, option("NAME")] = "auto"
    """device that computes, auto, cpu or cuda; default: auto"""
    threads: Annotated[int | None, option("N")] = None
    """number of threads; default: all cores"""
    json: Annotated[bool, option()] = False
    """print one JSON object with the result"""
    light: _Light = field(default_factory=_Light)
    opening: StageOptions = field(default_factory=StageOptions)
    reporting: ReportingOptions = field(default_factory=ReportingOptions)


def run(options: Options, reporter: Reporter) -> int:
    """Relight the splats, write the layer, and print the result."""
    from usdsplat.cli.stages import open_stage
    from usdsplat.cli.values import time_code
    from usdsplat.interchange.files import check_not_input, check_suffix, layer_files
    from usdsplat.kernels.compiling import compile_time, on_compile
    from usdsplat.kernels.devices import open_device
    from usdsplat.products.relighting import RelightRequest, write_relit

    if options.output.suffix.lower() == ".usdz":
        raise UsageError("--output", str(options.output), "a .usda, .usdc or .usd layer")
    check_suffix(options.output)
    settings = checked("render settings", RenderSettings, given(options.light))
    request = RelightRequest(
        prims=options.prim, captured_hdri=options.captured_hdri, time=time_code(options.frame)
    )
    stage = open_stage(options.stage, options.opening, reporter)
    check_not_input(options.output, layer_files(stage))
    reporter.findings.check()
    device = open_device(options.device, threads=options.threads)
    if device.remark:
        reporter.remark(device.remark)
    announce = reporter.announce_compilation("compiling kernels, once; it takes half a minute")
    with compile_time() as compiled, reporter.progress(compiled) as progress, on_compile(announce):
        report = write_relit(
            stage, options.output, device, settings, request, progress=progress,
            findings=reporter.findings,
        )  # fmt: skip
    if options.json:
        reporter.print_json(asdict(report))
    else:
        console.say(_told(report))
    return 0


def _told(report: RelightReport) -> str:
    """Return the report as a few lines of text."""
    lines = [f"{shown(report.target)}: {counted(len(report.fields), 'field')}"]
    for each in report.fields:
        samples = f" at {counted(each.samples, 'sample')}" if each.samples else ""
        light = ""
        if each.residual is not None:
            light = f"; estimated light, which leaves {100 * each.residual:.0f} % of the variation"
        lines.append(
            f"  {each.path}: {counted(each.splats, 'splat')}{samples}, error of the fit "
            f"{each.error:.2g}, at most {each.worst:.2g}{light}"
        )
    return "\n".join(lines)
