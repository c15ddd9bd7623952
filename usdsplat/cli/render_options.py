"""The options of `usdsplat render` that belong together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from usdsplat.cli.arguments import flags_of, option
from usdsplat.render.settings import RenderSettings

FILE_KNOBS = ("multipart", "deep_error")

DrawingFlags: Any = flags_of(
    RenderSettings,
    (
        "sorting", "rasterize_mode", "sh_degree", "display_mode", "splat_budget", "blend_space",
        "refinement",
    ),
    about="How splats and surfaces are drawn.",
)  # fmt: skip
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
    about="Which colours the picture has. A view is needed by inverseView, and to bake it.",
)  # fmt: skip
FileFlags: Any = flags_of(RenderSettings, FILE_KNOBS)


@dataclass(frozen=True, slots=True, kw_only=True)
class FramingOptions:
    """What of the scene is in the picture, in place of what the product says."""

    camera: Annotated[str | None, option("CAMERA")] = None
    """path or name; default: the product's, the stage's first, or one that frames the scene"""
    resolution: Annotated[str | None, option("WIDTHxHEIGHT")] = None
    """size in pixels; default: the product's, or 1920x1080"""
    conform: Annotated[str | None, option("POLICY")] = None
    """what gives way where camera and picture differ in shape, such as cropAperture"""
    pixel_aspect: Annotated[float | None, option("RATIO")] = None
    """width over height of a pixel"""
    overscan: Annotated[str | None, option("PIXELS")] = None
    """pixels drawn around the picture: N, or X,Y, or LEFT,TOP,RIGHT,BOTTOM"""
    crop: Annotated[str | None, option("X0,Y0,X1,Y1")] = None
    """draw only these pixels, ends exclusive, (0, 0) the top left"""
    purposes: Annotated[str | None, option("NAMES")] = None
    """of default, render, proxy, guide, with commas between; default: default,render"""
    matte: Annotated[str | None, option("/PRIM,/PRIM")] = None
    """prims that hide what is behind them and are not in the picture"""
    holdout: Annotated[str | None, option("FILE")] = None
    """EXR with depth, flat or deep, #### for the frame, that hides what is behind it"""


@dataclass(frozen=True, kw_only=True)
class FileOptions(FileFlags):
    """What the file holds."""

    half: Annotated[bool, option(excludes="--float")] = False
    """EXR colour in half precision, as is the default; not with --float"""
    float_: Annotated[bool, option(name="float")] = False
    """EXR colour in full precision"""
    bake_view: Annotated[bool, option()] = False
    """write what the view shows, as a PNG always has it"""
    deep: Annotated[bool, option()] = False
    """keep every contribution to a pixel: a deep EXR"""
    deep_compression: Annotated[str | None, option("none|zips")] = None
    """of a deep EXR; zips takes longer and saves about a third; default: none"""
    no_compare: Annotated[bool, option()] = False
    """do not draw a deep picture flat too, to say how far it is from that; half the time"""
