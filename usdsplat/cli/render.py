"""Draw a stage, or a capture, to EXR or PNG.

examples:
  usdsplat render scan.ply -o scan.png
      a capture as a viewer shows it, seen by a camera that frames it
  usdsplat render shot.usd -o shot.####.exr --frames 1001-1024 --camera /World/Cam
      linear half EXRs that can be composited, one for each frame
  usdsplat render shot.usd -o shot.exr --aovs color,Z,id,splatId --float
      depth and ids too, in full precision
  usdsplat render shot.usd
      everything that the stage's RenderSettings ask for, where they say
  usdsplat render shot.usd -o a.png --variant /World/Tree:season=autumn --mute proxy

notes:
  PNG is display-referred sRGB; EXR is scene-linear Rec.709 unless --color-mode says otherwise.
  Flags replace what the stage's UsdRender prims author.
  Without --frames a name with #### gets the stage's whole range, any other name its first frame.
  Of several products -o draws the first of the settings; --product picks another.
  Without any camera one frames what is seen at the first, middle and last of the frames, and stands
  still; a sequence that is drawn in several runs should be given a --camera.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional, arg, create_mutex_group

from usdsplat import images
from usdsplat.cli import console
from usdsplat.cli.parsing import flags_of, given, option, resolution_of
from usdsplat.cli.stage_options import StageOptions
from usdsplat.delegate.render_settings import RenderSettings
from usdsplat.images.frames import has_place, parse_frames

if TYPE_CHECKING:
    from pxr import Usd

    from usdsplat.cli.planning import Picture, Request
    from usdsplat.delegate.engine import Engine

SettingsFlags: Any = flags_of(RenderSettings)
EXR_PIXELS = create_mutex_group(required=False, title="precision")


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat render`."""

    stage: Annotated[Positional[Path], option("STAGE")]
    """stage or capture to draw"""
    output: Annotated[str | None, option("FILE", short="-o")] = None
    """file to write, .exr or .png, #### or %04d for the frame; default: the products' names"""
    camera: Annotated[str | None, option("CAMERA")] = None
    """path or name; default: the product's, the stage's first, or one that frames the scene"""
    frames: Annotated[str | None, option("RANGE")] = None
    """such as 7, 1-10, 1:10x2 or 1,5,8-12"""
    resolution: Annotated[str | None, option("WIDTHxHEIGHT")] = None
    """size in pixels; default: the product's, or 1920x1080"""
    aovs: Annotated[str | None, option("NAMES")] = None
    """of color, Z, id, instanceId, splatId, commas between; default: the product's, or color"""
    half: Annotated[bool, EXR_PIXELS, option()] = False
    """EXR colour in half precision, as is the default"""
    float_: Annotated[bool, EXR_PIXELS, option(name="float")] = False
    """EXR colour in full precision"""
    drawing: Annotated[SettingsFlags, arg(name="")] = field(default_factory=SettingsFlags)
    settings: Annotated[str | None, option("/PRIM")] = None
    """RenderSettings to follow; default: the one the stage names, or its first"""
    product: Annotated[str | None, option("/PRIM")] = None
    """draw only this RenderProduct of the settings; default: all, or with -o the first"""
    frame: Annotated[str | None, option("FRAME")] = None
    """of a capture: where its x, y and z point, such as rdf; default: as the file says"""
    purposes: Annotated[str | None, option("NAMES")] = None
    """of default, render, proxy, guide, with commas between; default: default,render"""
    device: Annotated[str, option("NAME")] = "auto"
    """what draws, auto or cpu; default: auto, the fastest here"""
    threads: Annotated[int | None, option("N")] = None
    """how many to use; default: all"""
    resume: Annotated[bool, option()] = False
    """leave out frames whose file exists"""
    json: Annotated[bool, option()] = False
    """print one JSON list of what was drawn"""
    opening: Annotated[StageOptions, arg(name="")] = field(default_factory=StageOptions)


def run(options: Options) -> int:
    """Draw; print each file as it is finished."""
    from usdsplat.cli.drawing import draw_frames, why_nothing
    from usdsplat.cli.planning import plan
    from usdsplat.cli.stages import open_stage_or_capture
    from usdsplat.delegate.engine import Engine
    from usdsplat.kernels.compiling import on_compile

    request = _request(options)
    if options.threads is not None:
        images.limit_threads(options.threads)
    report, told_empty = [], False
    with console.progress() as progress, on_compile(console.announce_compilation()):
        keep = ("/Render", *(p for p in (options.camera, options.settings) if p and p[0] == "/"))
        stage = open_stage_or_capture(
            options.stage, options.opening, frame=options.frame, keep=keep, progress=progress
        )
        first = _frames(options, stage, ())[0]
        with Engine(stage, device=options.device, threads=options.threads, time=first) as engine:
            pictures = plan(engine, request)
            frames = _frames(options, stage, pictures)
            _warn(engine)
            for drawn in draw_frames(
                engine,
                pictures,
                frames,
                source=str(options.stage),
                resume=options.resume,
                progress=progress,
            ):
                empty = "" if told_empty else why_nothing(engine, drawn)
                if empty:
                    told_empty = True
                    console.remark(f"{drawn.path}: nothing is drawn: {empty}")
                report.append(drawn)
                if not options.json:
                    print(drawn.path, flush=True)
    if not report:
        console.remark("nothing to do: every file is there already")
    if options.json:
        console.print_json([{**asdict(drawn), "path": str(drawn.path)} for drawn in report])
    return 0


def _warn(engine: Engine) -> None:
    """Say what is left out. A camera that is broken is an error if it is used, else nothing."""
    cameras = tuple(f"{path}: " for path in engine.cameras())
    for warning in engine.warnings:
        if not warning.startswith(cameras):
            console.remark(warning)


def _request(options: Options) -> Request:
    """What the flags ask for."""
    from usdsplat.cli.planning import Request

    return Request(
        output=options.output,
        camera=options.camera,
        resolution=resolution_of(options.resolution),
        aovs=_names(options.aovs),
        purposes=_names(options.purposes),
        pixel_type="float" if options.float_ else "half" if options.half else None,
        settings=given(options.drawing),
        settings_prim=options.settings,
        product=options.product,
    )


def _frames(options: Options, stage: Usd.Stage, pictures: tuple[Picture, ...]) -> tuple[float, ...]:
    """The frames to draw: those asked for, or the stage's range as far as the names have room."""
    if options.frames is not None:
        return parse_frames(options.frames)
    if not stage.HasAuthoredTimeCodeRange():
        return (0.0,)
    first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if last > first and any(has_place(picture.output) for picture in pictures):
        return tuple(first + i for i in range(int(last - first) + 1))
    return (first,)


def _names(text: str | None) -> tuple[str, ...] | None:
    """A list with commas between."""
    return None if text is None else tuple(name.strip() for name in text.split(","))
