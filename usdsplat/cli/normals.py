"""Author normals, confidence and occlusion of splats, in a layer of their own.

examples:
  usdsplat normals scan.usda -o scan_normals.usda
      normals of all splat fields of a stage
  usdsplat normals shot.usda -o shot_normals.usdc --prim /World/Statue
      only of those at or below this prim

notes:
  The result is a layer of primvars over STAGE, which is not changed: normals (normal3h[]),
  splat:confidence and splat:occlusion (half[]), one value for each splat. Fields with time samples
  get the same samples. A capture is first converted to a stage, with usdsplat convert.
  render's AOVs N, confidence and occlusion show them. Without this layer, they are computed while
  rendering.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from usdsplat.cli import console
from usdsplat.cli.arguments import option, positional
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.cli.stage_options import StageOptions
from usdsplat.core.errors import UsageError
from usdsplat.core.text import shown
from usdsplat.core.wording import counted

if TYPE_CHECKING:
    from usdsplat.products.normals_layer import NormalsReport


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat normals`."""

    stage: Annotated[Path, positional("STAGE")]
    """stage with splat fields"""
    output: Annotated[Path, option("FILE", short="-o")]
    """layer to write, .usda, .usdc or .usd"""
    prim: Annotated[tuple[str, ...], option("/PRIM")] = ()
    """only this field, or those below this prim; may be repeated; default: all"""
    device: Annotated[str, option("NAME")] = "auto"
    """device that computes, auto, cpu or cuda; default: auto, which is the CPU"""
    threads: Annotated[int | None, option("N")] = None
    """number of threads; default: USDSPLAT_THREADS, or all cores"""
    json: Annotated[bool, option()] = False
    """print one JSON object with the result"""
    opening: StageOptions = field(default_factory=StageOptions)
    reporting: ReportingOptions = field(default_factory=ReportingOptions)


def run(options: Options, reporter: Reporter) -> int:
    """Compute normals, write the layer, and print the result."""
    from usdsplat.cli.stages import open_stage
    from usdsplat.interchange.files import check_not_input, check_suffix, layer_files
    from usdsplat.kernels.compiling import compile_time, on_compile
    from usdsplat.kernels.devices import open_device
    from usdsplat.products.normals_layer import write_normals

    if options.output.suffix.lower() == ".usdz":
        raise UsageError("--output", str(options.output), "a .usda, .usdc or .usd layer")
    check_suffix(options.output, packages=False)
    stage = open_stage(options.stage, options.opening, reporter)
    check_not_input(options.output, layer_files(stage))
    reporter.findings.check()
    device = open_device(options.device, threads=options.threads, task="geometry")
    if device.remark:
        reporter.remark(device.remark)
    announce = reporter.announce_compilation("compiling kernels, once; it takes a few seconds")
    with compile_time() as compiled, reporter.progress(compiled) as progress, on_compile(announce):
        report = write_normals(
            stage, options.output, device, prims=options.prim, progress=progress,
            findings=reporter.findings,
        )  # fmt: skip
    if options.json:
        reporter.print_json(asdict(report))
    else:
        console.say(_told(report))
    return 0


def _told(report: NormalsReport) -> str:
    """Return the report as a few lines of text."""
    lines = [f"{shown(report.target)}: normals of {counted(len(report.fields), 'field')}"]
    for each in report.fields:
        samples = f" at {counted(each.samples, 'sample')}" if each.samples else ""
        lines.append(
            f"  {each.path}: {counted(each.splats, 'splat')}{samples}, confidence "
            f"{each.confidence:.2f}, occlusion {each.occlusion:.2f} (medians)"
        )
    return "\n".join(lines)
