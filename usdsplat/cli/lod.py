"""Build a splat tree of captures and stages of any size, with levels of detail.

examples:
  usdsplat lod scan.ply -o scan.usda
      a tree of one capture: scan.usda, and the splats in layers in the folder scan_chunks
  usdsplat lod city_*.ply -o city.usda --memory-limit 2G
      many captures in one tree, merged in the coordinates of the first
  usdsplat lod shot.usd streamed/lod-meta.json -o all.usda
      the visible fields and trees of a stage, in world space, and the finest level of a streamed
      SOG with its environment
  usdsplat lod city_*.ply -o city.usda --jobs 2
      with two processes of this machine; --dask tcp://host:8786 uses a cluster, and --openjd FOLDER
      writes a bundle for a farm
  usdsplat lod scan.ply -o scan.usda --pixel 0.002
      with the size of a pixel of the photographs, if it is known

notes:
  The leaves of a tree hold the splats of its inputs. Its other nodes hold fewer and larger splats,
  which stand for them. Beside the tree are coarse fields of USD's own type, for renderers that do
  not draw trees. See docs/levels_of_detail.md.
  Captures that do not state their axes share those that most of their splats suggest.
  Inputs are never changed. The tree appears when it is complete. If the command is interrupted or
  killed, the same command continues; until then, the hidden folder .NAME.building is beside OUT.
  Grades and crops of a stage are not applied, which is a finding.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import TYPE_CHECKING

from usdsplat.cli import console
from usdsplat.cli.job_options import check_jobs, resumed
from usdsplat.cli.lod_job import run_parts, write_bundle
from usdsplat.cli.lod_options import Options
from usdsplat.cli.reporting import Reporter
from usdsplat.cli.values import bytes_of, time_code
from usdsplat.core import interrupt
from usdsplat.core.errors import UsageError
from usdsplat.core.folders import made_folder
from usdsplat.core.text import shown
from usdsplat.core.wording import counted, said_bytes

if TYPE_CHECKING:
    from collections.abc import Iterable

    from usdsplat.core.findings import Finding
    from usdsplat.interchange.lod import LodOptions, LodReport

FORKS = True


def run(options: Options, reporter: Reporter) -> int:
    """Build the tree, or a part of it, and print a report."""
    from usdsplat.interchange.lod import TreeStep, build_tree, inspect, take_step
    from usdsplat.kernels.compiling import on_compile

    if options.output is None:
        raise UsageError("lod", "no -o OUT", "one; see 'usdsplat lod --help'")
    _check_inputs(options)
    check_jobs(options.job, frameless="lod")
    if options.part is not None and options.step is None:
        raise UsageError("--part", f"{options.part} without --step", "--step sort or build")
    if options.step is not None and options.job.is_asked:
        raise UsageError("--step", "it with --jobs, --dask or --openjd", "one of them")
    if options.job.openjd is not None:
        found = inspect(options.sources, options=_lod_options(options))
        reporter.findings.extend(found)
        return write_bundle(options, options.job.openjd, reporter)
    if options.job.is_asked:
        run_parts(options, _lod_options(options), options.output, reporter)

    def checked(findings: Iterable[Finding]) -> None:
        reporter.findings.extend(findings)
        reporter.findings.check()

    with (
        interrupt.advising(f"go on with: {resumed(reporter.arguments)}"),
        made_folder(options.output.parent),
        on_compile(reporter.announce_compilation(_COMPILING)),
        reporter.progress() as progress,
    ):
        if options.step is not None:
            step, made = TreeStep.parse(options.step, options.part), _lod_options(options)
            take_step(options.sources, options.output, step, options=made, progress=progress)
            if options.json:
                reporter.print_json({})
            return 0
        report = build_tree(
            options.sources,
            options.output,
            options=_lod_options(options),
            found=checked,
            progress=progress,
        )
    if options.job.is_asked:
        report = replace(report, continued=False)  # its own tasks were
    if options.json:
        reporter.print_json(asdict(report))
    else:
        console.say(_told(report))
    return 0


def _lod_options(options: Options) -> LodOptions:
    """Return the options of the building."""
    from usdsplat.interchange.lod import LodOptions
    from usdsplat.interchange.lod.options import LEAF_SPLATS, MEMORY

    return LodOptions(
        axes=options.axes,
        up_axis=options.up_axis,
        meters_per_unit=options.meters_per_unit,
        time=time_code(options.frame),
        sh_degree=options.sh_degree,
        leaf_splats=LEAF_SPLATS if options.leaf_splats is None else options.leaf_splats,
        pixel=options.pixel,
        memory_limit=bytes_of(options.memory_limit) or MEMORY,
    )


def _check_inputs(options: Options) -> None:
    """Raise an error for a flag that has no effect on any input.

    Raises:
        UsageError: If there is such a flag.
    """
    from usdsplat.interchange.files import is_usd

    are_stages = {is_usd(path) for path in options.sources}
    if options.frame is not None and True not in are_stages:
        raise UsageError("--frame", "it with captures only", "a stage among the inputs")
    if options.axes is not None and False not in are_stages:
        raise UsageError("--axes", "it with stages only", "a capture among the inputs")


_COMPILING = "compiling kernels, once; it takes up to half a minute"


def _told(report: LodReport) -> str:
    """Return the report as a few lines of text."""
    lines = [
        f"{shown(report.target)}: {counted(report.splats, 'splat')}, degree {report.degree}",
        f"  prim   {report.prim_path}",
        f"  tree   {counted(report.nodes, 'node')} in {counted(report.levels, 'level')}, "
        f"{counted(report.leaves, 'leaf').replace('leafs', 'leaves')}, "
        f"{counted(report.chunks, 'chunk')}",
        f"  size   {said_bytes(report.size)}, {report.size / report.leaf_size:.2f} times that of "
        "its leaves",
        f"  coarse {', '.join(map(str, report.coarse))} splats in fields for other renderers, "
        f"{said_bytes(report.coarse_size)} more",
        f"  pixel  {report.pixel:.4g}, errors {report.errors[0]:.4g} to {report.errors[1]:.4g}",
        f"  axes   {report.axes}",
    ]
    lines += [f"  error  {name} {bound}" for name, bound in report.error_bounds.items()]
    if report.continued:
        lines.append("  note   an interrupted building was continued")
    return "\n".join([*lines, *(f"  note   {note}" for note in report.notes)])
