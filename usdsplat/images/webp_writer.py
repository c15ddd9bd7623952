"""Write WebP files: display-referred sRGB, 8 bits, with alpha or over a background.

Pillow writes them, because OpenImageIO's writer stores no header entries. They are one JSON text in
the Exif description, as in JPEGs. The encoder needs the whole picture, so it is held in memory.

Source: RFC 9649, WebP Image Format.
"""

from __future__ import annotations

import io
import struct
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from usdsplat.core.output import OutputFile
from usdsplat.images.display_writer import DisplayWriter
from usdsplat.images.exif import exif
from usdsplat.images.layout import Band


class WebpWriter(DisplayWriter):
    """Writer of a WebP file, see `DisplayWriter`. A quality of 100 is lossless."""

    FORMAT = "webp"
    NAME = "a WebP"
    MOST = 16383

    def _begin(self, output: OutputFile, stack: ExitStack) -> None:
        self._output = output
        self._pixels = np.empty((*self._layout.shape, self._channels), np.uint8)

    def _append(self, y0: int, band: Band) -> None:
        first = y0 - self._layout.window[1]
        rows = self._quantized(band)
        self._pixels[first : first + len(rows)] = rows

    def _finish(self) -> None:
        from PIL import Image as pillow

        quality, spec, resolution = self._layout.quality, self._specs[0], None
        if self._layout.pixel_aspect_ratio != 1.0:
            resolution = spec.getattribute("XResolution"), spec.getattribute("YResolution")
        entries = exif(self._layout.metadata, resolution)
        data = io.BytesIO()
        pillow.fromarray(self._pixels).save(
            data, "WEBP", quality=quality, lossless=quality == 100, exif=entries
        )
        with self._output.open() as file:
            file.write(data.getbuffer())

    def _abandon(self) -> None:
        """Nothing is written before the last row."""

    def _end(self) -> None:
        """The file is closed already."""

    def _is_whole(self, path: Path) -> bool:
        return is_whole_webp(path)


def is_whole_webp(path: Path) -> bool:
    """Return whether a file is a WebP of the size that its header states."""
    with path.open("rb") as file:
        start = file.read(12)
        size = file.seek(0, 2)
    if len(start) < 12 or start[:4] != b"RIFF" or start[8:] != b"WEBP":
        return False
    (length,) = struct.unpack("<I", start[4:8])
    return bool(size == length + 8)
