"""One picture that a stage, or a command line, asks for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import Framing


@dataclass(frozen=True, slots=True, kw_only=True)
class ProductSpec:
    """A UsdRenderProduct with everything that it takes from its RenderSettings."""

    path: str
    """Of the prim."""
    name: str = ""
    """`productName`: the file to write; empty when the prim does not say."""
    kind: str = "raster"
    """`productType`: raster, deepRaster, or a renderer's own."""
    camera: str = ""
    """Path of the camera; empty when neither prim names one."""
    framing: Framing
    settings: RenderSettings
    aovs: tuple[str, ...] = ("color",)
    """Ours, in the order of `orderedVars`."""
    pixel_type: Literal["", "half", "float"] = ""
    """What the `dataType` of its colour vars asks for, the more precise where they differ; empty
    where none says."""
    purposes: tuple[str, ...] = ("default", "render")
    """`includedPurposes`."""
    matte: tuple[tuple[str, bool], ...] = ()
    """Prims that hold out, as `View.matte` has them."""
    warnings: tuple[str, ...] = ()
    """One sentence for each thing that it asks for and does not get."""

    @property
    def multipart(self) -> bool:
        """Whether each AOV is an EXR part of its own."""
        return self.settings.multipart
