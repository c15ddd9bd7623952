"""Write PNG files band by band: display-referred sRGB, 8 or 16 bits.

PNG stores straight (not premultiplied) colour, so pixels are divided by their alpha, clipped to
0..1 and rounded to the nearest step, halves up. With a background a picture is opaque.

Source: W3C PNG Specification, Third Edition.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import OpenImageIO as oiio

from usdsplat.images.display_writer import DisplayWriter
from usdsplat.images.labels import as_text
from usdsplat.images.layout import ImageLayout

_SIGNATURE = b"\x89PNG\r\n\x1a\n"


class PngWriter(DisplayWriter):
    """Writer of a PNG file, see `DisplayWriter`: `pixel_type` uint8 (default) or uint16."""

    FORMAT = "png"
    NAME = "a PNG"
    TYPES = ("uint8", "uint16")

    def _spec(self, layout: ImageLayout) -> oiio.ImageSpec:
        spec = super()._spec(layout)
        # The "sub" filter with low compression takes half the time for 5 % more bytes.
        spec.attribute("png:filter", 16)
        spec.attribute("png:compressionLevel", 3)
        for key, value in as_text(layout.metadata).items():
            spec.attribute(key, value)
        return spec

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
