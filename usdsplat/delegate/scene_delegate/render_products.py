"""Read UsdRender passes, settings, products and vars.

Products inherit all values from their settings that they do not author themselves. `RenderSettings`
declares our own attributes under `splat:`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from pxr import Sdf, Usd, UsdRender

from usdsplat.core.errors import StageError
from usdsplat.core.findings import Finding, finding
from usdsplat.core.knobs import checked
from usdsplat.delegate.product import ProductSpec
from usdsplat.delegate.scene_delegate import collections, product_metadata
from usdsplat.delegate.scene_delegate.render_names import ALPHAS, AOVS, LINEAR, working_space
from usdsplat.images.layout import PixelType
from usdsplat.render.framing import CONFORM, data_window
from usdsplat.render.settings import RenderSettings, usd_names
from usdsplat.render.specs import Framing, LightingMode, LightRules
from usdsplat.schema.stage_values import are_finite

HALF_TYPES = {
    "half", "half2", "half3", "half4", "color3h", "color4h", "vector3h", "point3h", "normal3h",
}  # fmt: skip
POLICY = "aspectRatioConformPolicy"
NO_OVERRIDES: Mapping[str, Any] = MappingProxyType({})
DISABLERS = {
    "motion_blur": ("disableMotionBlur", "instantaneousShutter"),
    "depth_of_field": ("disableDepthOfField",),
}
"""Knob -> UsdRender attributes that disable it."""
LIGHT_COLLECTIONS: tuple[tuple[LightingMode, str], ...] = (
    ("captured", "lightCaptured"), ("shadowed", "lightShadowed"), ("relit", "lightRelit"),
)  # fmt: skip
"""Light of splats, and the collection of the prims that have it."""


def find_products(
    stage: Usd.Stage,
    *,
    time: float | None,
    settings_path: str | None,
    camera: str | None,
    resolution: tuple[int, int] | None,
    overrides: Mapping[str, Any],
) -> tuple[ProductSpec, ...]:
    """Implement `Engine.products`, which describes the arguments."""
    found = []
    for spec in read_products(
        stage,
        time=time,
        settings_path=settings_path,
        camera=camera,
        resolution=resolution,
        overrides=overrides,
    ):
        if isinstance(spec, StageError):
            raise spec
        found.append(spec)
    return tuple(found)


def read_products(
    stage: Usd.Stage,
    *,
    time: float | None,
    settings_path: str | None,
    camera: str | None = None,
    resolution: tuple[int, int] | None = None,
    overrides: Mapping[str, Any] = NO_OVERRIDES,
) -> Iterator[ProductSpec | StageError]:
    """Yield each product of the stage's settings, or the error why it cannot be read.

    Args are those of `Engine.products`.

    Raises:
        StageError: If the settings cannot be used.
        UsageError: If an override is invalid.
    """
    prim, render_pass = _sources(stage, settings_path)
    if prim is None:
        return
    findings = () if render_pass is None else _not_honoured(render_pass)
    code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
    for target in UsdRender.Settings(prim).GetProductsRel().GetForwardedTargets():
        product = stage.GetPrimAtPath(target)
        if not product or not product.IsA(UsdRender.Product):
            yield StageError(f"{prim.GetPath()}.products", str(target), "a RenderProduct prim")
            continue
        reader = _Reader(product, prim, render_pass, code)
        try:
            spec = reader.product(camera=camera, resolution=resolution, overrides=overrides)
            yield replace(
                spec, findings=(*findings, *reader.problems(), *reader.foreign(), *reader.renamed())
            )
        except StageError as error:
            yield error


def _sources(stage: Usd.Stage, path: str | None) -> tuple[Usd.Prim | None, Usd.Prim | None]:
    """Return the requested RenderSettings, else the stage's own or first, and their pass.

    The pass is the requested one, or else the only one that renders these settings: passes are
    alternatives, so several need to be named.
    """
    prim = _named(stage, path)
    if prim is not None and prim.IsA(UsdRender.Pass):
        settings = next(filter(None, map(stage.GetPrimAtPath, _rendered_by(prim))), None)
        if not settings or not settings.IsA(UsdRender.Settings):
            raise StageError(f"{prim.GetPath()}.renderSource", "none", "a RenderSettings prim")
        return settings, prim
    if prim is None:
        return None, None
    passes = [
        each
        for each in stage.Traverse()
        if each.IsA(UsdRender.Pass) and prim.GetPath() in _rendered_by(each)
    ]
    return prim, passes[0] if len(passes) == 1 else None


def _named(stage: Usd.Stage, path: str | None) -> Usd.Prim | None:
    """Return the prim at `path`, or without a path the stage's settings."""
    if path is not None:
        prim = stage.GetPrimAtPath(path) if path.startswith("/") else None
        if not prim or not (prim.IsA(UsdRender.Settings) or prim.IsA(UsdRender.Pass)):
            expected = "the path of a RenderSettings prim or a RenderPass"
            raise StageError("render settings", path, expected)
        return prim
    named = UsdRender.Settings.GetStageRenderSettings(stage)
    if named:
        return named.GetPrim()
    return next((prim for prim in stage.Traverse() if prim.IsA(UsdRender.Settings)), None)


def _rendered_by(render_pass: Usd.Prim) -> list[Sdf.Path]:
    """Return the render sources of a pass on its own stage."""
    source = UsdRender.Pass(render_pass)
    if source.GetFileNameAttr().Get():
        return []
    return list(source.GetRenderSourceRel().GetForwardedTargets())


def _not_honoured(render_pass: Usd.Prim) -> tuple[Finding, ...]:
    """Return a finding for each collection of a pass that is not supported."""
    stage, found = render_pass.GetStage(), []
    for name in ("renderVisibility", "cameraVisibility", "prune"):
        held = collections.rules(stage, [Usd.CollectionAPI(render_pass, name)])
        expected = () if name == "prune" else collections.everything(stage)
        if held != expected:
            where = f"{render_pass.GetPath()}.collection:{name}"
            wanted = "all" if expected else "none"
            found.append(finding("unsupported-pass", where, "some prims", wanted))
    return tuple(found)


def _names(attribute: Usd.Attribute) -> tuple[tuple[float, str], ...]:
    """Return the file names of a product with the time codes from which they hold."""
    times = attribute.GetTimeSamples()
    codes = [Usd.TimeCode(time) for time in times] or [Usd.TimeCode.Default()]
    found = zip(times or [0.0], (attribute.Get(code) for code in codes), strict=True)
    return tuple((float(time), str(name)) for time, name in found if name)


class _Reader:
    """Reader of a product and its settings."""

    def __init__(
        self,
        product: Usd.Prim,
        settings: Usd.Prim,
        render_pass: Usd.Prim | None,
        time: Usd.TimeCode,
    ) -> None:
        self._product = product
        self._settings = settings
        self._pass = render_pass
        self._time = time

    def product(
        self,
        *,
        camera: str | None,
        resolution: tuple[int, int] | None,
        overrides: Mapping[str, Any],
    ) -> ProductSpec:
        product = UsdRender.Product(self._product)
        return ProductSpec(
            path=str(self._product.GetPath()),
            names=_names(product.GetProductNameAttr()),
            kind=str(product.GetProductTypeAttr().Get() or UsdRender.Tokens.raster),
            camera=camera or self._camera(),
            framing=self._framing(resolution),
            settings=self._render_settings(overrides),
            own=tuple(self._authored(self._product)),
            aovs=self._aovs(),
            pixel_types=self._pixel_types(),
            matte=self._matte(),
            light_rules=self._light_rules(),
            metadata=product_metadata.entries(self._product, self._time),
            purposes=tuple(map(str, self._value("includedPurposes"))),
        )

    def _value(self, name: str) -> Any:
        """Return an attribute of the product if authored, else of the settings."""
        prim = self._giver(name)
        value = prim.GetAttribute(name).Get(self._time)
        fallback = prim.GetPrimDefinition().GetAttributeFallbackValue(name)
        if isinstance(fallback, float) and isinstance(value, int):
            value = float(value)
        if value is not None and fallback is not None and not isinstance(value, type(fallback)):
            found = f"a value of type {prim.GetAttribute(name).GetTypeName()}"
            expected = f"one of type {type(fallback).__name__}"
            raise StageError(f"{prim.GetPath()}.{name}", found, expected)
        return fallback if value is None else value

    def _giver(self, name: str) -> Usd.Prim:
        """Return the product if it authors an attribute, else the settings."""
        own = self._product.GetAttribute(name)
        return self._product if own and own.HasAuthoredValue() else self._settings

    def _camera(self) -> str:
        for prim in (self._product, self._settings):
            targets = UsdRender.SettingsBase(prim).GetCameraRel().GetForwardedTargets()
            if targets:
                return str(targets[0])
        return ""

    def _framing(self, resolution: tuple[int, int] | None) -> Framing:
        width, height = resolution or self._value("resolution")
        if min(width, height) < 1:
            where = f"{self._giver('resolution').GetPath()}.resolution"
            raise StageError(where, f"({width}, {height})", "at least one pixel on each side")
        window = tuple(self._value("dataWindowNDC"))
        ratio, policy = float(self._value("pixelAspectRatio")), str(self._value(POLICY))
        if not 0 < ratio < math.inf:
            where = f"{self._giver('pixelAspectRatio').GetPath()}.pixelAspectRatio"
            raise StageError(where, f"{ratio:g}", "a positive number")
        if policy not in CONFORM:
            where = f"{self._giver(POLICY).GetPath()}.{POLICY}"
            raise StageError(where, repr(policy), f"one of {', '.join(CONFORM)}")
        return Framing(
            resolution=(int(width), int(height)),
            data_window=data_window(window, (width, height)) if are_finite(window) else None,
            pixel_aspect_ratio=ratio,
            conform=policy,
        )

    def problems(self) -> Iterator[Finding]:
        """Yield a finding for each value that is not usable and is replaced."""
        ndc = self._value("dataWindowNDC")
        if not are_finite(ndc):
            where = f"{self._giver('dataWindowNDC').GetPath()}.dataWindowNDC"
            numbers = ", ".join(f"{each:g}" for each in ndc)
            yield finding("bad-window", where, f"({numbers})", "finite numbers")

        yield from product_metadata.problems(self._product, self._time)
        asked = self._rendering_space()
        if asked and not working_space(asked):
            where = f"{self._settings.GetPath()}.renderingColorSpace"
            yield finding("rendering-space", where, repr(asked), f"one of {', '.join(LINEAR)}")

    def _authored(self, prim: Usd.Prim) -> dict[str, Any]:
        """Return the values of `RenderSettings` that a prim authors."""
        attributes = {knob: prim.GetAttribute(name) for name, knob in usd_names().items()}
        return {
            knob: attribute.Get()
            for knob, attribute in attributes.items()
            if attribute and attribute.HasAuthoredValue()
        }

    def _render_settings(self, overrides: Mapping[str, Any]) -> RenderSettings:
        values = self._authored(self._settings) | self._authored(self._product)
        if product_metadata.is_multipart(self._product):
            values.setdefault("multipart", True)
        if "compression" not in values and (asked := product_metadata.compression(self._product)):
            values["compression"] = asked
        if "working_space" not in values and (space := working_space(self._rendering_space())):
            values["working_space"] = space
        for knob, disablers in DISABLERS.items():
            if any(self._value(name) for name in disablers):
                values[knob] = False
        checked(str(self._product.GetPath()), RenderSettings, values)
        return checked("render settings", RenderSettings, {**values, **overrides})

    def _rendering_space(self) -> str:
        """Return the name of the colour space that the settings render in; "" for none."""
        attribute = self._settings.GetAttribute(UsdRender.Tokens.renderingColorSpace)
        found = attribute.Get() if attribute else None
        return str(found or "")

    def foreign(self) -> tuple[Finding, ...]:
        """Return a finding for each var that is not supported, such as a light path."""
        sources = [
            (str(var.GetPath()), str(var.GetSourceNameAttr().Get())) for var in self._all_vars()
        ]
        names = ", ".join(dict.fromkeys(AOVS.values()))
        return tuple(
            finding("unknown-var", f"{path}.sourceName", repr(name), f"one of {names}")
            for path, name in sources
            if name not in AOVS
        )

    def renamed(self) -> Iterator[Finding]:
        """Yield a finding for each var whose channels should have a name of their own."""
        for aov, var in self._vars():
            attribute = var.GetPrim().GetAttribute("driver:parameters:aov:name")
            name = attribute.Get() if attribute else None
            if name and name != aov:
                where = str(attribute.GetPath())
                yield finding("unsupported-name", where, repr(name), f"channels of {aov}")

    def _vars(self) -> Iterator[tuple[str, UsdRender.Var]]:
        """Yield (our AOV name, var) of the product's supported vars."""
        for var in self._all_vars():
            name = str(var.GetSourceNameAttr().Get())
            if name in AOVS:
                yield AOVS[name], var

    def _all_vars(self) -> Iterator[UsdRender.Var]:
        targets = UsdRender.Product(self._product).GetOrderedVarsRel().GetForwardedTargets()
        for target in targets:
            var = UsdRender.Var(self._product.GetStage().GetPrimAtPath(target))
            if not var:
                where = f"{self._product.GetPath()}.orderedVars"
                raise StageError(where, str(target), "a RenderVar prim")
            yield var

    def _aovs(self) -> tuple[str, ...]:
        """Return the AOVs of the product's vars, once each; colour if there is none."""
        return tuple(dict.fromkeys(name for name, _ in self._vars())) or ("color",)

    def _pixel_types(self) -> tuple[tuple[str, PixelType], ...]:
        """Return the pixel type of each channel group with an authored type.

        Solaris authors the type of the file in an attribute of its own, beside that of the data.
        """
        types: dict[str, PixelType] = {}
        for aov, var in self._vars():
            attribute = var.GetPrim().GetAttribute("driver:parameters:aov:format")
            if not (attribute and attribute.Get()):
                attribute = var.GetDataTypeAttr()
            if not attribute.HasAuthoredValue():
                continue
            found: PixelType = "half" if str(attribute.Get()) in HALF_TYPES else "float"
            key = "alpha" if str(var.GetSourceNameAttr().Get()) in ALPHAS else aov
            if types.setdefault(key, found) != found:
                types[key] = "float"
        return tuple(types.items())

    def _matte(self) -> collections.Rules:
        """Return the holdouts of the product's or the settings' collection, and of the pass's."""
        asked = [collections.applied(self._product, "matte")]
        asked = asked if asked[0] else [collections.applied(self._settings, "matte")]
        asked.append(self._pass and collections.applied(self._pass, "matte"))
        return collections.rules(self._product.GetStage(), filter(None, asked))

    def _light_rules(self) -> LightRules:
        """Return the light of the prims in the product's or the settings' collections."""
        found: list[tuple[LightingMode, collections.Rules]] = []
        for mode, name in LIGHT_COLLECTIONS:
            asked = [collections.applied(each, name) for each in (self._product, self._settings)]
            if first := next(filter(None, asked), None):
                found.append((mode, collections.rules(self._product.GetStage(), [first])))
        return tuple(found)
