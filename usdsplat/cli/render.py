"""Render a stage or a capture to EXR or PNG.

examples:
  usdsplat render scan.ply -o scan.png
      a capture as splat viewers show it, with a camera that frames it
  usdsplat render shot.usd -o shot.####.exr --frames 1001-1024 --camera /World/Cam
      linear half EXRs for compositing, one per frame
  usdsplat render shot.usd -o shot.exr --aovs color,Z,id,splatId --float
      with depth and ids, in full precision
  usdsplat render shot.usd -o shot.####.exr --samples 64 --overscan 32
      with the camera's motion blur and depth of field, and pixels around the picture
  usdsplat render shot.usd -o shot.exr --deep --holdout cg.exr
      every contribution to each pixel, except those hidden by another renderer's picture
  usdsplat render shot.usd -o shot.exr --deep --samples 16 --aovs id,cryptoObject --deep-error 0.01
      with blur and ids, and with neighbouring samples merged to keep the file small
  usdsplat render shot.usd -o shot.exr --color-mode inverseView --config ocio://studio-config-latest
      colours that the config's first view, here ACES 2.0, shows as they were captured
  usdsplat render shot.usd
      all products of the stage's RenderSettings
  usdsplat render shot.usd -o shot.####.exr --frames 1001-1240 --jobs 2
      two processes of this machine; --dask tcp://host:8786 uses a cluster
  usdsplat render shot.usd -o a.png --variant /World/Tree:season=autumn --mute proxy

notes:
  PNG is display-referred sRGB; EXR is scene-linear Rec.709 unless --color-mode says otherwise.
  Flags override the values of the stage's UsdRender prims.
  Without --frames, a name with #### gets the stage's whole range, any other name its first frame.
  So does a productName whose time samples differ. A shell needs quotes around '$F4' and '<F4>',
  which may also be in the names of folders.
  If the stage has several products, -o renders the first one; --product selects another.
  If the stage has no camera, a static camera shows the splats of the first, middle and last
  frame. For a sequence that is rendered in several runs, use --camera.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from usdsplat import images
from usdsplat.cli import console
from usdsplat.cli.arguments import given, option, positional
from usdsplat.cli.job_options import JobOptions, check_jobs, environments, run_job
from usdsplat.cli.render_options import (
    ColorFlags,
    DrawingFlags,
    FileOptions,
    FramingOptions,
    LevelFlags,
    SamplingFlags,
)
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.cli.stage_options import StageOptions
from usdsplat.cli.values import aovs_of, bytes_of, crop_of, names_of, overscan_of, resolution_of
from usdsplat.cli.words import words_of
from usdsplat.core.errors import UsageError
from usdsplat.core.progress import Progress
from usdsplat.images.aovs import AOVS
from usdsplat.images.frame_numbers import parse_frames

if TYPE_CHECKING:
    from usdsplat.jobs.job import Job
    from usdsplat.products.keeper import OpenStage
    from usdsplat.products.preparing import DrawOptions
    from usdsplat.products.request import PicturePlan, RenderRequest

TURNS = 8
"""Number of tasks of each process, where --chunk does not say."""
COLD = 24
"""Frames of a task of a farm, where --chunk does not say: it opens the stage anew."""
TILE_SUFFIX = ".tile"
AOV_HELP = (
    f"all, or some of {', '.join(AOVS)}, separated by commas; default: the product's, or color"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat render`."""

    stage: Annotated[Path, positional("STAGE")]
    """stage or capture to render"""
    output: Annotated[str | None, option("FILE", short="-o")] = None
    """file to write, .exr or .png, with ####, %04d, $F4 or <F4> for the frame; missing folders are
    made; default: the products' names"""
    frames: Annotated[str | None, option("RANGE")] = None
    """frames such as 7, 1-10, 1:10x2 or 1,5,8-12, or stage for its range; default: see the notes"""
    aovs: Annotated[str | None, option("NAMES", text=AOV_HELP)] = None
    settings: Annotated[str | None, option("/PRIM")] = None
    """RenderSettings prim to use; default: the one that the stage names, or its first"""
    product: Annotated[str | None, option("/PRIM")] = None
    """render only this RenderProduct of the settings; default: all, or with -o the first"""
    axes: Annotated[str | None, option("AXES")] = None
    """directions of a capture's x, y and z, such as rdf; default: auto: as stated in the file, else
    as its splats suggest, else rdf"""
    device: Annotated[str, option("NAME")] = "auto"
    """device that renders, auto, cpu or cuda; default: auto, the one that finishes first"""
    threads: Annotated[int | None, option("N")] = None
    """number of threads; default: USDSPLAT_THREADS, or all cores"""
    memory_limit: Annotated[str | None, option("SIZE")] = None
    """maximum memory of the process, such as 800M or 6G; default: no limit"""
    resume: Annotated[bool, option()] = False
    """skip frames whose file exists, unless it is truncated or another picture"""
    tiles: Annotated[str | None, option("COLUMNSxROWS")] = None
    """divide each picture into tiles, which are tasks of their own"""
    tile: Annotated[str | None, option("N|join")] = None
    """draw only this tile of --tiles, from 1, into a folder beside the picture; or join all"""
    fit_frames: Annotated[str | None, option("RANGE")] = None
    """frames that the camera of a stage without one shows; default: the first, the middle and the
    last one of --frames"""
    stage_name: Annotated[str | None, option("TEXT")] = None
    """name of the stage in the headers of pictures; default: as given"""
    json: Annotated[bool, option()] = False
    """print one JSON object with the pictures, the files that --resume skipped, and the findings"""
    framing: FramingOptions = field(default_factory=FramingOptions)
    drawing: DrawingFlags = field(default_factory=DrawingFlags)
    levels: LevelFlags = field(default_factory=LevelFlags)
    sampling: SamplingFlags = field(default_factory=SamplingFlags)
    color: ColorFlags = field(default_factory=ColorFlags)
    file: FileOptions = field(default_factory=FileOptions)
    job: JobOptions = field(default_factory=JobOptions)
    stage_opening: StageOptions = field(default_factory=StageOptions)
    reporting: ReportingOptions = field(default_factory=ReportingOptions)


def run(options: Options, reporter: Reporter) -> int:
    """Render the pictures, and print each file when it is finished."""
    from usdsplat.kernels.compiling import compile_time, on_compile
    from usdsplat.products.drawing import draw_frames
    from usdsplat.products.preparing import check_frames, files_of, work_of

    check_jobs(options.job)
    drawing = _draw_options(options)
    if options.threads is not None:
        images.limit_threads(options.threads)
    with (
        compile_time() as compiled,
        reporter.progress(compiled) as progress,
        on_compile(reporter.announce_compilation()),
        _opened(options, reporter, progress) as found,
    ):
        engine = found.engine
        plans, frames = _planned(options, found, reporter)
        if options.job.is_asked:
            engine.expect(work_of(plans, frames))
            check_frames(engine, plans, frames, options=drawing, findings=reporter.findings)
            fits = any(plan.camera is None for plan in plans)
            tasks = _as_task(options, engine.device, _ends(frames) if fits else "")
        else:
            report = []
            for drawn in draw_frames(
                engine,
                plans,
                frames,
                source=options.stage_name or str(options.stage),
                options=drawing,
                progress=progress,
                findings=reporter.findings,
            ):
                report.append({**asdict(drawn), "path": str(drawn.path)})
                if not options.json:
                    console.say_path(drawn.path)
    if options.job.is_asked:
        return _run_as_job(options, tasks, plans, frames, reporter)
    _finish(options, report, files_of(plans, frames), reporter)
    return 0


def _finish(
    options: Options,
    report: Sequence[dict[str, Any]],
    files: Sequence[Sequence[Path]],
    reporter: Reporter,
) -> None:
    """Say that there was nothing to do, or print the JSON object."""
    if not report:
        reporter.remark("nothing to do: every file exists already")
    if options.json:
        done = {picture["path"] for picture in report}
        skipped = [str(path) for group in files for path in group if str(path) not in done]
        reporter.print_json({"pictures": list(report), "skipped": skipped})


def _draw_options(options: Options) -> DrawOptions:
    """Return the options for drawing.

    Raises:
        UsageError: If one is wrong.
    """
    from usdsplat.products.preparing import DrawOptions
    from usdsplat.products.tiles import TileStep, Tiling

    if options.tile is not None and options.tiles is None:
        raise UsageError("--tile", options.tile, "--tiles too")
    if options.tiles is not None and options.tile is None and not options.job.is_asked:
        raise UsageError("--tiles", options.tiles, "--tile, or --jobs, --dask or --openjd")
    if options.tile is not None and options.job.is_asked:
        raise UsageError("--tile", options.tile, "no --jobs, --dask or --openjd")
    tiling = None if options.tiles is None else Tiling.parse(options.tiles)
    return DrawOptions(
        existing="resume" if options.resume else "replace",
        memory_limit=bytes_of(options.memory_limit),
        tile=None if tiling is None else TileStep.parse(tiling, options.tile or "join"),
        fitted=() if options.fit_frames is None else parse_frames(options.fit_frames),
    )


@contextmanager
def _opened(options: Options, reporter: Reporter, progress: Progress) -> Iterator[OpenStage]:
    """Open the engine of the stage, or take the one that the last command left open."""
    from usdsplat.cli.stages import open_stage_or_capture
    from usdsplat.delegate.engine import Engine
    from usdsplat.interchange.opening import check_prims
    from usdsplat.products.frames import first_frame
    from usdsplat.products.keeper import EngineKeeper, OpenStage

    named = (options.framing.camera, options.settings, *(names_of(options.framing.matte) or ()))
    keep = ("/Render", *(path for path in named if path and path[0] == "/"))

    def make() -> OpenStage:
        before = len(list(reporter.findings))
        stage = open_stage_or_capture(
            options.stage,
            options.stage_opening,
            reporter,
            axes=options.axes,
            keep=keep,
            progress=progress,
        )
        first = first_frame(stage, options.frames)
        engine = Engine(stage, device=options.device, threads=options.threads, time=first)
        return OpenStage(engine, stage, tuple(list(reporter.findings)[before:]))

    key = (
        str(options.stage), options.stage_opening, options.axes, keep, options.device,
        options.threads, os.getcwd(),
    )  # fmt: skip
    keeper = EngineKeeper() if reporter.keeper is None else reporter.keeper
    try:
        with keeper.opened(key, make) as found:
            check_prims(found.stage, "--matte", names_of(options.framing.matte) or ())
            reporter.findings.extend(found.findings)
            yield found
    finally:
        if reporter.keeper is None:
            keeper.close()


def _planned(
    options: Options, found: OpenStage, reporter: Reporter
) -> tuple[tuple[PicturePlan, ...], tuple[float, ...]]:
    """Return the pictures and their frames."""
    from usdsplat.products.frames import frames_to_draw, outside_range
    from usdsplat.products.planning import plan_pictures

    plans = plan_pictures(found.engine, _request(options))
    frames = frames_to_draw(found.stage, options.frames, plans)
    reporter.findings.extend(filter(None, [outside_range(found.stage, frames)]))
    return plans, frames


def _as_task(options: Options, device: str, fitted: str) -> Options:
    """Return the options of a task, but for its frames and its tile.

    Args:
        options: Options of the job.
        device: Device that draws all tasks.
        fitted: Frames that the camera frames; "" if the stage has a camera.
    """
    return replace(
        options,
        frames=None,
        device=device,
        json=True,
        fit_frames=options.fit_frames or fitted or None,
        stage_name=options.stage_name or str(options.stage),
        job=JobOptions(),
        reporting=ReportingOptions(quiet=True),
    )


def _ends(frames: Sequence[float]) -> str:
    """Return the frames that the camera of a stage without one frames."""
    from usdsplat.jobs.frames import frames_text

    return ",".join(
        frames_text([each])
        for each in dict.fromkeys((frames[0], frames[len(frames) // 2], frames[-1]))
    )


def _run_as_job(
    options: Options,
    task: Options,
    plans: Sequence[PicturePlan],
    frames: Sequence[float],
    reporter: Reporter,
) -> int:
    """Run the pictures as tasks, and print each file when it is finished."""
    from usdsplat.products.preparing import files_of

    workers = environments(options.job, device=task.device, threads=options.threads)
    chunk = options.job.chunk or max(1, len(frames) // (len(workers) * TURNS))
    if options.job.openjd is not None:
        return _write_bundle(options, task, frames, reporter)
    files = files_of(plans, frames)
    report = []
    for printed in run_job(_job(options, task, frames, chunk), options.job, reporter, workers):
        for picture in printed["pictures"]:
            if not picture["path"].endswith(TILE_SUFFIX):
                report.append(picture)
                if not options.json:
                    console.say_path(Path(picture["path"]))
    by_frame = (path for row in zip(*files, strict=True) for path in row)
    order = {str(path): i for i, path in enumerate(by_frame)}
    report.sort(key=lambda picture: order[picture["path"]])
    _finish(options, report, files, reporter)
    return 0


def _job(options: Options, task: Options, frames: Sequence[float], chunk: int) -> Job:
    """Return the job of the options."""
    from usdsplat.jobs.frames import render_job
    from usdsplat.products.tiles import Tiling

    return render_job(
        ("render", *words_of(task)),
        frames,
        name=f"usdsplat render {options.stage.name}",
        chunk=chunk,
        tiling=None if options.tiles is None else Tiling.parse(options.tiles),
    )


def _write_bundle(
    options: Options, task: Options, frames: Sequence[float], reporter: Reporter
) -> int:
    """Write the pictures as an Open Job Description bundle."""
    from usdsplat.jobs.openjd import (
        ASSETS,
        TEMPLATE,
        Bundle,
        output_word,
        stage_word,
        template_of,
        write_bundle,
    )  # fmt: skip
    from usdsplat.products.localizing import localize

    folder = options.job.openjd
    assert folder is not None  # checked by the caller
    if options.output is None:
        raise UsageError("--openjd", "no --output", "-o FILE, whose name the pictures get")
    chunk = options.job.chunk or COLD
    framing, opening = options.framing, options.stage_opening
    read = (framing.holdout, opening.session_layer, options.color.ocio_config)
    inputs = tuple(str(Path(path).absolute()) for path in read if path and Path(path).exists())
    task = replace(
        task,
        stage=Path(stage_word()),
        output=output_word(Path(options.output).name),
        json=False,
        resume=True,
        reporting=ReportingOptions(strict=options.reporting.strict, progress="openjd"),
    )
    job = _job(options, task, frames, chunk)
    bundle = Bundle(
        folder=folder,
        stage=f"{ASSETS}/{options.stage.name}",
        frames=frames,
        chunk=chunk,
        device=task.device,
        memory=bytes_of(options.memory_limit),
        inputs=inputs,
    )
    template_of(job, bundle)
    localize(options.stage, folder / ASSETS)
    for path in write_bundle(job, bundle):
        if path.name == TEMPLATE and not options.json:
            console.say_path(path)
    if options.json:
        reporter.print_json({"template": str(folder / TEMPLATE)})
    return 0


def _request(options: Options) -> RenderRequest:
    """Return the request that the flags describe."""
    from usdsplat.images.user_metadata import parse_entry
    from usdsplat.products.request import RenderRequest

    framing, file = options.framing, options.file
    flags = (options.drawing, options.levels, options.sampling, options.color, file)
    return RenderRequest(
        output=options.output,
        camera=framing.camera,
        resolution=resolution_of(framing.resolution),
        conform=framing.conform,
        pixel_aspect=framing.pixel_aspect,
        crop=crop_of(framing.crop),
        overscan=overscan_of(framing.overscan),
        aovs=aovs_of(options.aovs),
        purposes=names_of(framing.purposes),
        matte=names_of(framing.matte) or (),
        holdout=framing.holdout,
        pixel_type="float" if file.float_ else "half" if file.half else None,
        deep=file.deep,
        compare=not file.no_compare,
        bake_view=file.bake_view,
        settings={name: value for each in flags for name, value in given(each).items()},
        metadata=dict(parse_entry("--metadata", text) for text in file.metadata),
        settings_prim=options.settings,
        product=options.product,
    )
