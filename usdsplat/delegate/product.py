"""Requested pictures: render products."""

from __future__ import annotations

from dataclasses import dataclass

from usdsplat.core.findings import Finding
from usdsplat.images.layout import Entry, PixelType
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import Framing, LightRules


@dataclass(frozen=True, slots=True, kw_only=True)
class ProductSpec:
    """A UsdRenderProduct with the values that it inherits from its RenderSettings."""

    path: str
    """Path of the prim."""
    names: tuple[tuple[float, str], ...] = ()
    """`productName`, the file to write, as pairs (first time code, name); empty if not authored."""
    kind: str = "raster"
    """`productType`: raster, deepRaster, or a renderer's own."""
    camera: str = ""
    """Path of the camera; empty if neither prim names one."""
    framing: Framing
    settings: RenderSettings
    own: tuple[str, ...] = ()
    """Names of the values of `settings` that the product itself authors."""
    aovs: tuple[str, ...] = ("color",)
    """Our AOV names, in the order of `orderedVars`."""
    pixel_types: tuple[tuple[str, PixelType], ...] = ()
    """Pairs (AOV, pixel type), for each AOV of which a RenderVar authors a type. If two vars of an
    AOV differ, the type is float. The name "alpha" stands for vars that request only alpha."""
    purposes: tuple[str, ...] = ("default", "render")
    """`includedPurposes`."""
    matte: tuple[tuple[str, bool], ...] = ()
    """Holdout prims, in the form of `View.matte`."""
    light_rules: LightRules = ()
    """See `View.light_rules`."""
    metadata: tuple[tuple[str, Entry], ...] = ()
    """Header entries that the prim adds."""
    findings: tuple[Finding, ...] = ()
    """Requests of the prims that are not fulfilled."""

    @property
    def multipart(self) -> bool:
        """Whether each AOV has a separate EXR part."""
        return self.settings.multipart
