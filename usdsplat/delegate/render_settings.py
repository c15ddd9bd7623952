"""How to draw: the knobs of a render, each declared once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

from usdsplat.core.knobs import knob, knobs
from usdsplat.delegate.specs import SortingMode


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderSettings:
    """What `SplatRenderSettingsAPI` holds, and the flags of `usdsplat render`."""

    sorting: Literal["auto", "zDepth", "cameraDistance"] = knob(
        "auto", "order of all splats of a picture; auto follows the prims where they agree"
    )
    rasterize_mode: Literal["auto", "classic", "antialiased"] = knob(
        "auto", "whether the low-pass filter lowers opacity as it widens; auto follows each prim"
    )
    sh_degree: int = knob(4, "highest harmonic degree evaluated", range=(0, 4))
    color_mode: Literal["auto", "display", "scene"] = knob(
        "auto",
        "display keeps the space the captures were trained in, scene converts to the linear "
        "rendering space; auto is display in memory and for PNG, scene for EXR",
    )

    def resolved(self, hints: Iterable[SortingMode]) -> RenderSettings:
        """Decide what is left to the scene.

        Args:
            hints: The orders that the visible fields ask for. Where all ask for one that can be
                had, `auto` is that one, else zDepth.
        """
        sorting, color_mode = self.sorting, self.color_mode
        if sorting == "auto":
            sorting = "cameraDistance" if set(hints) == {"cameraDistance"} else "zDepth"
        if color_mode == "auto":
            color_mode = "display"
        return replace(self, sorting=sorting, color_mode=color_mode)


def usd_names() -> dict[str, str]:
    """Schema property -> knob, such as `splat:shDegree` -> `sh_degree`."""
    return {_usd_name(item.name): item.name for item in knobs(RenderSettings)}


def _usd_name(name: str) -> str:
    first, *rest = name.split("_")
    return "splat:" + first + "".join(word.capitalize() for word in rest)
