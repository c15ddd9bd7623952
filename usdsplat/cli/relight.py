"""Author the colours of splats under the lights of a stage, in a layer of their own.

examples:
  usdsplat relight shot.usda -o relit.usdc --captured-hdri set.exr
      all splat fields, which were photographed in the light of set.exr, under the shot's lights
  usdsplat relight shot.usda -o relit.usdc --prim /World/Statue
      only this field; the light of its photographs is estimated from its colours
  usdsplat relight shot.usda -o relit.usdc --jobs 2
      fields with time samples by two processes of this machine; --dask tcp://host:8786 uses a
      cluster, and --openjd FOLDER writes a bundle for a farm

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

from contextlib import contextmanager
from dataclasses import asdict
from functools import cache
from typing import TYPE_CHECKING

from usdsplat.cli import console
from usdsplat.cli.arguments import given
from usdsplat.cli.job_options import check_jobs
from usdsplat.cli.relight_job import CUDA, check_job, run_tasks, runner_of, write_bundle
from usdsplat.cli.relight_options import Options
from usdsplat.cli.reporting import Reporter
from usdsplat.cli.values import time_code
from usdsplat.core.errors import StageError, StrictError, UsageError
from usdsplat.core.folders import made_folder
from usdsplat.core.knobs import checked
from usdsplat.core.part import Part
from usdsplat.core.text import shown
from usdsplat.core.wording import counted
from usdsplat.render.settings import RenderSettings

if TYPE_CHECKING:
    from collections.abc import Iterator

    from usdsplat.core.progress import Progress
    from usdsplat.kernels.device import Device
    from usdsplat.products.lit_times import LitFolder
    from usdsplat.products.relighting import Relighting, RelightReport

__all__ = ["Options", "run"]

FORKS = True


def run(options: Options, reporter: Reporter) -> int:
    """Relight the splats, or at a part of the times, and print the result."""
    from usdsplat.interchange.files import check_suffix
    from usdsplat.products.lit_times import folder_of

    if options.output.suffix.lower() == ".usdz":
        raise UsageError("--output", str(options.output), "a .usda, .usdc or .usd layer")
    check_suffix(options.output, packages=False)
    settings = checked("render settings", RenderSettings, given(options.light))
    part = None if options.part is None else Part.parse(options.part)
    check_jobs(options.job)
    check_job(options)
    if options.job.is_asked:
        return _run_as_job(options, settings, reporter)
    work, device = _prepared(options, settings, reporter)
    if part is not None:
        return _light(options, work, part, work.folder(options.output, device), reporter)
    is_begun = folder_of(options.output).is_dir()
    folder = work.folder(options.output, device) if is_begun else None
    return _write(options, work, folder, reporter)


def _run_as_job(options: Options, settings: RenderSettings, reporter: Reporter) -> int:
    """Light the stage by tasks, and write the layer here; or write a bundle for a farm."""
    if options.job.openjd is not None:
        work, device = _prepared(options, settings, reporter)
        return write_bundle(options, work, options.job.openjd, reporter, device=device)
    folder: LitFolder | None = None
    with made_folder(options.output.parent):
        try:
            with runner_of(options, reporter) as runner:
                work, device = _prepared(options, settings, reporter)
                folder = work.folder(options.output, device)
                messages = run_tasks(options, work, folder, runner, reporter, device=device)
            status = _write(options, work, folder, reporter)
        except (StageError, StrictError):  # another stage or another command will be lit anew
            if folder is not None:
                folder.remove()
            raise
    reporter.findings.extend(messages)
    return status


def _prepared(
    options: Options, settings: RenderSettings, reporter: Reporter
) -> tuple[Relighting, str]:
    """Open the stage, and return the work and the name of the device.

    With --device cuda, the GPU is opened when something is lit: tasks may do that elsewhere.
    """
    from usdsplat.cli.stages import open_stage
    from usdsplat.interchange.files import check_not_input, layer_files
    from usdsplat.kernels.devices import open_device
    from usdsplat.products.relighting import Relighting, RelightRequest

    @cache
    def opened() -> Device:
        device = open_device(options.device, threads=options.threads)
        if device.remark:
            reporter.remark(device.remark)
        return device

    stage = open_stage(options.stage, options.opening, reporter)
    check_not_input(options.output, layer_files(stage))
    reporter.findings.check()
    request = RelightRequest(
        prims=options.prim, captured_hdri=options.captured_hdri, time=time_code(options.frame)
    )
    work = Relighting(stage, settings, request, opened, findings=reporter.findings)
    return work, CUDA if options.device == CUDA else opened().name


def _light(
    options: Options, work: Relighting, part: Part, folder: LitFolder, reporter: Reporter
) -> int:
    """Light a part of the times, for a later command that writes the layer."""
    with _computing(reporter) as progress:
        count = work.light(part, folder, progress=progress)
    if options.json:
        reporter.print_json({"folder": str(folder.path), "times": count})
    else:
        console.say(f"{shown(str(folder.path))}: part {part}, {counted(count, 'time')}")
    return 0


def _write(options: Options, work: Relighting, folder: LitFolder | None, reporter: Reporter) -> int:
    """Write the layer, and light what is not in the folder."""
    with made_folder(options.output.parent), _computing(reporter) as progress:
        report = work.write(options.output, folder, progress=progress)
    if options.json:
        reporter.print_json(asdict(report))
    else:
        console.say(_told(report))
    return 0


@contextmanager
def _computing(reporter: Reporter) -> Iterator[Progress]:
    """Report progress, and kernels that are compiled, in a context."""
    from usdsplat.kernels.compiling import compile_time, on_compile

    announce = reporter.announce_compilation("compiling kernels, once; it takes half a minute")
    with compile_time() as compiled, reporter.progress(compiled) as progress, on_compile(announce):
        yield progress


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
