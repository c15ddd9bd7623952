"""Describe a user's request, and the resulting plan of each picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from usdsplat.core.findings import Finding
from usdsplat.images.background import Background
from usdsplat.images.frame_numbers import FileName
from usdsplat.images.layout import Entry, PixelType
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import Framing, LightRules

MOST_PIXELS = 65536
"""Maximum size of a side [pixel]; larger values are typing errors."""

NO_NAME = FileName.of("")
"""Name of the files of a plan whose caller names each file."""

Window = tuple[int, int, int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderRequest:
    """Values that replace the stage's own; None keeps the stage's value."""

    output: str | None = None
    """File to write, with a placeholder for the frame number if there are several frames."""
    camera: str | None = None
    """Path of a camera, or its name if it is unique."""
    resolution: tuple[int, int] | None = None
    """Width and height [pixel]."""
    conform: str | None = None
    """A UsdRender aspectRatioConformPolicy token."""
    pixel_aspect: float | None = None
    """Width over height of a pixel."""
    crop: Window | None = None
    """(x0, y0, x1, y1) [pixel], ends exclusive."""
    overscan: Window | None = None
    """Additional pixels at the left, top, right and bottom."""
    aovs: tuple[str, ...] | None = None
    purposes: tuple[str, ...] | None = None
    matte: tuple[str, ...] = ()
    """Paths of mattes in addition to those of the product."""
    catchers: tuple[str, ...] = ()
    """Paths of shadow catchers in addition to prims that are such by themselves."""
    holdout: str | None = None
    """File with the depth of a holdout, with a placeholder for the frame number if there are
    several."""
    pixel_type: PixelType | None = None
    deep: bool = False
    """Whether every contribution to a pixel is kept. A product can request it too."""
    compare: bool = True
    """Whether a deep picture is compared with a flat one."""
    bake_view: bool = False
    """Whether the view transform is applied when a picture is written; PNGs, JPEGs and WebPs always
    have it."""
    is_capture: bool = False
    """Whether a capture is drawn by itself, without a stage: pictures for displays are opaque by
    default."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Values of `RenderSettings`."""
    metadata: Mapping[str, Entry] = field(default_factory=dict)
    """Header entries in addition to those of the product, see `images.user_metadata`."""
    settings_prim: str | None = None
    """Path of the RenderSettings prim to use."""
    product: str | None = None
    """Path of the only product to draw."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PicturePlan:
    """Complete plan of a picture, with one file for each frame."""

    output: FileName = NO_NAME
    """Name of the files; `NO_NAME` if the caller names each file."""
    product: str = ""
    """Path of the RenderProduct; "" for a picture that no product describes."""
    camera: str | None
    """Path of the camera; None for a camera that is given separately or frames the scene."""
    framing: Framing
    settings: RenderSettings
    aovs: tuple[str, ...]
    purposes: tuple[str, ...]
    pixel_type: PixelType | None = None
    pixel_types: tuple[tuple[str, PixelType], ...] = ()
    """Pairs (AOV or "alpha", type) for channels of an EXR with another type than usual."""
    matte: tuple[tuple[str, bool], ...] = ()
    catchers: tuple[tuple[str, bool], ...] = ()
    light_rules: LightRules = ()
    """See `View`, as the two above."""
    holdout: str | None = None
    deep: bool = False
    compare: bool = True
    is_baked: bool = False
    """Whether the view transform is applied when the picture is written."""
    background: Background | None = None
    """Colour behind a picture for displays; None for a transparent one, as every EXR is."""
    metadata: tuple[tuple[str, Entry], ...] = ()
    """Header entries that the user or the product adds."""
    findings: tuple[Finding, ...] = ()
    """Settings of the product that cannot be followed."""

    @property
    def needs_flat(self) -> bool:
        """Whether a deep picture needs the flat one."""
        return self.deep and (self.compare or self.settings.deep_color == "beauty")

    @property
    def rows(self) -> int:
        """Number of rows of pixels."""
        _, y0, _, y1 = self.framing.window
        return y1 - y0
