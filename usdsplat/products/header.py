"""What the file of a picture says about it."""

from __future__ import annotations

import json
from dataclasses import replace

from usdsplat.delegate.engine import Engine
from usdsplat.images import cryptomatte
from usdsplat.images.camera import camera_metadata
from usdsplat.images.labels import picture_metadata
from usdsplat.images.layout import ImageLayout, Metadata
from usdsplat.products.request import Picture
from usdsplat.render.framing import conform
from usdsplat.render.output import view_of
from usdsplat.render.renderer import blend_space_of
from usdsplat.render.specs import View

DISPLAY = "srgb_rec709_display"
UNKNOWN = "unknown"
"""Interop name of a space that has none: the code values of a display other than sRGB."""


def output_space(picture: Picture) -> str:
    """The space of the numbers in a picture's colour channels."""
    settings = picture.settings
    if picture.deep:
        return settings.working_space
    if picture.is_baked:
        return UNKNOWN if view_of(settings).target else DISPLAY
    return DISPLAY if settings.color_mode == "display" else settings.working_space


def layout_of(picture: Picture, *, metadata: Metadata | None = None) -> ImageLayout:
    """What the file is going to hold."""
    return ImageLayout(
        resolution=picture.framing.resolution,
        data_window=picture.framing.data_window,
        aovs=picture.aovs,
        pixel_type=picture.pixel_type,
        color_space=output_space(picture),
        multipart=picture.settings.multipart,
        metadata=metadata or {},
    )


def labelled(
    engine: Engine, picture: Picture, view: View, *, stage: str, frame: float
) -> ImageLayout:
    """What the file of one frame is going to hold, with all that its header says."""
    window, pixel_aspect_ratio = conform(view.camera.window, view.framing)
    entries = {
        **camera_metadata(
            world_to_camera=view.camera.world_to_camera,
            window=window,
            orthographic=view.camera.orthographic,
        ),
        **picture_metadata(
            stage=stage,
            frame=frame,
            samples=1 if picture.deep else picture.settings.samples,
            exposure=view.camera.exposure,
        ),
        **_drawing(engine, picture, view),
    }
    return replace(layout_of(picture, metadata=entries), pixel_aspect_ratio=pixel_aspect_ratio)


def _drawing(engine: Engine, picture: Picture, view: View) -> Metadata:
    """How it was drawn, and what the ids and mattes in it stand for."""
    fields = [field.spec for _, field, _ in engine.render_scene.drawn()]
    settings = picture.settings.resolved(field.sorting_mode for field in fields)
    if picture.deep:
        settings = replace(settings, color_mode="scene", blend_space="linear")
    modes = {field.rasterize_mode for field in fields}
    if settings.rasterize_mode != "auto":
        modes = {settings.rasterize_mode}
    entries = {
        "usdsplat:camera": view.camera.path or "framing the scene",
        "usdsplat:sorting": settings.sorting,
        "usdsplat:rasterizeMode": " and ".join(sorted(modes)),
        "usdsplat:colorMode": settings.color_mode,
        "usdsplat:blendSpace": settings.working_space
        if picture.deep
        else blend_space_of(engine.render_scene, settings),
    }
    through = view_of(settings)
    if not through.is_plain and (picture.is_baked or settings.color_mode != "scene"):
        names = (through.display, through.view, through.looks)
        entries["usdsplat:view"] = " / ".join(filter(None, names))
    if "id" in picture.aovs:
        entries["usdsplat:ids"] = json.dumps(engine.drawn_paths())
    if "cryptoObject" in picture.aovs:
        return {**entries, **cryptomatte.metadata("cryptoObject", engine.drawn_paths())}
    return entries
