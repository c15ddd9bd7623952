"""Plan the pictures to draw: the stage's products with the user's changes."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.findings import Finding, finding
from usdsplat.core.knobs import checked
from usdsplat.delegate.engine import PURPOSES, Engine
from usdsplat.delegate.product import ProductSpec
from usdsplat.images import COLOR_MODES, default_color_mode, open_writer
from usdsplat.images.aovs import find_aovs
from usdsplat.images.background import (
    AUTO,
    TRANSPARENT,
    Background,
    background_source,
    normalized,
    parse_background,
)
from usdsplat.images.compression import DEEP_COMPRESSIONS
from usdsplat.images.deep_aovs import ALWAYS, DEEP_AOVS
from usdsplat.images.frame_numbers import FileName, frame_path
from usdsplat.images.layout import PixelType
from usdsplat.products import remarks
from usdsplat.products.header import layout_of, start_offset
from usdsplat.products.request import MOST_PIXELS, PicturePlan, RenderRequest
from usdsplat.render.framing import CONFORM
from usdsplat.render.output import view_of
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import Framing

KNOWN_PURPOSES = ("default", "render", "proxy", "guide")
KINDS = ("raster", "deepRaster")
"""Supported `productType` values."""
NO_PRODUCT = "render"
"""Name in messages of the picture of a stage without products."""


def plan_pictures(engine: Engine, request: RenderRequest) -> tuple[PicturePlan, ...]:
    """Return the pictures to draw: the stage's products with the user's changes.

    A stage without products gets one picture. If the user names a file, there is also only one
    picture, that of the first product.

    Raises:
        UsageError: If no output file is given, or a flag is wrong.
        StageError: If the camera, product or settings prim does not exist.
    """
    _check(request)
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
    if request.output:
        products = products[:1]
    pictures = tuple(plan_product(engine, request, product) for product in products)
    pictures = pictures or (plan_default(engine, request, camera),)
    _check_background(request, pictures)
    if any(picture.deep for picture in pictures):
        return pictures
    first = pictures[0]
    unused = remarks.only_for_deep(NO_PRODUCT, first.settings, request.settings)
    return replace(first, findings=(*first.findings, *unused)), *pictures[1:]


def plan_default(engine: Engine, request: RenderRequest, camera: str | None = None) -> PicturePlan:
    """Plan the picture of a stage without products, by default of its first camera."""
    spec = ProductSpec(
        path=NO_PRODUCT,
        framing=replace(Framing(), resolution=request.resolution or Framing().resolution),
        settings=checked("render", RenderSettings, request.settings),
        purposes=PURPOSES,
    )
    return _finished(engine, request, spec, camera or _first_camera(engine))


def plan_product(engine: Engine, request: RenderRequest, product: ProductSpec) -> PicturePlan:
    """Plan the picture of a product.

    Raises:
        UsageError: If the product cannot be drawn as requested.
        StageError: If its camera does not exist.
    """
    if product.kind not in KINDS:
        raise UsageError(product.path, f"productType {product.kind}", " or ".join(KINDS))
    camera = _camera_of(engine, product) or _first_camera(engine)
    return _finished(engine, request, product, camera)


def _finished(
    engine: Engine, request: RenderRequest, spec: ProductSpec, camera: str | None
) -> PicturePlan:
    """Complete a plan: choose the colour mode by the file, and check what the file can hold."""
    where, name = spec.path, _name_of(request, spec)
    output = str(name)
    deep = request.deep or spec.kind == "deepRaster"
    findings = spec.findings
    suited = default_color_mode(frame_path(output, 0))
    names = tuple(aov.name for aov in find_aovs(request.aovs or spec.aovs, where=f"{where} AOVs"))
    for_display = suited == "display"
    if for_display and not request.aovs and "color" in names and len(names) > 1:
        found = f"{', '.join(aov for aov in names if aov != 'color')} in a {_kind(output)}"
        findings = (*findings, finding("png-aovs", where, found, "only color"))
        names = ("color",)
    if deep:
        others = [name for name in names if name not in DEEP_AOVS]
        _check_deep(request, output, others)
        if others:
            found = f"{', '.join(others)} in a deep picture"
            expected = f"only {', '.join(DEEP_AOVS)}"
            findings = (*findings, finding("deep-aovs", where, found, expected))
        names = ("color", *(name for name in names if name in DEEP_AOVS and name not in ALWAYS))
        findings = (*findings, *remarks.without_effect(where, spec.settings))
    else:
        own = set(spec.own).difference(request.settings)
        findings = (*findings, *remarks.only_for_deep(where, spec.settings, own))
    settings = spec.settings
    if request.deep and "compression" not in request.settings and settings.compression:
        settings, lacking = _with_deep_compression(settings, where)
        findings = (*findings, *lacking)
    if deep or settings.color_mode == "auto":
        through_view = for_display and (request.bake_view or _names_view(settings))
        settings = replace(settings, color_mode="scene" if deep or through_view else suited)
    is_baked = settings.color_mode != "display" and (for_display or request.bake_view)
    if not deep:  # `without_effect` names the view of a deep picture
        settings, unused = _with_config(settings, where, is_baked=is_baked, for_display=for_display)
        findings = (*findings, *unused)
    _check_view(settings, is_from_variable=settings.ocio_config != spec.settings.ocio_config)
    start_offset(settings, engine.stage_info())  # raises an error if the time code does not exist
    _check_purposes(f"{where} purposes", request.purposes or spec.purposes)
    picture = PicturePlan(
        output=name,
        product=spec.path if spec.path != NO_PRODUCT else "",
        camera=camera,
        framing=_framing(request, spec.framing, where),
        settings=settings,
        aovs=names,
        purposes=request.purposes or spec.purposes,
        pixel_type=request.pixel_type or _pixel_type(spec, settings, _kind(output)),
        pixel_types=_pixel_types(request, spec),
        matte=(*spec.matte, *((path, True) for path in request.matte)),
        catchers=tuple((path, True) for path in request.catchers),
        light_rules=spec.light_rules,
        holdout=request.holdout,
        deep=deep,
        compare=request.compare,
        is_baked=is_baked,
        background=_background(request, settings, _kind(output)),
        metadata=tuple({**dict(spec.metadata), **request.metadata}.items()),
        findings=findings,
    )
    layout = layout_of(picture)
    if deep:
        from usdsplat.images.deep import DeepWriter

        DeepWriter(output, layout)
    else:
        open_writer(output, layout)
    return picture


def _names_view(settings: RenderSettings) -> bool:
    """Return whether a view or its config is named."""
    names = (settings.ocio_display, settings.ocio_view, settings.ocio_look, settings.ocio_config)
    return any(names)


def _with_config(
    settings: RenderSettings, where: str, *, is_baked: bool, for_display: bool
) -> tuple[RenderSettings, tuple[Finding, ...]]:
    """Apply $OCIO, which names the config of a picture that is drawn through a view.

    It does not decide whether there is a view, so that captured colours are the same everywhere.

    Returns:
        The settings, and a note if a named view or config has no effect, or if the variable has
        none on a picture for displays.
    """
    config = os.environ.get("OCIO", "")
    names = (settings.ocio_display, settings.ocio_view, settings.ocio_look)
    if settings.color_mode == "scene" and not is_baked and _names_view(settings):
        found = next(filter(None, (*names, settings.ocio_config)))
        expected = f"a picture through a view: --bake-view for {where}"
        return settings, (finding("unused-view", where, found, expected),)
    if not config or settings.ocio_config:
        return settings, ()
    if any(names) or is_baked or settings.color_mode == "inverseView":
        return replace(settings, ocio_config=config), ()
    unused = finding("unused-config", "$OCIO", config, f"a view for {where}: --view NAME")
    return settings, (unused,) if for_display or settings.color_mode == "display" else ()


def _with_deep_compression(
    settings: RenderSettings, where: str
) -> tuple[RenderSettings, tuple[Finding, ...]]:
    """Leave out the compression of a flat product that is requested as a deep picture, with a
    finding, if deep files cannot have it."""
    if settings.compression in DEEP_COMPRESSIONS:
        return settings, ()
    expected = " or ".join(DEEP_COMPRESSIONS)
    found = f"compression {settings.compression!r} in a deep picture"
    return replace(settings, compression=""), (finding("product-metadata", where, found, expected),)


def _check_view(settings: RenderSettings, *, is_from_variable: bool) -> None:
    """Raise an error if the view of a picture does not exist."""
    try:
        view_of(settings)
    except UsageError as error:
        if is_from_variable and error.where == "ocio_config":
            raise UsageError("$OCIO", error.found, error.expected) from None
        raise


def _kind(output: str) -> str:
    """Return the name of a format: PNG, JPEG, WebP or EXR."""
    suffix = Path(output).suffix.lower()
    return {".jpg": "JPEG", ".jpeg": "JPEG", ".webp": "WebP"}.get(suffix, suffix[1:].upper())


def _pixel_type(spec: ProductSpec, settings: RenderSettings, kind: str) -> PixelType | None:
    """Return the type of the colour channels; the types of RenderVars apply to EXRs only."""
    if kind == "EXR":
        return dict(spec.pixel_types).get("color")
    return "uint16" if kind == "PNG" and settings.png_bits == "16" else "uint8"


def _background(request: RenderRequest, settings: RenderSettings, kind: str) -> Background | None:
    """Return the colour behind a picture; None for a transparent one.

    Raises:
        UsageError: If the text is no colour, or the format has no alpha and none is given.
    """
    where = background_source(is_requested="background" in request.settings)
    auto = "grey" if request.is_capture or kind == "JPEG" else TRANSPARENT
    found = parse_background(settings.background, auto=auto, where=where)
    if found is None and kind == "JPEG":
        raise UsageError(where, f"{TRANSPARENT} for a JPEG", "a colour, or .png or .webp")
    return None if kind == "EXR" else found


def _check_background(request: RenderRequest, pictures: Sequence[PicturePlan]) -> None:
    """Raise an error if a colour is requested and all pictures are EXRs, which have none."""
    text = normalized(str(request.settings.get("background", AUTO)))
    if text in (AUTO, TRANSPARENT):
        return
    if all(_kind(str(picture.output)) == "EXR" for picture in pictures):
        expected = "a PNG, JPEG or WebP: an EXR keeps its alpha for compositing"
        raise UsageError("--background", f"{text} for an EXR", expected)


def _pixel_types(request: RenderRequest, spec: ProductSpec) -> tuple[tuple[str, PixelType], ...]:
    """Return the types of other channels than colour; --half and --float decide for alpha."""
    decided = ("color", "alpha") if request.pixel_type else ("color",)
    return tuple(
        (name if name == "alpha" else find_aovs((name,), where=spec.path)[0].name, kind)
        for name, kind in spec.pixel_types
        if name not in decided
    )


def _name_of(request: RenderRequest, spec: ProductSpec) -> FileName:
    """Return the name of a picture's files: the requested one, else the product's."""
    name = FileName.of(request.output) if request.output else FileName(spec.names)
    if not name.samples:
        raise UsageError(spec.path, "no output file", "-o FILE, or productName on the product")
    suffixes = sorted({Path(pattern).suffix.lower() for _, pattern in name.samples})
    if len(suffixes) > 1:
        raise StageError(f"{spec.path}.productName", " and ".join(suffixes), "one suffix")
    return name


def _check_deep(request: RenderRequest, output: str, others: list[str]) -> None:
    """Raise an error for options that do not apply to a deep picture."""
    if default_color_mode(frame_path(output, 0)) != COLOR_MODES[".exr"]:
        raise UsageError(output, "a deep picture", "the suffix .exr")
    if request.bake_view:
        raise UsageError("--bake-view", "a deep picture", "a flat one: views are not linear")
    if request.aovs and others:
        expected = f"some of {', '.join(DEEP_AOVS)} in a deep picture"
        raise UsageError("--aovs", ",".join(others), expected)


def _framing(request: RenderRequest, framing: Framing, where: str) -> Framing:
    """Return the product's framing with the user's changes."""
    if request.conform is not None:
        framing = replace(framing, conform=request.conform)
    if request.pixel_aspect is not None:
        framing = replace(framing, pixel_aspect_ratio=request.pixel_aspect)
    if request.crop is not None:
        framing = replace(framing, data_window=request.crop)
    if request.overscan is not None:
        left, top, right, bottom = request.overscan
        width, height = framing.resolution
        framing = replace(framing, data_window=(-left, -top, width + right, height + bottom))
    x0, y0, x1, y1 = framing.window
    for sides in (framing.resolution, (x1 - x0, y1 - y0)):
        if max(sides) > MOST_PIXELS:
            found = "x".join(map(str, sides))
            raise UsageError(
                f"{where} resolution", found, f"at most {MOST_PIXELS} pixels on a side"
            )
    return framing


def _check(request: RenderRequest) -> None:
    """Raise an error for options that are invalid or contradict each other."""
    find_aovs(request.aovs or ("color",), where="--aovs")
    _check_purposes("--purposes", request.purposes or ())
    if request.conform not in (None, *CONFORM):
        raise UsageError("--conform", repr(request.conform), f"one of {', '.join(CONFORM)}")
    if request.pixel_aspect is not None and not 0.01 <= request.pixel_aspect <= 100:
        raise UsageError("--pixel-aspect", f"{request.pixel_aspect:g}", "0.01 to 100")
    if request.crop is not None and request.overscan is not None:
        raise UsageError("--crop", "--overscan too", "one of them")


def _check_purposes(where: str, purposes: tuple[str, ...]) -> None:
    for purpose in purposes:
        if purpose not in KNOWN_PURPOSES:
            raise UsageError(where, repr(purpose), f"one of {', '.join(KNOWN_PURPOSES)}")


def find_camera(engine: Engine, name: str) -> str:
    """Return the path of a camera, given its path or its name.

    Raises:
        StageError: If there is no such camera, or several.
    """
    paths = engine.cameras()
    matching = [path for path in paths if name in (path, path.rsplit("/", 1)[-1])]
    if not paths:
        raise StageError("--camera", repr(name), "no --camera, because the stage has none")
    if len(matching) != 1:
        raise StageError("--camera", repr(name), f"one of {', '.join(matching or paths)}")
    return matching[0]


def _camera_of(engine: Engine, product: ProductSpec) -> str:
    """Return the camera of a product, and check that it exists."""
    if product.camera and product.camera not in engine.cameras():
        known = ", ".join(engine.cameras()) or "none, because the stage has none"
        raise StageError(f"{product.path}.camera", product.camera, f"one of {known}")
    return product.camera


def _first_camera(engine: Engine) -> str | None:
    """Return the stage's first camera by path, or None if it has none."""
    return next(iter(engine.cameras()), None)
