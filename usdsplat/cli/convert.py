"""Convert captures to a stage, a stage to captures, either to another of its kind, or to a page.

examples:
  usdsplat convert scan.ply scan.usdc
      a stage with one splat field, with a transform on the prim that turns it upright
  usdsplat convert scan.spz scan.usdc --up-axis Z --meters-per-unit 0.01 --axes rub
      for a Z-up pipeline; the capture is in centimetres and its y points up
  usdsplat convert scan.ply scan.usdc --packed
      a third of the size, in the packed type, which only usdsplat can draw
  usdsplat convert asset.usd asset_packed.usdc --packed
      the same for the fields of a stage; variants and references stay, --flatten flattens them
  usdsplat convert shot.usd still.ply --frame 12 --prim /World/Tree
      the splats below a prim at frame 12, in world space, as a capture
  usdsplat convert shot.usd tree.spz --split
      one file per field: tree_Trunk.spz, tree_Leaves.spz
  usdsplat convert city.usda far.spz --lod 2
      a coarse level of a splat tree; --max-splats 500000 takes the best cut of that size
  usdsplat convert city.usda near.sog --camera /World/Cam --lod-error 2
      a splat tree as a picture of a camera draws it: fine where it is near, coarse elsewhere
  usdsplat convert shot.usda near.####.sog --camera /World/Cam --frames 1-48
      the same for each frame
  usdsplat convert city.usda web/lod-meta.json
      all levels of a splat tree as a streamed SOG, which PlayCanvas's viewers show
  usdsplat convert shot.usd page.html --camera Cam
      a page for browsers, one file that needs no server: splats of one frame, the moving camera
  usdsplat convert city.usda page/index.html
      the same for large captures: a folder for any host; splat trees are streamed
  usdsplat convert house.ply garden.sog both.ply
      several captures in one, in the coordinates of the first
  usdsplat convert cap.####.sog shot.usdc --frames 1-48 --rate 25
      a sequence as time samples; the reverse: convert shot.usdc cap.####.ply
  usdsplat convert cap.####.ply cap.####.sog --jobs 2
      with two processes of this machine; --dask tcp://host:8786 uses a cluster, and --openjd FOLDER
      writes a bundle for a farm
  usdsplat convert scan.ply scan.usdc --cameras colmap/sparse/0
      with a camera for each photograph, at its pose
  usdsplat convert scan.ply --rotate 0,0,180 --crop-sphere 0,0,0,5 --min-opacity 0.02 clean.ply
      rotate, then crop, then thin out: edits are applied in the order of their flags
  usdsplat convert scan.ply --drop-outliers --decimate 25% --morton light.sog
      remove floaters, keep a quarter of the splats, and sort them by location

notes:
  Axes are the directions of x, y and z: rdf is right, down, forward, as in most captures.
  Edits change the values that 'usdsplat info' prints for a capture. If a stage is converted to a
  capture, they change the resulting capture; if a stage is converted to a stage, they change the
  values of each field and time sample.
  Grades and crops of a stage are not applied to a capture, which is a finding; a stage keeps them.
  Inputs are never changed. The output appears when it is complete.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, cast

from usdsplat.cli import console, edit_flags
from usdsplat.cli.arguments import given
from usdsplat.cli.convert_job import check_job, is_divisible, run_as_job
from usdsplat.cli.convert_options import Options, check, switches
from usdsplat.cli.edit_flags import edits_of
from usdsplat.cli.job_options import check_jobs
from usdsplat.cli.reporting import Reporter
from usdsplat.cli.sharing import SharedPace, WorthSharing, capacity, may_share, shared
from usdsplat.cli.stage_options import StageOptions
from usdsplat.cli.values import resolution_of, time_code
from usdsplat.core.errors import UsageError
from usdsplat.core.folders import made_folder
from usdsplat.core.output import output_group
from usdsplat.core.text import shown
from usdsplat.core.wording import counted, said_bytes

if TYPE_CHECKING:
    from usdsplat.core.edits import Edit
    from usdsplat.delegate.scene_delegate import Stage
    from usdsplat.interchange.converting import Report
    from usdsplat.interchange.options import ExportOptions, ImportOptions, SequenceOptions
    from usdsplat.products.page import PageReport, PageRequest
    from usdsplat.schema import Form

__all__ = ["Options", "arranged", "run"]

FORKS = True


def arranged(words: Sequence[str]) -> list[str]:
    """Return the command line reordered for `Options`: files and flags may be given in any
    order."""
    return edit_flags.arranged(words, switches())


def run(options: Options, reporter: Reporter) -> int:
    """Convert the files and print a report."""
    if not options.others:
        raise UsageError("convert", "no OUT", "one; see 'usdsplat convert --help'")
    sources, target = [Path(options.source), *map(Path, options.others[:-1])], options.others[-1]
    edits = edits_of(options.edit)
    check(options, sources, target)
    check_jobs(options.job)
    check_job(options, target)
    if options.job.is_asked:

        def frames() -> Sequence[float]:
            return _frames_of(options, sources, reporter)

        made_by_tasks = run_as_job(options, target, frames, reporter)
        if made_by_tasks is not None:
            _say(options, made_by_tasks, reporter)
        return 0
    try:
        report = _converted(options, sources, target, edits, reporter)
    except WorthSharing as found:
        return run(replace(options, job=shared(options.job, found.processes, reporter)), reporter)
    _say(options, report, reporter)
    return 0


def _converted(
    options: Options,
    sources: Sequence[Path],
    target: str,
    edits: Sequence[Edit],
    reporter: Reporter,
) -> Report:
    """Convert the files with this process.

    Raises:
        WorthSharing: If several processes should convert the frames of a sequence.
    """
    from usdsplat.interchange import ImportReport, convert
    from usdsplat.interchange.files import is_page

    compiled: Callable[[], float] = float
    with ExitStack() as during:
        stages = during.enter_context(
            _opened(sources, time_code(options.stage_input.frame), reporter)
        )
        export = _export_options(options, stages, target, reporter)
        during.enter_context(made_folder(Path(target).parent))
        if reporter.findings.is_strict:
            during.enter_context(output_group())
        if any(edit.kind.compiles for edit in edits):
            from usdsplat.kernels.compiling import compile_time, on_compile

            during.enter_context(on_compile(reporter.announce_compilation(_COMPILING)))
            compiled = during.enter_context(compile_time())
        progress = during.enter_context(reporter.progress())
        if is_divisible(options, target) and may_share(options.job, reporter):
            here = partial(capacity, "cpu")
            progress = SharedPace("frames", progress, here, compiled=compiled, again=True)
        made = _import_options(options)
        if is_page(target):
            from usdsplat.products.page import write_page

            report: Report = write_page(
                sources,
                target,
                request=_page_request(options),
                edits=edits,
                options=made,
                export=export,
                progress=progress,
            )
        else:
            report = convert(
                sources,
                target,
                edits=edits,
                options=made,
                export=export,
                sequence=_sequence_options(options),
                flatten=options.stage_input.flatten,
                progress=progress,
            )
        if not isinstance(report, ImportReport):
            reporter.findings.extend(report.findings)
        reporter.findings.check()
    return report


def _say(options: Options, report: Report, reporter: Reporter) -> None:
    if options.json:
        reporter.print_json(asdict(report))
    else:
        console.say(_told(report))


def _frames_of(options: Options, sources: Sequence[Path], reporter: Reporter) -> tuple[float, ...]:
    """Return the frames of a conversion to a sequence, ascending."""
    from usdsplat.interchange.sequence_exporting import frames_of
    from usdsplat.interchange.sequence_files import files_of

    with _opened(sources, time_code(options.stage_input.frame), reporter) as stages:
        if stages:
            return tuple(frames_of(stages[0], _frames(options)))
        return tuple(files_of(sources[0], _frames(options)))


def _import_options(options: Options) -> ImportOptions:
    """Return the options for reading captures and for writing stages."""
    from usdsplat.formats import ReadOptions
    from usdsplat.interchange.options import ImportOptions

    stage, captures = options.stage_output, options.capture
    form: Form = "packed" if stage.packed else "half" if stage.half else "float"
    return ImportOptions(
        form=form,
        axes=captures.axes,
        up_axis=stage.up_axis,
        meters_per_unit=stage.meters_per_unit,
        prim_path=options.prim,
        bake_axes=stage.bake_axes,
        cameras=stage.cameras,
        reading=ReadOptions(lod=captures.lod or 0),
    )


def _sequence_options(options: Options) -> SequenceOptions:
    """Return how a sequence is read and written."""
    from usdsplat.interchange.options import RATE, SequenceOptions

    frames = options.sequence
    return SequenceOptions(
        frames=_frames(options),
        clips=frames.clips,
        rate=RATE if frames.rate is None else frames.rate,
        interpolate=frames.interpolate,
    )


def _page_request(options: Options) -> PageRequest:
    """Return the camera of a page."""
    from usdsplat.products.page import PageRequest

    return PageRequest(
        camera=options.view.camera,
        resolution=resolution_of(options.view.resolution),
        frames=_frames(options),
        background=options.view.background,
    )


def _frames(options: Options) -> tuple[float, ...] | None:
    """Return the frames of a sequence; None for all."""
    from usdsplat.images.frame_numbers import parse_frames

    frames = options.sequence.frames
    return None if frames is None else parse_frames(frames)


def _export_options(
    options: Options, stages: Sequence[Stage], target: str, reporter: Reporter
) -> ExportOptions:
    """Return how captures are written of stages: what is read of splat trees, and when. The view of
    a camera has a default time, and chooses for each frame of a sequence."""
    from usdsplat.formats import WriteOptions
    from usdsplat.images.frame_numbers import has_place
    from usdsplat.interchange.files import is_page
    from usdsplat.interchange.options import ExportOptions
    from usdsplat.interchange.sequence_exporting import frames_of
    from usdsplat.interchange.tree_reading import TreeChoice

    view, reads = options.view, options.stage_input
    time, findings = time_code(reads.frame), reporter.findings
    trees, trees_at = TreeChoice(level=options.capture.lod or 0, max_splats=reads.max_splats), {}
    if view.camera is not None and not is_page(target):
        from usdsplat.products.tree_views import ViewRequest, choice_of, choices_of

        size = resolution_of(view.resolution)
        request = ViewRequest(camera=view.camera, resolution=size, settings=given(view))
        if has_place(target):
            frames = frames_of(stages[0], _frames(options))
            trees_at = choices_of(stages[0], request, frames, findings=findings)
        else:
            trees, time = choice_of(stages[0], request, time, findings=findings)
        findings.check()
    return ExportOptions(
        time=time,
        split=reads.split,
        writing=WriteOptions(spz_version=options.capture.spz_version or 4),
        trees=trees,
        trees_at=trees_at,
    )


@contextmanager
def _opened(
    sources: Sequence[Path], time: float | None, reporter: Reporter
) -> Iterator[list[Stage]]:
    """Report what the stages among the sources ask for and do not get, without reading splats, and
    return them.

    They stay open in the context, so that the conversion does not read their layers again.

    Raises:
        StrictError: If the command is strict and there is an error or a warning.
    """
    from usdsplat.interchange.files import is_usd

    paths = list(filter(is_usd, sources))
    if not paths:  # captures alone need none of what draws
        yield []
        return

    from usdsplat.cli.stages import open_stage
    from usdsplat.products.checking import prim_findings

    stages = [open_stage(each, StageOptions(), reporter) for each in paths]
    for stage in stages:
        reporter.findings.extend(prim_findings(stage, time))
    reporter.findings.check()
    yield stages


_COMPILING = "compiling kernels, once; it takes up to half a minute"


def _told(report: Report) -> str:
    """Return the report as a few lines of text."""
    from usdsplat.interchange import (
        ImportReport,
        RepackReport,
        SequenceExportReport,
        SequenceImportReport,
        SplitReport,
    )
    from usdsplat.interchange.files import is_page

    if isinstance(report, SplitReport):
        lines = [_told(part) for part in report.parts]
        return "\n".join([*lines, *(f"  note   {note}" for note in report.notes)])
    if isinstance(report, RepackReport):
        found = counted(len(report.prim_paths), "field")
        if report.variants > len(report.prim_paths):
            found += f" in {counted(report.variants, 'variant')}"
        samples, splats = counted(report.samples, "sample"), counted(report.splats, "splat")
        changed = f"{found}, {samples}, {splats}, now {report.form}"
        as_it_was = f"no field changed, all are {report.form}"
        lines = [f"{shown(report.target)}: {changed if report.samples else as_it_was}"]
        return "\n".join([*lines, *(f"  note   {note}" for note in report.notes)])
    lines = [f"{shown(report.target)}: {counted(report.splats, 'splat')}, degree {report.degree}"]
    if isinstance(report, SequenceImportReport | SequenceExportReport):
        lines[0] += f", {counted(len(report.frames), 'frame')}"
    if isinstance(report, ImportReport):
        lines[0] += f", {report.form}, from {report.format}"
        lines.append(f"  prim   {report.prim_path}")
        if report.cameras:
            lines.append(f"  seen   by {counted(len(report.cameras), 'camera')} beside it")
        lines.append(f"  axes   {report.axes}")
    else:
        lines += [f"  prim   {path}" for path in report.prim_paths]
        lines.append(f"  axes   {report.frame}")
    if is_page(report.target):
        lines += _told_of_page(cast("PageReport", report))
    lines += [f"  error  {name} {bound}" for name, bound in report.error_bounds.items()]
    return "\n".join([*lines, *(f"  note   {note}" for note in report.notes)])


def _told_of_page(report: PageReport) -> list[str]:
    """Return what is special about a page as lines of text."""
    moves = f"{counted(len(report.frames), 'frame')}, {report.rate:g} per second"
    camera = f"  camera {report.camera or 'automatic'}"
    size = f"  size   {said_bytes(report.bytes)} in {counted(len(report.files), 'file')}"
    return [camera + (f", {moves}" if len(report.frames) > 1 else ""), size]
