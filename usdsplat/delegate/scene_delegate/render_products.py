"""UsdRender settings, products and vars.

Products inherit everything from their settings but what they author themselves. Lists of what a
stage may ask for are USD's; what it may ask of us under `splat:` is in `RenderSettings`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pxr import Usd, UsdRender

from usdsplat.core.errors import StageError
from usdsplat.core.knobs import checked
from usdsplat.delegate.framing import data_window
from usdsplat.delegate.product import ProductSpec
from usdsplat.delegate.render_settings import RenderSettings, usd_names
from usdsplat.delegate.specs import Framing

AOVS = {
    "color": "color",
    "Ci": "color",
    "rgba": "color",
    "a": "color",
    "alpha": "color",
    "depth": "depth",
    "cameraDepth": "depth",
    "Z": "depth",
    "z": "depth",
    "Zfront": "depthFront",
    "depthFront": "depthFront",
    "Zexp": "depthExpected",
    "depthExpected": "depthExpected",
    "Neye": "Neye",
    "N": "Neye",
    "P": "P",
    "Pworld": "P",
    "__Pworld": "P",
    "albedo": "albedo",
    "forward": "motionForward",
    "motionForward": "motionForward",
    "backward": "motionBackward",
    "motionBackward": "motionBackward",
    "cryptoObject": "cryptoObject",
    "crypto_object": "cryptoObject",
    "primId": "primId",
    "id": "primId",
    "instanceId": "instanceId",
    "elementId": "elementId",
    "splatId": "elementId",
}
"""`sourceName` of a RenderVar, as Hydra, RenderMan, Arnold and our files spell them -> ours. Names
that others give another meaning (Hydra's `normal`, Arnold's `motionvector`) are not among them."""


def find_products(
    stage: Usd.Stage,
    *,
    time: float | None,
    settings_path: str | None,
    camera: str | None,
    resolution: tuple[int, int] | None,
    overrides: Mapping[str, Any],
) -> tuple[ProductSpec, ...]:
    """Implements `Engine.products`, where the arguments are described."""
    prim = _settings_prim(stage, settings_path)
    if prim is None:
        return ()
    code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
    found = []
    for target in UsdRender.Settings(prim).GetProductsRel().GetForwardedTargets():
        product = stage.GetPrimAtPath(target)
        if not product or not product.IsA(UsdRender.Product):
            raise StageError(f"{prim.GetPath()}.products", str(target), "a RenderProduct prim")
        reader = _Reader(product, prim, code)
        found.append(reader.product(camera=camera, resolution=resolution, overrides=overrides))
    return tuple(found)


def _settings_prim(stage: Usd.Stage, path: str | None) -> Usd.Prim | None:
    """The RenderSettings asked for, or the stage's own, or its first."""
    if path is not None:
        prim = stage.GetPrimAtPath(path) if path.startswith("/") else None
        if not prim or not prim.IsA(UsdRender.Settings):
            raise StageError("render settings", path, "the path of a RenderSettings prim")
        return prim
    named = UsdRender.Settings.GetStageRenderSettings(stage)
    if named:
        return named.GetPrim()
    return next((prim for prim in stage.Traverse() if prim.IsA(UsdRender.Settings)), None)


class _Reader:
    """Reads one product through its settings."""

    def __init__(self, product: Usd.Prim, settings: Usd.Prim, time: Usd.TimeCode) -> None:
        self._product = product
        self._settings = settings
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
            name=str(product.GetProductNameAttr().Get(self._time) or ""),
            kind=str(product.GetProductTypeAttr().Get() or UsdRender.Tokens.raster),
            camera=camera or self._camera(),
            framing=self._framing(resolution),
            settings=self._render_settings(overrides),
            aovs=self._aovs(),
            purposes=tuple(map(str, self._value("includedPurposes"))),
        )

    def _value(self, name: str) -> Any:
        """An attribute of the product if it authors one, else of the settings."""
        own = self._product.GetAttribute(name)
        prim = self._product if own and own.HasAuthoredValue() else self._settings
        value = prim.GetAttribute(name).Get(self._time)
        blocked = value is None
        return prim.GetPrimDefinition().GetAttributeFallbackValue(name) if blocked else value

    def _camera(self) -> str:
        for prim in (self._product, self._settings):
            targets = UsdRender.SettingsBase(prim).GetCameraRel().GetForwardedTargets()
            if targets:
                return str(targets[0])
        return ""

    def _framing(self, resolution: tuple[int, int] | None) -> Framing:
        width, height = resolution or self._value("resolution")
        return Framing(
            resolution=(int(width), int(height)),
            data_window=data_window(tuple(self._value("dataWindowNDC")), (width, height)),
            pixel_aspect_ratio=float(self._value("pixelAspectRatio")),
            conform=str(self._value("aspectRatioConformPolicy")),
        )

    def _render_settings(self, overrides: Mapping[str, Any]) -> RenderSettings:
        values = {}
        for prim in (self._settings, self._product):
            for name, knob in usd_names().items():
                attribute = prim.GetAttribute(name)
                if attribute and attribute.HasAuthoredValue():
                    values[knob] = attribute.Get()
        checked(str(self._product.GetPath()), RenderSettings, values)
        return checked("render settings", RenderSettings, {**values, **overrides})

    def _aovs(self) -> tuple[str, ...]:
        """Ours for each of the product's vars, once each; the colour when it lists none."""
        found = []
        targets = UsdRender.Product(self._product).GetOrderedVarsRel().GetForwardedTargets()
        for target in targets:
            var = UsdRender.Var(self._product.GetStage().GetPrimAtPath(target))
            if not var:
                where = f"{self._product.GetPath()}.orderedVars"
                raise StageError(where, str(target), "a RenderVar prim")
            name = str(var.GetSourceNameAttr().Get())
            if name not in AOVS:
                expected = f"one of {', '.join(AOVS)}"
                raise StageError(f"{target}.sourceName", repr(name), expected)
            found.append(AOVS[name])
        return tuple(dict.fromkeys(found)) or ("color",)
