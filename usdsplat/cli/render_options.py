"""Define the options of `usdsplat render`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from usdsplat.cli.arguments import flags_of, option, positional
from usdsplat.cli.job_options import JobOptions
from usdsplat.cli.reporting import ReportingOptions
from usdsplat.cli.stage_options import StageOptions
from usdsplat.images.aovs import AOVS
from usdsplat.render.settings import FILE_KNOBS, RenderSettings

DrawingFlags: Any = flags_of(
    RenderSettings,
    (
        "sorting", "rasterize_mode", "sh_degree", "display_mode", "splat_budget", "blend_space",
        "refinement",
    ),
    about="How splats and surfaces are drawn.",
)  # fmt: skip
LightFlags: Any = flags_of(
    RenderSettings,
    (
        "lighting",
        "ambient",
        "self_shadows",
        "shadow_resolution",
        "light_samples",
        "dome_samples",
    ),
    about="Light and shadows.",
)
LevelFlags: Any = flags_of(
    RenderSettings,
    ("lod_error", "lod_samples", "node_wait", "node_memory", "node_lifetime"),
    about="Levels of detail of splat trees.",
)
SamplingFlags: Any = flags_of(
    RenderSettings,
    ("samples", "pixel_filter", "filter_width", "motion_blur", "depth_of_field"),
    about="How pixels, shutter and lens are sampled.",
)
ColorFlags: Any = flags_of(
    RenderSettings,
    (
        "color_mode", "working_space", "inverse_max",
        "ocio_config", "ocio_display", "ocio_view", "ocio_look",
    ),
    about="Colours of the picture. inverseView and --bake-view need an OCIO view.",
)  # fmt: skip
FileFlags: Any = flags_of(RenderSettings, FILE_KNOBS)


@dataclass(frozen=True, slots=True, kw_only=True)
class FramingOptions:
    """Camera, picture size and visible prims, instead of the product's."""

    camera: Annotated[str | None, option("CAMERA")] = None
    """path or name; default: the product's, the stage's first, or one that frames the scene"""
    resolution: Annotated[str | None, option("WIDTHxHEIGHT")] = None
    """size in pixels; default: the product's, or 1920x1080"""
    conform: Annotated[str | None, option("POLICY")] = None
    """how to fit a camera and a picture of different aspect ratios, such as cropAperture"""
    pixel_aspect: Annotated[float | None, option("RATIO")] = None
    """width over height of a pixel"""
    overscan: Annotated[str | None, option("PIXELS")] = None
    """pixels drawn around the picture: N, or X,Y, or LEFT,TOP,RIGHT,BOTTOM"""
    crop: Annotated[str | None, option("X0,Y0,X1,Y1")] = None
    """render only these pixels; ends are exclusive, (0, 0) is the top left"""
    purposes: Annotated[str | None, option("NAMES")] = None
    """some of default, render, proxy, guide, separated by commas; default: default,render"""
    matte: Annotated[str | None, option("/PRIM,/PRIM")] = None
    """prims that hide what is behind them and are not in the picture"""
    catcher: Annotated[str | None, option("/PRIM,/PRIM")] = None
    """prims that are not in the picture and whose shadows the AOV shadow holds"""
    holdout: Annotated[str | None, option("FILE")] = None
    """EXR with depth, flat or deep, that hides what is behind it; #### for the frame"""


@dataclass(frozen=True, kw_only=True)
class FileOptions(FileFlags):
    """Content and format of the file."""

    half: Annotated[bool, option(excludes="--float")] = False
    """EXR colour in half precision, which is the default; not with --float"""
    float_: Annotated[bool, option(name="float")] = False
    """EXR colour in full precision"""
    bake_view: Annotated[bool, option()] = False
    """apply the view transform to an EXR; other files always have it"""
    deep: Annotated[bool, option()] = False
    """write a deep EXR, with every contribution to a pixel; it can have the AOVs color, Z, ids and
    cryptoObject"""
    metadata: Annotated[tuple[str, ...], option("NAME=VALUE")] = ()
    """add an entry to the files' headers, a number if it looks like one; may be repeated"""
    no_compare: Annotated[bool, option()] = False
    """do not compare a deep picture with a flat one; takes half the time"""


AOV_HELP = (
    f"all, or some of {', '.join(AOVS)}, separated by commas, and lights for a light_GROUP of each "
    "light group, or some of those; default: the product's, or color"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat render`."""

    stage: Annotated[Path, positional("STAGE")]
    """stage or capture to render"""
    output: Annotated[str | None, option("FILE", short="-o")] = None
    """file to write, .exr, .png, .jpg or .webp, with ####, %04d, $F4 or <F4> for the frame; missing
    folders are made; default: the products' names"""
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
    """skip frames whose file exists, unless it is truncated or another picture: of another camera,
    setting, file of the stage, or version"""
    tiles: Annotated[str | None, option("COLUMNSxROWS")] = None
    """divide each picture into tiles, which are tasks of their own"""
    tile: Annotated[str | None, option("N|join")] = None
    """draw only this tile of --tiles, from 1, into a folder beside the picture; or join all"""
    keep_tiles: Annotated[bool, option()] = False
    """with --tile join: leave the tiles, for a join that may have to be repeated"""
    fit_frames: Annotated[str | None, option("RANGE")] = None
    """frames that the camera of a stage without one shows; default: the first, the middle and the
    last one of --frames"""
    plan_frame: Annotated[float | None, option("FRAME")] = None
    """frame at which products and settings are read; default: the first one of --frames"""
    stage_name: Annotated[str | None, option("TEXT")] = None
    """name of the stage in the headers of pictures; default: as given"""
    json: Annotated[bool, option()] = False
    """print one JSON object with the pictures, the files that --resume skipped, and the findings"""
    framing: FramingOptions = field(default_factory=FramingOptions)
    drawing: DrawingFlags = field(default_factory=DrawingFlags)
    lights: LightFlags = field(default_factory=LightFlags)
    levels: LevelFlags = field(default_factory=LevelFlags)
    sampling: SamplingFlags = field(default_factory=SamplingFlags)
    color: ColorFlags = field(default_factory=ColorFlags)
    file: FileOptions = field(default_factory=FileOptions)
    job: JobOptions = field(default_factory=JobOptions)
    stage_opening: StageOptions = field(default_factory=StageOptions)
    reporting: ReportingOptions = field(default_factory=ReportingOptions)
