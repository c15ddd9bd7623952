"""Write PNG files band by band: display-referred sRGB, 8 or 16 bits.

PNG stores straight (not premultiplied) colour, so pixels are divided by their alpha, clipped to
0..1 and rounded to the nearest step, halves up. It has no display window: a file of a crop or an
overscan contains the data window, without its position.

Source: W3C PNG Specification, Third Edition.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio

import usdsplat
from usdsplat.core.cloud import F32
from usdsplat.core.errors import UsageError
from usdsplat.images.color import color_space, conversion, is_identity
from usdsplat.images.labels import as_text
from usdsplat.images.layout import Band, ImageLayout
from usdsplat.images.writer import ROWS, ImageWriter

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
RESOLUTION = 72.0
"""Pixels per inch; PNG expresses the pixel aspect ratio by two of these."""


class PngWriter(ImageWriter):
    """Writer of a PNG file; see `ImageWriter` for its use.

    Args:
        path: The file; it appears when the context ends without an error.
        layout: Contents: the AOV "color" in sRGB, `pixel_type` uint8 (default) or uint16.

    Raises:
        UsageError: If PNG cannot have this layout.
        OutputError: If the file cannot be created, on entering the context.
    """

    FORMAT = "png"

    def __init__(self, path: Path | str, layout: ImageLayout) -> None:
        if layout.pixel_type not in (None, "uint8", "uint16"):
            raise UsageError(str(path), f"{layout.pixel_type} pixels", "uint8 or uint16 in a PNG")
        if layout.aovs != ("color",):
            raise UsageError(str(path), f"AOVs {', '.join(layout.aovs)}", "color only in a PNG")
        if not is_identity(conversion(layout.color_space, "srgb_rec709_display")):
            raise UsageError(str(path), f"a picture in {layout.color_space}", "sRGB in a PNG")
        self._dtype = np.dtype(layout.pixel_type or "uint8")
        super().__init__(path, layout, (_spec(layout),))

    def _append(self, y0: int, band: Band) -> None:
        color = np.asarray(band["color"], np.float32)
        self._write_rows(y0 - self._layout.window[1], quantized(color, self._dtype))

    def _abandon(self) -> None:
        """Fill the picture, because libpng prints a message when it closes one without rows."""
        _, top, _, bottom = self._layout.window
        for y0 in range(self._next_row, bottom, ROWS):
            rows = min(ROWS, bottom - y0)
            blank = np.zeros((rows, self._layout.shape[1], 4), self._dtype)
            self._file.write_scanlines(y0 - top, y0 - top + rows, 0, blank)
        self._file.geterror()  # of the full disk that may be the reason

    def _is_whole(self, path: Path) -> bool:
        return is_whole_png(path)


def is_whole_png(path: Path) -> bool:
    """Return whether a file is a PNG with valid chunks from the header to the end.

    OpenImageIO's writer does not report every failing write, so bytes can also be missing in the
    middle.
    """
    with path.open("rb") as file:
        found = file.read(len(_SIGNATURE)) == _SIGNATURE
        name = b""
        while found and name != b"IEND":
            start = file.read(8)
            if len(start) < 8:
                return False
            size, name = struct.unpack(">I4s", start)
            data = file.read(size)  # a damaged size cannot make it more than the file
            crc = zlib.crc32(data, zlib.crc32(name))
            found = file.read(4) == struct.pack(">I", crc)
        return found and not file.read(1)


def quantized(premultiplied: F32, dtype: npt.DTypeLike) -> npt.NDArray[np.unsignedinteger]:
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


def _spec(layout: ImageLayout) -> oiio.ImageSpec:
    """Return the header of the file."""
    rows, columns = layout.shape
    spec = oiio.ImageSpec(columns, rows, 4, layout.pixel_type or "uint8")
    if color_space(layout.color_space).chromaticities is not None:
        spec.attribute("oiio:ColorSpace", "srgb_rec709_display")
    # The "sub" filter with low compression takes half the time for 5 % more bytes.
    spec.attribute("png:filter", 16)
    spec.attribute("png:compressionLevel", 3)
    # The colours are straight already; without this OpenImageIO would divide by alpha again.
    spec.attribute("oiio:UnassociatedAlpha", 1)
    spec.attribute("Software", f"usdsplat {usdsplat.__version__}")
    if layout.pixel_aspect_ratio != 1.0:
        spec.attribute("XResolution", RESOLUTION)
        spec.attribute("YResolution", RESOLUTION * layout.pixel_aspect_ratio)
        spec.attribute("ResolutionUnit", "in")
    for key, value in as_text(layout.metadata).items():
        spec.attribute(key, value)
    return spec
