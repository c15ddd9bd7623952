"""One picture that a stage, or a command line, asks for."""

from __future__ import annotations

from dataclasses import dataclass

from usdsplat.delegate.render_settings import RenderSettings
from usdsplat.delegate.specs import Framing


@dataclass(frozen=True, slots=True, kw_only=True)
class ProductSpec:
    """A UsdRenderProduct with everything that it takes from its RenderSettings."""

    path: str
    """Of the prim."""
    name: str = ""
    """`productName`: the file to write; empty when the prim does not say."""
    kind: str = "raster"
    """`productType`."""
    camera: str = ""
    """Path of the camera; empty when neither prim names one."""
    framing: Framing
    settings: RenderSettings
    aovs: tuple[str, ...] = ("color",)
    """Ours, in the order of `orderedVars`."""
    purposes: tuple[str, ...] = ("default", "render")
    """`includedPurposes`."""
