"""Render a stage or a capture to EXR, PNG, JPEG or WebP.

examples:
  usdsplat render scan.ply -o scan.png
      a capture as splat viewers show it, over grey, with a camera that frames it
  usdsplat render scan.ply -o scan.webp --background transparent
      the same with alpha; a colour such as black, '#20242a' or 1,1,1 is put behind the picture
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
  usdsplat render shot.usd -o shot.exr --aovs color,shadow --catcher /World/Ground
      the shadow that the lights of the stage cast on a ground that is not in the picture
  usdsplat render shot.usd -o shot.exr --lighting relit --aovs color,lights
      the part of the picture by each light group, to balance them in compositing
  usdsplat render shot.usd
      all products of the stage's RenderSettings
  usdsplat render shot.usd -o shot.####.exr --frames 1001-1240 --jobs 2
      two processes of this machine; --dask tcp://host:8786 uses a cluster
  usdsplat render shot.usd -o a.png --variant /World/Tree:season=autumn --mute proxy

notes:
  PNG, JPEG and WebP are display-referred sRGB; EXR is scene-linear Rec.709 unless --color-mode
  says otherwise. --background is composited in code values of the display. Pictures of a stage
  are transparent by default, those of a capture by itself are not; EXRs always keep their alpha.
  Flags override the values of the stage's UsdRender prims.
  Without --frames, a name with #### gets the stage's whole range, any other name its first frame.
  So does a productName whose time samples differ. A shell needs quotes around '$F4' and '<F4>',
  which may also be in the names of folders.
  If the stage has several products, -o renders the first one; --product selects another.
  If the stage has no camera, a static camera shows what is drawn at the first, middle and last
  frame. For a sequence that is rendered in several runs, use --camera.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from typing import TYPE_CHECKING

from usdsplat import images
from usdsplat.cli import console
from usdsplat.cli.arguments import given
from usdsplat.cli.forking import DRAWING
from usdsplat.cli.job_options import JobRunner, check_jobs, environments
from usdsplat.cli.render_job import as_task, ends_of, run_as_job, say_end
from usdsplat.cli.render_options import Options
from usdsplat.cli.reporting import Reporter
from usdsplat.cli.sharing import Pace, capacity, may_share, shared
from usdsplat.cli.values import aovs_of, bytes_of, crop_of, names_of, overscan_of, resolution_of
from usdsplat.core.errors import UsageError
from usdsplat.core.folders import check_folder
from usdsplat.core.progress import Progress
from usdsplat.images.frame_numbers import parse_frames

if TYPE_CHECKING:
    from usdsplat.delegate.engine import Engine
    from usdsplat.products.keeper import OpenStage
    from usdsplat.products.preparing import DrawOptions
    from usdsplat.products.request import PicturePlan, RenderRequest

FORKS = True
CUDA = "cuda"


def run(options: Options, reporter: Reporter) -> int:
    """Render the pictures, or run the tasks that do, and print each file when it is finished."""
    from usdsplat.kernels.cuda import support
    from usdsplat.kernels.devices import check_gpu

    check_jobs(options.job)
    if options.device == CUDA:
        support.begin()
    drawing = _draw_options(options)
    if options.threads is not None:
        images.limit_threads(options.threads)
    if options.job.is_asked:
        if options.device == CUDA and options.job.is_here:
            check_gpu()
        workers = environments(
            options.job,
            device=options.device,
            threads=options.threads,
            memory=drawing.memory_limit,
        )
        with JobRunner(options.job, reporter, workers, DRAWING) as runner:
            return _run_tasks(options, drawing, runner, reporter)
    return _run_here(options, drawing, reporter)


def _run_here(options: Options, drawing: DrawOptions, reporter: Reporter) -> int:
    """Draw the pictures with this process, until several would end sooner."""
    from usdsplat.kernels.compiling import compile_time
    from usdsplat.products.drawing import draw_frames
    from usdsplat.products.preparing import files_of

    limits = (options.threads, options.memory_limit, options.tile, options.plan_frame)
    may_go_on = may_share(options.job, reporter, *limits, options.fit_frames)
    with (
        compile_time() as compiled,
        _planning(options, reporter) as (progress, engine, plans, frames),
    ):
        pace = Pace(progress, lambda: capacity(engine.device), compiled=compiled)
        report, files = [], files_of(plans, frames)
        # Asked after the last picture of a frame, as tasks draw whole frames.
        after = {str(path): frames[i + 1 :] for i, path in enumerate(files[-1])}
        processes = 1
        for drawn in draw_frames(
            engine,
            plans,
            frames,
            source=options.stage_name or str(options.stage),
            options=drawing,
            progress=pace,
            findings=reporter.findings,
        ):
            report.append({**asdict(drawn), "path": str(drawn.path)})
            if not options.json:
                console.say_path(drawn.path)
            left = after.get(str(drawn.path), ())
            processes = pace.processes(len(left)) if may_go_on else 1
            if processes > 1:
                task = _task(options, plans, frames, engine.device)
                break
    if processes == 1:
        say_end(options, report, files, reporter)
        return 0
    job = shared(options.job, processes, reporter)
    options = replace(options, job=job)
    workers = environments(job, device=task.device, threads=None)
    with JobRunner(job, reporter, workers, DRAWING) as runner:
        return run_as_job(options, task, plans, frames, runner, reporter, left=left, drawn=report)


def _run_tasks(
    options: Options, drawing: DrawOptions, runner: JobRunner, reporter: Reporter
) -> int:
    """Plan the pictures, and let tasks draw them. With --device cuda, only the tasks open a GPU."""
    from usdsplat.products.preparing import check_frames, files_of, work_of

    is_named = options.device == CUDA
    planning = replace(options, device="cpu") if is_named else options
    with _planning(planning, reporter) as (_, engine, plans, frames):
        engine.expect(work_of(plans, frames))
        check_frames(engine, plans, frames, options=drawing, findings=reporter.findings)
        if options.job.openjd is None:  # else the pictures lie elsewhere
            for folder in {path.parent for group in files_of(plans, frames) for path in group}:
                check_folder(folder)
        task = _task(options, plans, frames, CUDA if is_named else engine.device)
    return run_as_job(options, task, plans, frames, runner, reporter)


def _task(
    options: Options, plans: Sequence[PicturePlan], frames: Sequence[float], device: str
) -> Options:
    """Return the options of a task, see `as_task`."""
    fits = any(plan.camera is None for plan in plans)
    return as_task(options, device, ends_of(frames) if fits else "", frames[0])


@contextmanager
def _planning(
    options: Options, reporter: Reporter
) -> Iterator[tuple[Progress, Engine, tuple[PicturePlan, ...], tuple[float, ...]]]:
    """Yield what is to be drawn: a receiver of progress, the engine, the pictures, the frames."""
    from usdsplat.kernels.compiling import compile_time, on_compile

    with (
        compile_time() as compiled,
        reporter.progress(compiled) as progress,
        on_compile(reporter.announce_compilation()),
        _opened(options, reporter, progress) as found,
    ):
        yield progress, found.engine, *_planned(options, found, reporter)


def _draw_options(options: Options) -> DrawOptions:
    """Return the options for drawing.

    Raises:
        UsageError: If one is wrong.
    """
    from usdsplat.interchange.files import read_whole
    from usdsplat.products.preparing import DrawOptions
    from usdsplat.products.tiles import TileStep, Tiling

    if options.tile is not None and options.tiles is None:
        raise UsageError("--tile", options.tile, "--tiles too")
    if options.tiles is not None and options.tile is None and not options.job.is_asked:
        raise UsageError("--tiles", options.tiles, "--tile, or --jobs, --dask or --openjd")
    if options.keep_tiles and options.tile is None:
        raise UsageError("--keep-tiles", "it without --tile", "--tile join")
    if options.tile is not None and options.job.is_asked:
        raise UsageError("--tile", options.tile, "no --jobs, --dask or --openjd")
    tiling = None if options.tiles is None else Tiling.parse(options.tiles)
    files, chunks = read_whole(options.stage)
    opened = options.stage_opening
    return DrawOptions(
        existing="resume" if options.resume else "replace",
        memory_limit=bytes_of(options.memory_limit),
        tile=None
        if tiling is None
        else TileStep.parse(tiling, options.tile or "join", keeps=options.keep_tiles),
        files=files,
        chunks=chunks,
        opening=(
            *map(repr, (opened.variant, sorted(opened.mute), sorted(opened.mask))),
            options.axes or "auto",
        ),
        fitted=() if options.fit_frames is None else parse_frames(options.fit_frames),
    )


@contextmanager
def _opened(options: Options, reporter: Reporter, progress: Progress) -> Iterator[OpenStage]:
    """Open the engine of the stage, or take the one that the last command left open."""
    from usdsplat.cli.stages import open_stage_or_capture
    from usdsplat.delegate.engine import Engine
    from usdsplat.interchange.files import capture_files
    from usdsplat.interchange.opening import check_prims
    from usdsplat.products.frames import first_frame
    from usdsplat.products.keeper import EngineKeeper, OpenStage

    framing = options.framing
    prims = (*(names_of(framing.matte) or ()), *(names_of(framing.catcher) or ()))
    named = (framing.camera, options.settings, *prims)
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
        found = tuple(list(reporter.findings)[before:])
        return OpenStage(engine, stage, found, capture_files(options.stage))

    key = (
        str(options.stage), options.stage_opening, options.axes, keep, options.device,
        options.threads, os.getcwd(),
    )  # fmt: skip
    keeper = EngineKeeper() if reporter.keeper is None else reporter.keeper
    try:
        with keeper.opened(key, make) as found:
            check_prims(found.stage, "--matte", names_of(options.framing.matte) or ())
            check_prims(found.stage, "--catcher", names_of(options.framing.catcher) or ())
            reporter.findings.extend(found.findings)
            yield found
    finally:
        if reporter.keeper is None:
            keeper.close()


def _planned(
    options: Options, found: OpenStage, reporter: Reporter
) -> tuple[tuple[PicturePlan, ...], tuple[float, ...]]:
    """Return the pictures and their frames."""
    from usdsplat.products.frames import first_frame, frames_to_draw, outside_range
    from usdsplat.products.planning import plan_pictures

    begin = options.plan_frame
    found.engine.set_time(first_frame(found.stage, options.frames) if begin is None else begin)
    plans = plan_pictures(found.engine, _request(options))
    frames = frames_to_draw(found.stage, options.frames, plans)
    reporter.findings.extend(filter(None, [outside_range(found.stage, frames)]))
    return plans, frames


def _request(options: Options) -> RenderRequest:
    """Return the request that the flags describe."""
    from usdsplat.images.user_metadata import parse_entry
    from usdsplat.interchange.files import capture_files
    from usdsplat.products.request import RenderRequest

    framing, file = options.framing, options.file
    flags = (options.drawing, options.lights, options.levels, options.sampling, options.color, file)
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
        catchers=names_of(framing.catcher) or (),
        holdout=framing.holdout,
        pixel_type="float" if file.float_ else "half" if file.half else None,
        deep=file.deep,
        compare=not file.no_compare,
        bake_view=file.bake_view,
        is_capture=bool(capture_files(options.stage)),
        settings={name: value for each in flags for name, value in given(each).items()},
        metadata=dict(parse_entry("--metadata", text) for text in file.metadata),
        settings_prim=options.settings,
        product=options.product,
    )
