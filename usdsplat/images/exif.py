"""Make Exif data of header entries, for JPEGs and WebPs that Pillow writes.

The header entries are one JSON text in the description.

Source: CIPA DC-008, Exif 2.32, table 4.
"""

from __future__ import annotations

import usdsplat
from usdsplat.images.labels import as_json
from usdsplat.images.layout import Metadata

DESCRIPTION, SOFTWARE = 0x010E, 0x0131
_X_RESOLUTION, _Y_RESOLUTION = 0x011A, 0x011B
WRITER = f"usdsplat {usdsplat.__version__}"
"""The program, as pictures name it."""


def exif(metadata: Metadata, resolution: tuple[float, float] | None = None) -> bytes:
    """Return Exif data with `WRITER` and header entries.

    Args:
        metadata: Header entries.
        resolution: Pixels per inch along x and y, of which the ratio states the shape of pixels;
            None for square ones.
    """
    from PIL import Image as pillow

    entries = pillow.Exif()
    entries[DESCRIPTION] = as_json(metadata)
    entries[SOFTWARE] = WRITER
    if resolution is not None:
        entries[_X_RESOLUTION], entries[_Y_RESOLUTION] = resolution
    return entries.tobytes()
