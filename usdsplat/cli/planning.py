"""Which pictures to draw: what the stage asks for, as its user changes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.knobs import checked
from usdsplat.delegate.engine import PURPOSES, Engine
from usdsplat.delegate.render_settings import RenderSettings
from usdsplat.delegate.specs import Framing
from usdsplat.images import default_color_mode, open_writer
from usdsplat.images.aovs import find_aovs
from usdsplat.images.frames import frame_path
from usdsplat.images.layout import ImageLayout, PixelType

OUTPUT_SPACE = {"display": "srgb_rec709_display", "scene": "lin_rec709_scene"}
"""Colour mode -> the space that the pixels of a file are in."""
KNOWN_PURPOSES = ("default", "render", "proxy", "guide")


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What the user asks for on top of, or instead of, what the stage says; None is no opinion."""

    output: str | None = None
    """File to write, with a place for the frame number when there are several frames."""
    camera: str | None = None
    """Path of a camera, or its name where there is one of that name."""
    resolution: tuple[int, int] | None = None
    """[pixel]"""
    aovs: tuple[str, ...] | None = None
    purposes: tuple[str, ...] | None = None
    pixel_type: PixelType | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Values of `RenderSettings`."""
    settings_prim: str | None = None
    """Path of the RenderSettings to follow."""
    product: str | None = None
    """Path of the one product to draw."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """One picture for each frame."""

    output: str
    camera: str | None
    framing: Framing
    settings: RenderSettings
    aovs: tuple[str, ...]
    purposes: tuple[str, ...]
    pixel_type: PixelType | None


def plan(engine: Engine, request: Request) -> tuple[Picture, ...]:
    """Return what is to be drawn: the stage's products as the user changes them, or one without.

    Raises:
        UsageError: If there is no file to write to, one for several products, or a flag is wrong.
        StageError: If there is no such camera, product or settings prim.
    """
    camera = _camera_path(engine, request.camera)
    products = engine.products(
        request.settings_prim,
        camera=camera,
        resolution=request.resolution,
        overrides=request.settings,
    )
    if request.product is not None:
        known = ", ".join(product.path for product in products) or "none"
        products = tuple(item for item in products if item.path == request.product)
        if not products:
            raise StageError("--product", request.product, f"a product of the settings: {known}")
    if not products:
        return (_own(engine, request, camera),)
    if request.output and len(products) > 1:
        known = ", ".join(product.path for product in products)
        raise UsageError("-o", f"one file for {len(products)} products", f"--product, of {known}")
    pictures = []
    for product in products:
        if product.kind != "raster":
            raise UsageError(product.path, f"productType {product.kind}", "raster")
        pictures.append(
            _finished(
                output=request.output or product.name,
                where=product.path,
                camera=product.camera or _first_camera(engine),
                framing=product.framing,
                settings=product.settings,
                aovs=request.aovs or product.aovs,
                purposes=request.purposes or product.purposes,
                pixel_type=request.pixel_type,
            )
        )
    return tuple(pictures)


def _own(engine: Engine, request: Request, camera: str | None) -> Picture:
    """The picture of a stage that asks for none."""
    framing = Framing()
    if request.resolution:
        framing = replace(framing, resolution=request.resolution)
    return _finished(
        output=request.output,
        where="render",
        camera=camera or _first_camera(engine),
        framing=framing,
        settings=checked("render", RenderSettings, request.settings),
        aovs=request.aovs or ("color",),
        purposes=request.purposes or PURPOSES,
        pixel_type=request.pixel_type,
    )


def _finished(
    *,
    output: str | None,
    where: str,
    camera: str | None,
    framing: Framing,
    settings: RenderSettings,
    aovs: tuple[str, ...],
    purposes: tuple[str, ...],
    pixel_type: PixelType | None,
) -> Picture:
    """Decide what is left to the file: the colour mode. Refuse what no file could hold."""
    if not output:
        raise UsageError(where, "no file to write", "-o FILE, or productName on the product")
    if settings.color_mode == "auto":
        settings = replace(settings, color_mode=default_color_mode(frame_path(output, 0)))
    for purpose in purposes:
        if purpose not in KNOWN_PURPOSES:
            raise UsageError(f"{where} purposes", repr(purpose), f"of {', '.join(KNOWN_PURPOSES)}")
    names = tuple(aov.name for aov in find_aovs(aovs, where=f"{where} AOVs"))
    picture = Picture(
        output=output,
        camera=camera,
        framing=framing,
        settings=settings,
        aovs=names,
        purposes=purposes,
        pixel_type=pixel_type,
    )
    probe = ImageLayout(
        resolution=framing.resolution,
        aovs=names,
        pixel_type=pixel_type,
        color_space=OUTPUT_SPACE[settings.color_mode],
    )
    open_writer(output, probe)
    return picture


def _camera_path(engine: Engine, name: str | None) -> str | None:
    """The path of the camera the user means; a path is left for the engine to check."""
    if name is None or name.startswith("/"):
        return name
    paths = engine.cameras()
    matching = [path for path in paths if path.rsplit("/", 1)[-1] == name]
    if len(matching) != 1:
        known = ", ".join(matching or paths) or "no camera: the stage has none"
        raise StageError("--camera", repr(name), f"one of {known}" if paths else known)
    return matching[0]


def _first_camera(engine: Engine) -> str | None:
    """The stage's first camera by path; None, for one that frames the scene, when it has none."""
    return next(iter(engine.cameras()), None)
