"""Define groups of options of `usdsplat render`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from usdsplat.cli.arguments import flags_of, option
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
    ("lighting", "ambient", "self_shadows", "shadow_resolution", "light_samples"),
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
    """apply the view transform to the file; PNGs always have it"""
    deep: Annotated[bool, option()] = False
    """write a deep EXR, with every contribution to a pixel; it can have the AOVs color, Z, ids and
    cryptoObject"""
    metadata: Annotated[tuple[str, ...], option("NAME=VALUE")] = ()
    """add an entry to the files' headers, a number if it looks like one; may be repeated"""
    no_compare: Annotated[bool, option()] = False
    """do not compare a deep picture with a flat one; takes half the time"""
