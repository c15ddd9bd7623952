"""Base class of writers of pictures for displays: colour in code values of a display."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio

import usdsplat
from usdsplat.core.cloud import F32
from usdsplat.core.errors import UsageError
from usdsplat.images.background import over
from usdsplat.images.color import color_space, conversion, is_identity
from usdsplat.images.layout import Band, ImageLayout
from usdsplat.images.writer import ROWS, ImageWriter

Pixels = npt.NDArray[np.unsignedinteger]

RESOLUTION = 72.0
"""Pixels per inch; headers express the pixel aspect ratio by two of these."""


class DisplayWriter(ImageWriter):
    """Writer of the AOV "color"; see `ImageWriter` for its use.

    A picture with a background has three channels; without one it has straight (not premultiplied)
    colour and alpha. These formats have no display window: a file of a crop or an overscan contains
    the data window, without its position.

    Args:
        path: The file; it appears when the context ends without an error.
        layout: Contents: the AOV "color" in sRGB.

    Raises:
        UsageError: If the format cannot have this layout.
        OutputError: If the file cannot be created, on entering the context.
    """

    NAME: str
    """Name of the format in messages, with its article."""
    TYPES: tuple[str, ...] = ("uint8",)
    """Pixel types; the first one is the default."""
    MOST: int = 1 << 31
    """Largest width and height [pixel]."""

    def __init__(self, path: Path | str, layout: ImageLayout) -> None:
        where, kind = str(path), layout.pixel_type or self.TYPES[0]
        if kind not in self.TYPES:
            raise UsageError(where, f"{kind} pixels", f"{' or '.join(self.TYPES)} in {self.NAME}")
        if layout.aovs != ("color",):
            raise UsageError(where, f"AOVs {', '.join(layout.aovs)}", f"color only in {self.NAME}")
        if not is_identity(conversion(layout.color_space, "srgb_rec709_display")):
            found = f"a picture in {layout.color_space}"
            raise UsageError(where, found, f"sRGB in {self.NAME}")
        if max(layout.shape) > self.MOST:
            found = "x".join(map(str, layout.shape[::-1]))
            raise UsageError(where, found, f"at most {self.MOST} pixels on a side of {self.NAME}")
        self._dtype = np.dtype(kind)
        self._background = layout.background
        self._channels = 4 if layout.background is None else 3
        super().__init__(path, layout, (self._spec(layout),))

    def _append(self, y0: int, band: Band) -> None:
        self._write_rows(y0 - self._layout.window[1], self._quantized(band))

    def _quantized(self, band: Band) -> Pixels:
        """Return the code values of some rows, shape (rows, width, channels)."""
        color = np.asarray(band["color"], np.float32)
        if self._background is None:
            return quantized(color, self._dtype)
        top = np.float32(np.iinfo(self._dtype).max)
        return (over(color, self._background) * top + np.float32(0.5)).astype(self._dtype)

    def _abandon(self) -> None:
        """Fill the picture, because libraries print messages when they close one without rows."""
        _, top, _, bottom = self._layout.window
        for y0 in range(self._next_row, bottom, ROWS):
            rows = min(ROWS, bottom - y0)
            blank = np.zeros((rows, self._layout.shape[1], self._channels), self._dtype)
            self._file.write_scanlines(y0 - top, y0 - top + rows, 0, blank)
        self._file.geterror()  # of the full disk that may be the reason

    def _spec(self, layout: ImageLayout) -> oiio.ImageSpec:
        """Return the header of the file."""
        rows, columns = layout.shape
        spec = oiio.ImageSpec(columns, rows, self._channels, str(self._dtype))
        if color_space(layout.color_space).chromaticities is not None:
            spec.attribute("oiio:ColorSpace", "srgb_rec709_display")
        # The colours are straight already; without this OpenImageIO would divide by alpha again.
        spec.attribute("oiio:UnassociatedAlpha", 1)
        spec.attribute("Software", f"usdsplat {usdsplat.__version__}")
        if layout.pixel_aspect_ratio != 1.0:
            spec.attribute("XResolution", RESOLUTION)
            spec.attribute("YResolution", RESOLUTION * layout.pixel_aspect_ratio)
            spec.attribute("ResolutionUnit", "in")
        return spec


def quantized(premultiplied: F32, dtype: npt.DTypeLike) -> Pixels:
    """Quantise premultiplied colour to straight RGBA.

    Args:
        premultiplied: RGBA [0..1], shape (..., 4); values outside are clipped after division by
            alpha, and colour with alpha 0 becomes 0.
        dtype: uint8 or uint16.
    """
    top = np.float32(np.iinfo(dtype).max)
    alpha = premultiplied[..., 3:]
    steps = np.divide(top, alpha, out=np.zeros_like(alpha), where=alpha > 0)
    straight = np.concatenate([premultiplied[..., :3] * steps, alpha * top], axis=-1)
    return (np.clip(straight, 0, top) + np.float32(0.5)).astype(dtype)
