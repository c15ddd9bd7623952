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
      with two processes of this machine; --dask tcp://host:8786 uses a cluster
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

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from usdsplat.cli import console
from usdsplat.cli.arguments import option, positional
from usdsplat.cli.job_options import JobOptions, JobRunner, check_jobs, environments, of_task
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.cli.values import bytes_of, time_code
from usdsplat.cli.words import words_of
from usdsplat.core.errors import UsageError
from usdsplat.core.folders import made_folder
from usdsplat.core.text import shown
from usdsplat.core.wording import counted, said_bytes

if TYPE_CHECKING:
    from collections.abc import Iterable

    from usdsplat.core.findings import Finding
    from usdsplat.core.progress import Progress
    from usdsplat.interchange.lod import LodOptions, LodReport


STEPS = ("begin", "sort", "build")
PARTS = 4
"""Parts of each step, for each process."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat lod`."""

    sources: Annotated[tuple[Path, ...], positional("[IN ...] IN")]
    """captures and stages to read, any number"""
    output: Annotated[Path | None, option("OUT", short="-o")] = None
    """USD file to write, .usd, .usda or .usdc; missing folders are made"""
    memory_limit: Annotated[str | None, option("SIZE")] = None
    """memory to use, such as 800M or 6G; what does not fit is on disk beside OUT until the end;
    default: 4G"""
    pixel: Annotated[float | None, option("SIZE")] = None
    """size of a pixel of the photographs at the splats, in units of the first input: merged splats
    get the low-pass of classic pictures at this size, at most that of all inputs; 0 for none;
    default: as authored, else that of a picture of 540 lines that frames an input"""
    leaf_splats: Annotated[int | None, option("N")] = None
    """largest number of splats of a node, 256 to 65536; default: 16384"""
    sh_degree: Annotated[int | None, option("DEGREE")] = None
    """highest degree of the harmonics, 0 to 4; default: that of the inputs"""
    axes: Annotated[str | None, option("AXES")] = None
    """directions of x, y and z of all captures, such as rdf; default: auto: as stated in each file,
    else as their splats suggest, else rdf"""
    up_axis: Annotated[str | None, option("Y|Z")] = None
    """up axis of OUT; default: that of the first input if it is a stage, else Y"""
    meters_per_unit: Annotated[float | None, option("METRES")] = None
    """length of one unit of all captures, and of OUT, in metres; default: as stated by their
    formats, else 1"""
    frame: Annotated[float | None, option("FRAME")] = None
    """time code at which stages are read; default: their default values, or the first samples"""
    step: Annotated[str | None, option("begin|sort|build")] = None
    """do only this step of the building, for a farm: begin first, then sort and build in parts,
    then the command without a step, which does what is left"""
    part: Annotated[str | None, option("K/N")] = None
    """part K, from 1, of N parts of --step sort or build, which may be done side by side"""
    json: Annotated[bool, option()] = False
    """print one JSON object with a report"""
    job: JobOptions = field(default_factory=JobOptions)
    reporting: ReportingOptions = field(default_factory=ReportingOptions)


def run(options: Options, reporter: Reporter) -> int:
    """Build the tree, or a part of it, and print a report."""
    from usdsplat.interchange.lod import build_tree
    from usdsplat.kernels.compiling import on_compile

    if options.output is None:
        raise UsageError("lod", "no -o OUT", "one; see 'usdsplat lod --help'")
    _check_inputs(options)
    check_jobs(options.job, "--openjd", "--chunk")
    if options.part is not None and options.step is None:
        raise UsageError("--part", f"{options.part} without --step", "--step sort or build")
    if options.step is not None and options.job.is_asked:
        raise UsageError("--step", "it with --jobs or --dask", "one of them")
    if options.job.is_asked:
        _run_parts(options, reporter)

    def checked(findings: Iterable[Finding]) -> None:
        reporter.findings.extend(findings)
        reporter.findings.check()

    with (
        made_folder(options.output.parent),
        on_compile(reporter.announce_compilation(_COMPILING)),
        reporter.progress() as progress,
    ):
        if options.step is not None:
            _take_step(options, options.step, options.output, progress)
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


def _take_step(options: Options, step: str, target: Path, progress: Progress) -> None:
    """Do one step of the building.

    Raises:
        UsageError: If there is no such step or part.
    """
    from usdsplat.interchange.lod import TreePart, begin_tree, build_part

    if step not in STEPS:
        raise UsageError("--step", repr(step), f"one of {', '.join(STEPS)}")
    if (step == "begin") != (options.part is None):
        found = f"{options.part or 'none'} with --step {step}"
        raise UsageError("--part", found, "K/N with --step sort or build")
    made = _lod_options(options)
    if options.part is None:
        begin_tree(options.sources, target, options=made, progress=progress)
        return
    part, sorts = TreePart.parse(options.part), step == "sort"
    build_part(options.sources, target, part, sorts=sorts, options=made, progress=progress)


def _run_parts(options: Options, reporter: Reporter) -> None:
    """Do all steps but the last one as a job."""
    from usdsplat.jobs.trees import tree_job

    task = replace(
        options, json=True, job=JobOptions(), reporting=of_task(options.reporting), step=None
    )
    workers = environments(options.job, device="cpu", threads=None)
    job = tree_job(("lod", *words_of(task)), name="lod", parts=PARTS * len(workers))
    with JobRunner(options.job, reporter, workers) as runner:
        for _ in runner.run(job):
            pass


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
