"""Make the headers of picture files, for all file formats.

`picture_header` serves pictures of `usdsplat render`, pictures saved from a window, and movies. All
of them therefore name stage, frame, camera and drawing settings in the same way.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from usdsplat.core.text import shown
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.stage_info import StageInfo
from usdsplat.images import cryptomatte
from usdsplat.images.background import described
from usdsplat.images.camera import camera_metadata, lens_metadata
from usdsplat.images.labels import (
    origin_metadata,
    picture_metadata,
    time_metadata,
    timecode_offset,
)
from usdsplat.images.layout import ImageLayout, Metadata
from usdsplat.products.request import PicturePlan
from usdsplat.products.source_hash import source_hash
from usdsplat.render.framing import Window, conform
from usdsplat.render.lod.tree import TreeSpec
from usdsplat.render.output import view_of
from usdsplat.render.renderer import blend_space_of
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CameraSpec, FieldSpec, View

DISPLAY = "srgb_rec709_display"
UNKNOWN = "unknown"
"""Interop name of a colour space without one: display code values other than sRGB."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Origin:
    """Origin of a picture, as its header states it."""

    stage: str
    """Name of the stage, as the user gave it."""
    frame: float
    """Time code."""
    camera: str = "framing the scene"
    """Name of a camera that is not a prim of the stage."""
    shown: Mapping[str, str | float] = field(default_factory=dict)
    """Viewer adjustments that are part of the pixels, such as exposure; empty for an EXR."""
    stamp: str = ""
    """Result of `picture_stamp`, which `render --resume` compares; "" for none."""


def output_space(plan: PicturePlan) -> str:
    """Return the colour space of a picture's colour channels."""
    settings = plan.settings
    if plan.deep:
        return settings.working_space
    if plan.is_baked:
        return UNKNOWN if view_of(settings).target else DISPLAY
    return DISPLAY if settings.color_mode == "display" else settings.working_space


def layout_of(plan: PicturePlan) -> ImageLayout:
    """Return the layout of a picture's file, without its header."""
    return ImageLayout(
        resolution=plan.framing.resolution,
        data_window=plan.framing.data_window,
        aovs=plan.aovs,
        pixel_type=plan.pixel_type,
        pixel_types=dict(plan.pixel_types),
        color_space=output_space(plan),
        multipart=plan.settings.multipart,
        compression=plan.settings.compression,
        tile_size=0 if plan.deep else plan.settings.tile_size,
        crypto_rank=plan.settings.crypto_rank,
        background=plan.background,
        quality=plan.settings.jpeg_quality,
    )


def labelled_layout(
    engine: Engine, plan: PicturePlan, view: View, *, origin: Origin
) -> ImageLayout:
    """Return the layout of the file of one frame, with its header.

    Args:
        engine: Engine at the picture's time.
        plan: Plan of the picture.
        view: View of the picture.
        origin: Stage, frame and camera for the header.
    """
    _, pixel_aspect_ratio = conform(view.camera.window, view.framing)
    return replace(
        layout_of(plan),
        pixel_aspect_ratio=pixel_aspect_ratio,
        empty_depth=_empty_depth(plan, view),
        metadata=picture_header(engine, plan, view, origin=origin),
    )


def _empty_depth(plan: PicturePlan, view: View) -> float:
    """Return the depth of empty pixels."""
    return {"inf": math.inf, "0": 0.0, "far": view.camera.clipping_range[1]}[
        plan.settings.empty_depth
    ]


def stage_hash(engine: Engine) -> str:
    """Return the hash of the files of the engine's stage, as in headers; "" if there is none."""
    info = engine.stage_info()
    return source_hash(info.files, info.clips)


def picture_header(engine: Engine, plan: PicturePlan, view: View, *, origin: Origin) -> Metadata:
    """Return all entries of a picture's header. For arguments see `labelled_layout`."""
    window, _ = conform(view.camera.window, view.framing)
    info = engine.stage_info()
    entries = {
        **camera_metadata(
            world_to_camera=view.camera.world_to_camera,
            window=window,
            orthographic=view.camera.orthographic,
        ),
        **({} if view.camera.orthographic else _lens(view.camera, window, info)),
        **time_metadata(
            frame=origin.frame,
            rate=info.frames_per_second,
            per_second=info.time_codes_per_second,
            shutter=view.camera.shutter,
            offset=start_offset(plan.settings, info),
        ),
        **origin_metadata(stage_hash(engine)),
        **picture_metadata(
            stage=origin.stage,
            frame=origin.frame,
            samples=plan.settings.samples,
            exposure=view.camera.exposure,
        ),
        **({"usdsplat:stamp": origin.stamp} if origin.stamp else {}),
        "usdsplat:camera": view.camera.path or origin.camera,
        **({"usdsplat:background": described(plan.background)} if plan.background else {}),
        **_drawing(engine, plan),
        **{f"usdsplat:shown:{name}": value for name, value in origin.shown.items()},
        **dict(plan.metadata),
    }
    if "id" in plan.aovs:
        entries["usdsplat:ids"] = json.dumps(info.prims)
    for layer in cryptomatte.LAYERS:
        if layer in plan.aovs:
            entries |= cryptomatte.metadata(layer, _matte_names(engine, layer, info))
    return entries


def _matte_names(engine: Engine, layer: str, info: StageInfo) -> tuple[str, ...]:
    """Return the names of a manifest. What is hidden at the frame may be visible at another time of
    the shutter, and a manifest that all frames share is simpler to use."""
    if layer == "cryptoObject":
        return info.prims
    if layer == "cryptoAsset":
        return info.assets
    return engine.render_scene.matte_groups(layer).names


def start_offset(settings: RenderSettings, info: StageInfo) -> int:
    """Return the number of frames that time code 0 of a stage is after 00:00:00:00.

    Raises:
        UsageError: If `settings.start_timecode` is not a time code of the stage's rate.
    """
    return timecode_offset(
        settings.start_timecode,
        first=info.start,
        rate=info.frames_per_second,
        per_second=info.time_codes_per_second,
    )


def _lens(camera: CameraSpec, window: Window, info: StageInfo) -> Metadata:
    """Return the header entries on the lens of a perspective camera."""
    return lens_metadata(
        window=window,
        focal_length=camera.focal_length,
        lens_radius=camera.lens_radius,
        focus_distance=camera.focus_distance,
        meters_per_unit=info.meters_per_unit,
    )


def _drawing(engine: Engine, plan: PicturePlan) -> Metadata:
    """Return the header entries on how splats are drawn and colours are converted."""
    scene = engine.render_scene
    specs: list[FieldSpec | TreeSpec] = [drawn.spec for _, drawn, _ in scene.drawn()]
    specs += [tree.spec for _, tree in scene.drawn_trees()]
    settings = plan.settings.resolved(spec.sorting_mode for spec in specs)
    if plan.deep:
        settings = replace(settings, color_mode="scene", blend_space="linear")
    modes = {spec.drawn_mode(settings.rasterize_mode) for spec in specs}
    entries = {
        "usdsplat:sorting": settings.sorting,
        "usdsplat:rasterizeMode": " and ".join(sorted(modes)),
        "usdsplat:colorMode": settings.color_mode,
        "usdsplat:blendSpace": settings.working_space
        if plan.deep
        else blend_space_of(engine.render_scene, settings),
    }
    through = view_of(settings)
    if not through.is_plain and (plan.is_baked or settings.color_mode != "scene"):
        names = (through.display, through.view, through.looks)
        entries["usdsplat:view"] = " / ".join(filter(None, names))
        entries["usdsplat:ocioConfig"] = shown(through.config)
    return entries
