"""Layout of an image file, given before the first pixel arrives."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Literal

import numpy as np
import numpy.typing as npt

from usdsplat.images import cryptomatte
from usdsplat.images.aovs import aov_named
from usdsplat.images.background import Background
from usdsplat.images.timecode import Timecode

PixelType = Literal["half", "float", "uint8", "uint16"]
Entry = str | int | float | tuple[float, ...] | Fraction | Timecode
"""Value of a header entry; 16 numbers are a matrix in the file format's convention."""
Metadata = Mapping[str, Entry]
Band = Mapping[str, npt.NDArray[np.generic]]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImageLayout:
    """Size, contents and metadata of an image. Pixel (0, 0) is the display window's top left."""

    resolution: tuple[int, int]
    """Display window, width and height [pixel]."""
    data_window: tuple[int, int, int, int] | None = None
    """Data window (x0, y0, x1, y1) [pixel], end exclusive; None is the display window. It may lie
    inside the display window (crop) or extend beyond it (overscan)."""
    pixel_aspect_ratio: float = 1.0
    """Width over height of a pixel."""
    aovs: tuple[str, ...] = ("color",)
    """Names of AOVs, see `aovs.aov_named`."""
    pixel_type: PixelType | None = None
    """Type of colour channels; None is the format's default: half in EXR, else uint8."""
    pixel_types: Mapping[str, PixelType] = field(default_factory=dict)
    """AOV, or "alpha" -> type in an EXR that differs: that of alpha from colour's, that of data
    from float. Ids and Cryptomatte keep theirs."""
    color_space: str = "lin_rec709_scene"
    """Colour space of the colour channels, a name from `color.COLOR_SPACES`."""
    multipart: bool = False
    """Whether an EXR has a part for each AOV, instead of one with many channels."""
    compression: str = ""
    """Compression of an EXR, see `compression.Compression`; empty for the format's default."""
    tile_size: int = 0
    """Side of the tiles of a flat EXR [pixel]; 0 for scan lines."""
    empty_depth: float = math.inf
    """Depth of empty pixels in an EXR [scene unit]; arrays have inf there."""
    crypto_rank: int = cryptomatte.RANK
    """Number of pairs of id and coverage in each layer of Cryptomatte."""
    background: Background | None = None
    """Colour behind a picture for displays, which makes it opaque; an EXR has none."""
    quality: int = 95
    """Quality of a JPEG or WebP, 1 to 100."""
    metadata: Metadata = field(default_factory=dict)
    """Further header entries."""

    @property
    def window(self) -> tuple[int, int, int, int]:
        """The data window, or the display window if there is none."""
        return self.data_window or (0, 0, *self.resolution)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns of the data window."""
        x0, y0, x1, y1 = self.window
        return y1 - y0, x1 - x0

    def rows_of(self, y0: int, band: Band) -> int:
        """Check that `band` from row `y0` has this layout's AOVs; return its number of rows.

        Raises:
            ValueError: If an array is missing or has the wrong shape or dtype.
        """
        rows = len(band[self.aovs[0]]) if self.aovs[0] in band else 0
        for name in self.aovs:
            aov = aov_named(name).with_rank(self.crypto_rank)
            tail = () if len(aov.channels) == 1 else (len(aov.channels),)
            dtype = np.dtype(np.uint32 if aov.kind == "id" else np.float32)
            expected = f"{dtype}{(rows, self.shape[1], *tail)}"
            found = f"{band[name].dtype}{band[name].shape}" if name in band else "nothing"
            if found != expected:
                raise ValueError(f"band {y0} {name}: found {found}, expected {expected}")
        return rows
