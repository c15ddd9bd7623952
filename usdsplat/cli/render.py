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

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from usdsplat import images
from usdsplat.cli import console
from usdsplat.cli.arguments import given, option, positional
from usdsplat.cli.render_options import (
    ColorFlags,
    DrawingFlags,
    FileOptions,
    FramingOptions,
    LevelFlags,
    LightFlags,
    SamplingFlags,
)
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.cli.stage_options import StageOptions
from usdsplat.cli.values import aovs_of, bytes_of, crop_of, names_of, overscan_of, resolution_of
from usdsplat.images.aovs import AOVS

if TYPE_CHECKING:
    from usdsplat.products.request import RenderRequest

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
    json: Annotated[bool, option()] = False
    """print one JSON object with the pictures, the files that --resume skipped, and the findings"""
    framing: FramingOptions = field(default_factory=FramingOptions)
    drawing: DrawingFlags = field(default_factory=DrawingFlags)
    lights: LightFlags = field(default_factory=LightFlags)
    levels: LevelFlags = field(default_factory=LevelFlags)
    sampling: SamplingFlags = field(default_factory=SamplingFlags)
    color: ColorFlags = field(default_factory=ColorFlags)
    file: FileOptions = field(default_factory=FileOptions)
    stage_opening: StageOptions = field(default_factory=StageOptions)
    reporting: ReportingOptions = field(default_factory=ReportingOptions)


def run(options: Options, reporter: Reporter) -> int:
    """Render the pictures, and print each file when it is finished."""
    from usdsplat.cli.stages import open_stage_or_capture
    from usdsplat.delegate.engine import Engine
    from usdsplat.interchange.opening import check_prims
    from usdsplat.kernels.compiling import compile_time, on_compile
    from usdsplat.products.drawing import DrawOptions, draw_frames, files_of, work_of
    from usdsplat.products.frames import first_frame, frames_to_draw, outside_range
    from usdsplat.products.planning import plan_pictures

    request = _request(options)
    drawing = DrawOptions(
        existing="resume" if options.resume else "replace",
        memory_limit=bytes_of(options.memory_limit),
    )
    if options.threads is not None:
        images.limit_threads(options.threads)
    report = []
    with (
        compile_time() as compiled,
        reporter.progress(compiled) as progress,
        on_compile(reporter.announce_compilation()),
    ):
        named = (options.framing.camera, options.settings, *request.matte, *request.catchers)
        keep = ("/Render", *(path for path in named if path and path[0] == "/"))
        stage = open_stage_or_capture(
            options.stage,
            options.stage_opening,
            reporter,
            axes=options.axes,
            keep=keep,
            progress=progress,
        )
        check_prims(stage, "--matte", request.matte)
        check_prims(stage, "--catcher", request.catchers)
        first = first_frame(stage, options.frames)
        with Engine(stage, device=options.device, threads=options.threads, time=first) as engine:
            plans = plan_pictures(engine, request)
            frames = frames_to_draw(stage, options.frames, plans)
            reporter.findings.extend(filter(None, [outside_range(stage, frames)]))
            engine.expect(work_of(plans, frames))
            for drawn in draw_frames(
                engine,
                plans,
                frames,
                source=str(options.stage),
                options=drawing,
                progress=progress,
                findings=reporter.findings,
            ):
                report.append(drawn)
                if not options.json:
                    console.say_path(drawn.path)
    if not report:
        reporter.remark("nothing to do: every file exists already")
    if options.json:
        done = {drawn.path for drawn in report}
        paths = [path for group in files_of(plans, frames) for path in group]
        pictures = [{**asdict(drawn), "path": str(drawn.path)} for drawn in report]
        skipped = [str(path) for path in paths if path not in done]
        reporter.print_json({"pictures": pictures, "skipped": skipped})
    return 0


def _request(options: Options) -> RenderRequest:
    """Return the request that the flags describe."""
    from usdsplat.images.user_metadata import parse_entry
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
        settings={name: value for each in flags for name, value in given(each).items()},
        metadata=dict(parse_entry("--metadata", text) for text in file.metadata),
        settings_prim=options.settings,
        product=options.product,
    )
