"""How to draw: the knobs of a render, each declared once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

from usdsplat.core.knobs import knob, knobs
from usdsplat.render.specs import SortingMode


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderSettings:
    """What `SplatRenderSettingsAPI` holds, and the flags of `usdsplat render`."""

    sorting: Literal["auto", "zDepth", "cameraDistance", "rayHitDistance"] = knob(
        "auto", "order of all splats of a picture; auto follows the prims where they agree"
    )
    rasterize_mode: Literal["auto", "classic", "antialiased"] = knob(
        "auto", "whether the low-pass filter lowers opacity as it widens; auto follows each prim"
    )
    sh_degree: int = knob(4, "highest harmonic degree evaluated", range=(0, 4))
    display_mode: Literal["splats", "points", "ellipses", "normals"] = knob(
        "splats",
        "what is drawn of each splat: points are dots of its colour, ellipses where it covers a "
        "fifth at least, normals its shortest axis in the camera's space as a colour",
    )
    splat_budget: int = knob(
        0,
        "most splats of a view, the least conspicuous are left out; 0 draws all",
        range=(0, 2**31 - 1),
    )
    blend_space: Literal["auto", "linear"] = knob(
        "auto",
        "where splats are blended: auto is the space the captures were trained in, linear the "
        "working space",
    )
    color_mode: Literal["auto", "display", "scene", "inverseView"] = knob(
        "auto",
        "display keeps the space the captures were trained in, scene converts to the working "
        "space, inverseView goes back through the view so that the view shows what was captured; "
        "auto is display in memory and for PNG, scene for EXR",
    )
    working_space: Literal[
        "lin_rec709_scene", "lin_ap1_scene", "lin_ap0_scene", "lin_rec2020_scene", "lin_p3d65_scene"
    ] = knob("lin_rec709_scene", "linear space of scene and inverseView pictures")
    ocio_config: str = knob("", "OCIO config: a file or an ocio:// name; default: $OCIO, or OCIO's")
    ocio_display: str = knob("", "OCIO display; default: the config's first")
    ocio_view: str = knob("", "OCIO view; default: plain sRGB, or the display's first")
    ocio_look: str = knob("", "OCIO looks, with commas between")
    inverse_max: float = knob(
        65504.0, "highest linear value that inverseView makes", range=(1.0, 65504.0)
    )
    samples: int = knob(
        1,
        "pictures averaged over shutter, lens and pixel; 1 is sharp and still",
        range=(1, 4096),
    )
    pixel_filter: Literal["box", "triangle", "gaussian", "blackmanHarris"] = knob(
        "box", "weight of the samples about a pixel's centre"
    )
    filter_width: float = knob(
        0.0, "of the pixel filter; 0 is its own: 1, 2, 3 or 3.3", unit="pixel", range=(0.0, 16.0)
    )
    motion_blur: bool = knob(True, "whether samples are spread over the camera's shutter")
    depth_of_field: bool = knob(True, "whether samples are spread over the camera's lens")
    refinement: int = knob(2, "how often subdivision surfaces are refined", range=(0, 5))
    """For commands to hand to `Engine.set_refinement`: a scene has one level at a time."""
    multipart: bool = knob(False, "whether each AOV is an EXR part of its own")
    deep_error: float = knob(
        0.0,
        "by how much merging neighbours may change the opacity in front of any depth of a deep "
        "pixel",
        range=(0.0, 0.1),
    )

    def resolved(self, hints: Iterable[SortingMode]) -> RenderSettings:
        """Decide what is left to the scene.

        Args:
            hints: The orders that the visible fields ask for. Where all ask for one, `auto` is that
                one, else zDepth.
        """
        sorting, color_mode = self.sorting, self.color_mode
        if sorting == "auto":
            asked = set(hints)
            sorting = asked.pop() if len(asked) == 1 else "zDepth"
        if color_mode == "auto":
            color_mode = "display"
        return replace(self, sorting=sorting, color_mode=color_mode)


def usd_names() -> dict[str, str]:
    """Schema property -> knob, such as `splat:shDegree` -> `sh_degree`."""
    return {_usd_name(item.name): item.name for item in knobs(RenderSettings)}


def _usd_name(name: str) -> str:
    first, *rest = name.split("_")
    return "splat:" + first + "".join(word.capitalize() for word in rest)
