"""What a user asks for, and the plan of each picture that results from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from usdsplat.images.layout import PixelType
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import Framing

MOST_PIXELS = 65536
"""Of a side: more is a slip of the finger, not a picture."""

Window = tuple[int, int, int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderRequest:
    """A user's wishes that replace what the stage says; None keeps what the stage says."""

    output: str | None = None
    """File to write, with a place for the frame number when there are several frames."""
    camera: str | None = None
    """Path of a camera, or its name where there is one of that name."""
    resolution: tuple[int, int] | None = None
    """[pixel]"""
    conform: str | None = None
    """A UsdRender aspectRatioConformPolicy token."""
    pixel_aspect: float | None = None
    """Width over height of a pixel."""
    crop: Window | None = None
    """(x0, y0, x1, y1) [pixel], ends exclusive."""
    overscan: Window | None = None
    """Pixels more at the left, top, right and bottom."""
    aovs: tuple[str, ...] | None = None
    purposes: tuple[str, ...] | None = None
    matte: tuple[str, ...] = ()
    """Paths of prims that hold out, besides those of the product."""
    holdout: str | None = None
    """File with depth that holds out, with a place for the frame number if there are several."""
    pixel_type: PixelType | None = None
    deep: bool = False
    """Whether every contribution to a pixel is kept; a product may ask for it too."""
    deep_compression: str | None = None
    compare: bool = True
    """Whether a deep picture is compared with a flat one."""
    bake_view: bool = False
    """Whether a picture goes through the view when it is written; PNGs always do."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Values of `RenderSettings`."""
    settings_prim: str | None = None
    """Path of the RenderSettings to follow."""
    product: str | None = None
    """Path of the one product to draw."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PicturePlan:
    """A picture with everything decided; one file for each frame."""

    output: str = ""
    """File, with a place for the frame number; empty where whoever draws names each file."""
    camera: str | None
    """Path of the camera; None for one that is given, or that frames the scene."""
    framing: Framing
    settings: RenderSettings
    aovs: tuple[str, ...]
    purposes: tuple[str, ...]
    pixel_type: PixelType | None = None
    matte: tuple[tuple[str, bool], ...] = ()
    holdout: str | None = None
    deep: bool = False
    deep_compression: str = "none"
    compare: bool = True
    is_baked: bool = False
    """Whether it goes through the view when it is written."""
    warnings: tuple[str, ...] = ()
    """One sentence for each thing that its product asks for and does not get."""

    @property
    def rows(self) -> int:
        """Number of rows of pixels."""
        _, y0, _, y1 = self.framing.window
        return y1 - y0
