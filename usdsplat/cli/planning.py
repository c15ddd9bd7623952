"""Which pictures to draw: what the stage asks for, as its user changes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.knobs import checked
from usdsplat.delegate.engine import PURPOSES, Engine
from usdsplat.delegate.product import ProductSpec
from usdsplat.delegate.render_settings import RenderSettings
from usdsplat.delegate.specs import Framing
from usdsplat.images import default_color_mode, open_writer
from usdsplat.images.aovs import find_aovs
from usdsplat.images.frames import frame_path
from usdsplat.images.layout import ImageLayout, PixelType

OUTPUT_SPACE = {"display": "srgb_rec709_display", "scene": "lin_rec709_scene"}
"""Colour mode -> the space that the pixels of a file are in."""
MAX_SIDE = 65536
"""Pixels on a side of a picture: more is a slip of the finger, not a picture."""
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

    A file that the user names gets one picture: of several products the first.

    Raises:
        UsageError: If there is no file to write to, or a flag is wrong.
        StageError: If there is no such camera, product or settings prim.
    """
    _check_lists(request)
    camera = None if request.camera is None else find_camera(engine, request.camera)
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
    if request.output:
        products = products[:1]
    pictures = []
    for product in products:
        if product.kind != "raster":
            raise UsageError(product.path, f"productType {product.kind}", "raster")
        pictures.append(
            _finished(
                output=request.output or product.name,
                where=product.path,
                camera=_camera_of(engine, product) or _first_camera(engine),
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
    if max(framing.resolution) > MAX_SIDE:
        found = "x".join(str(side) for side in framing.resolution)
        raise UsageError(f"{where} resolution", found, f"at most {MAX_SIDE} pixels on a side")
    if settings.color_mode == "auto":
        settings = replace(settings, color_mode=default_color_mode(frame_path(output, 0)))
    _check_purposes(f"{where} purposes", purposes)
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


def _check_lists(request: Request) -> None:
    """Refuse a wrong name in a list that the user gave."""
    find_aovs(request.aovs or ("color",), where="--aovs")
    _check_purposes("--purposes", request.purposes or ())


def _check_purposes(where: str, purposes: tuple[str, ...]) -> None:
    for purpose in purposes:
        if purpose not in KNOWN_PURPOSES:
            raise UsageError(where, repr(purpose), f"one of {', '.join(KNOWN_PURPOSES)}")


def find_camera(engine: Engine, name: str) -> str:
    """Return the path of the camera that the user means, by its path or its name.

    Raises:
        StageError: If there is none, or several.
    """
    paths = engine.cameras()
    matching = [path for path in paths if name in (path, path.rsplit("/", 1)[-1])]
    if not paths:
        raise StageError("--camera", repr(name), "no --camera, as the stage has none")
    if len(matching) != 1:
        raise StageError("--camera", repr(name), f"one of {', '.join(matching or paths)}")
    return matching[0]


def _camera_of(engine: Engine, product: ProductSpec) -> str:
    """The camera of a product, if it is there."""
    if product.camera and product.camera not in engine.cameras():
        known = ", ".join(engine.cameras()) or "none, as the stage has none"
        raise StageError(f"{product.path}.camera", product.camera, f"one of {known}")
    return product.camera


def _first_camera(engine: Engine) -> str | None:
    """The stage's first camera by path; None, for one that frames the scene, when it has none."""
    return next(iter(engine.cameras()), None)
