"""Declare the knobs of a render, each once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

from usdsplat.core.knobs import knob, knobs
from usdsplat.images.cryptomatte import RANK
from usdsplat.render.specs import SortingMode

FILE_KNOBS = (
    "compression", "tile_size", "empty_depth", "multipart", "crypto_rank", "deep_error",
    "deep_color", "background", "png_bits", "jpeg_quality", "start_timecode",
)  # fmt: skip
"""Knobs of files, which views in a window do not offer."""

NODE_MEMORY = 4096
"""Memory limit of the nodes of splat trees, where the settings have none [MiB]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderSettings:
    """Settings of a render: the properties of `SplatRenderSettingsAPI` and the flags of `usdsplat
    render`."""

    sorting: Literal["auto", "zDepth", "cameraDistance", "rayHitDistance"] = knob(
        "auto", "order of all splats of a picture; auto follows the prims if they agree"
    )
    rasterize_mode: Literal["auto", "classic", "antialiased", "footprint"] = knob(
        "auto",
        "how the low-pass filter, which enlarges small splats, changes opacity: classic keeps it, "
        "antialiased lowers it to preserve the sum, footprint keeps it as far as the photographs' "
        "pixels enlarged the splat, where their size is authored; auto follows each prim",
    )
    sh_degree: int = knob(4, "highest harmonic degree evaluated", range=(0, 4))
    display_mode: Literal["splats", "points", "ellipses", "normals"] = knob(
        "splats",
        "how each splat is drawn: points are dots of its colour, ellipses cover the area "
        "where its opacity reaches a fifth, normals show its shortest axis in camera space as a "
        "colour",
    )
    splat_budget: int = knob(
        0,
        "maximum number of splats in a view; those with the smallest opacity times size are left "
        "out; nodes of splat trees that fade into their children come on top; 0 draws all",
        range=(0, 2**31 - 1),
    )
    lod_error: float = knob(
        1.0,
        "largest error of a node of a splat tree that is drawn in place of its children; smaller "
        "values draw finer levels, 0 draws the capture itself",
        unit="pixel",
        range=(0.0, 1000.0),
    )
    lod_samples: int = knob(
        2,
        "number of samples along each axis of a pixel for the coarse levels of splat trees",
        range=(1, 8),
    )
    node_wait: bool = knob(
        True,
        "whether a picture waits until the levels that it needs are read; otherwise coarser ones "
        "are drawn in their place",
    )
    node_memory: int = knob(
        0,
        "memory for the splats of splat trees; those that were used last are kept; 0 is half of "
        "the command's memory limit, or 4096 without one",
        unit="MiB",
        range=(0, 2**31 - 1),
    )
    node_lifetime: float = knob(
        5.0,
        "time for which the splats of a splat tree are kept after their last use",
        unit="s",
        range=(0.0, 1e6),
    )
    lighting: Literal["captured", "shadowed", "relit"] = knob(
        "captured",
        "light of splats: captured shows them as they were photographed; shadowed darkens them "
        "where other prims stand between them and the lights of the stage, and surfaces cast and "
        "receive shadows; relit also replaces the light of the photographs by that of the stage",
    )
    ambient: float = knob(
        0.2,
        "light that no light of the stage explains, as a part of the mean irradiance of a field; "
        "it keeps shadows on splats and on shadow catchers from being black",
        range=(0.0, 100.0),
    )
    self_shadows: bool = knob(
        False,
        "whether splats of a field cast shadows on others of the same field; a capture already "
        "shows the shadows of its own day",
    )
    shadow_resolution: int = knob(
        2048,
        "longer side of the pictures that lights take of meshes, whose shadows are sharp to a "
        "pixel of them; shadows of splats do not depend on it",
        unit="pixel",
        range=(16, 16384),
    )
    light_samples: int = knob(
        16,
        "number of directions or points that stand for a light with an extent; more make penumbras "
        "smoother",
        range=(1, 4096),
    )
    dome_samples: int = knob(
        128,
        "number of directions in which the sky of a dome light is looked for; more make its "
        "shadows smoother, and its brightness does not depend on it",
        range=(1, 4096),
    )
    blend_space: Literal["auto", "linear"] = knob(
        "auto",
        "colour space in which splats are blended: auto is the space the captures were trained in, "
        "linear is the working space",
    )
    color_mode: Literal["auto", "display", "scene", "inverseView"] = knob(
        "auto",
        "display keeps the space the captures were trained in, scene converts to the working "
        "space, inverseView applies the inverse of the view so that the view shows the captured "
        "colours; auto is scene for EXR, else display",
    )
    working_space: Literal[
        "lin_rec709_scene", "lin_ap1_scene", "lin_ap0_scene", "lin_rec2020_scene", "lin_p3d65_scene"
    ] = knob("lin_rec709_scene", "linear space of scene and inverseView pictures")
    ocio_config: str = knob("", "OCIO config: a file or an ocio:// name; default: $OCIO, or OCIO's")
    ocio_display: str = knob("", "OCIO display; default: the config's first")
    ocio_view: str = knob("", "OCIO view; default: plain sRGB, or the display's first")
    ocio_look: str = knob("", "OCIO looks, separated by commas")
    inverse_max: float = knob(
        65504.0, "highest linear value that inverseView produces", range=(1.0, 65504.0)
    )
    samples: int = knob(
        1,
        "number of pictures averaged over shutter, lens and pixel; 1 has no blur",
        range=(1, 4096),
    )
    pixel_filter: Literal["box", "triangle", "gaussian", "blackmanHarris"] = knob(
        "box", "weight of the samples around a pixel's centre"
    )
    filter_width: float = knob(
        0.0,
        "width of the pixel filter; 0 selects the filter's default: 1, 2, 3 or 3.3",
        unit="pixel",
        range=(0.0, 16.0),
    )
    motion_blur: bool = knob(True, "whether samples are spread over the camera's shutter")
    depth_of_field: bool = knob(True, "whether samples are spread over the camera's lens")
    refinement: int = knob(2, "refinement level of subdivision surfaces", range=(0, 5))
    """Commands pass it to `Engine.set_refinement`: a scene has one level at a time."""
    compression: str = knob(
        "",
        "compression of EXRs: none, rle, zips, zip, piz, or the lossy dwaa and dwab with an "
        "optional level, such as dwaa:45; deep EXRs take none and zips; default: zip, deep none",
    )
    tile_size: int = knob(
        0, "side of the tiles of flat EXRs; 0 writes scan lines", unit="pixel", range=(0, 4096)
    )
    empty_depth: Literal["inf", "0", "far"] = knob(
        "inf", "depth of empty pixels in EXRs; far is the camera's far clipping plane"
    )
    multipart: bool = knob(False, "whether each AOV is written as a separate EXR part")
    crypto_rank: int = knob(
        RANK,
        "number of pairs of id and coverage that each pixel of a Cryptomatte has; four channels "
        "hold two, so an odd number is rounded up",
        range=(2, 16),
    )
    deep_error: float = knob(
        0.0,
        "merge neighbouring deep samples while the opacity in front of any depth changes by this "
        "or less; 0 merges none",
        range=(0.0, 0.1),
    )
    deep_color: Literal["scene", "beauty"] = knob(
        "scene",
        "colour of deep samples: scene is that of their splats, beauty scales it in each pixel so "
        "that the flattened samples equal the flat picture of the same blend space; opacities stay "
        "the same",
    )
    background: str = knob(
        "auto",
        "colour behind a picture for displays: transparent, black, grey, white, #rrggbb, or r,g,b "
        "from 0 to 1, in code values of the display; auto is grey for a capture that is rendered "
        "by itself and for JPEG, else transparent; EXRs are always transparent",
    )
    png_bits: Literal["8", "16"] = knob("8", "bits of each channel of a PNG")
    jpeg_quality: int = knob(
        95, "quality of JPEG and WebP pictures; a WebP of 100 is lossless", range=(1, 100)
    )
    start_timecode: str = knob(
        "",
        "SMPTE time code of the stage's startTimeCode, such as 01:00:00:00; default: frame 0 is "
        "00:00:00:00",
    )

    @property
    def node_bytes(self) -> int:
        """Maximum size of the splats of splat trees in memory [byte]."""
        return (self.node_memory or NODE_MEMORY) << 20

    def resolved(self, hints: Iterable[SortingMode]) -> RenderSettings:
        """Return the settings with auto values resolved from the scene.

        Args:
            hints: The sorting modes authored on the visible fields. If all are equal, `auto` is
                that mode, otherwise zDepth.
        """
        sorting, color_mode = self.sorting, self.color_mode
        if sorting == "auto":
            asked = set(hints)
            sorting = asked.pop() if len(asked) == 1 else "zDepth"
        if color_mode == "auto":
            color_mode = "display"
        return replace(self, sorting=sorting, color_mode=color_mode)


def usd_names() -> dict[str, str]:
    """Return schema property -> knob, such as `splat:shDegree` -> `sh_degree`."""
    return {_usd_name(item.name): item.name for item in knobs(RenderSettings)}


def _usd_name(name: str) -> str:
    first, *rest = name.split("_")
    return "splat:" + first + "".join(word.capitalize() for word in rest)
