"""Write JPEG files band by band: display-referred sRGB over a background, 8 bits.

Colour has full resolution (4:4:4). The header entries are one JSON text in the Exif description,
as in pictures that a window saves.
"""

from __future__ import annotations

from pathlib import Path

import OpenImageIO as oiio

from usdsplat.core.errors import UsageError
from usdsplat.images.display_writer import DisplayWriter
from usdsplat.images.labels import as_json
from usdsplat.images.layout import ImageLayout

MOST_HEADER = 65_000
"""Largest size of the header entries [byte]. A segment of a JPEG has 65,533, of which Exif takes a
few; libjpeg ends the process if it is longer."""


class JpegWriter(DisplayWriter):
    """Writer of a JPEG file, see `DisplayWriter`; the layout has a background."""

    FORMAT = "jpeg"
    NAME = "a JPEG"
    MOST = 65500

    def __init__(self, path: Path | str, layout: ImageLayout) -> None:
        if layout.background is None:
            raise UsageError(str(path), "a transparent JPEG", "a background, or .png or .webp")
        size = len(as_json(layout.metadata).encode())
        if size > MOST_HEADER:
            expected = f"at most {MOST_HEADER} in a JPEG; .png and .webp hold more"
            raise UsageError(str(path), f"{size} bytes of header entries", expected)
        super().__init__(path, layout)

    def _spec(self, layout: ImageLayout) -> oiio.ImageSpec:
        spec = super()._spec(layout)
        spec.attribute("Compression", f"jpeg:{layout.quality}")
        spec.attribute("jpeg:subsampling", "4:4:4")
        spec.attribute("ImageDescription", as_json(layout.metadata))
        return spec

    def _is_whole(self, path: Path) -> bool:
        return is_whole_jpeg(path)


def is_whole_jpeg(path: Path) -> bool:
    """Return whether a file begins and ends as a JPEG does."""
    with path.open("rb") as file:
        begin = file.read(3)
        size = file.seek(0, 2)
        file.seek(max(0, size - 2))
        return begin == b"\xff\xd8\xff" and file.read() == b"\xff\xd9"
