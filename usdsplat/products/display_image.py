"""Write display-referred pictures: PNG or JPEG, 8 bits, sRGB, without alpha."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.errors import UnknownFormatError
from usdsplat.core.output import write_output
from usdsplat.images.exif import WRITER, exif
from usdsplat.images.labels import as_text
from usdsplat.images.layout import Metadata

if TYPE_CHECKING:
    from PIL.PngImagePlugin import PngInfo

Image = npt.NDArray[np.uint8]
"""Display RGB, row 0 at the top, shape (height, width, 3)."""

FORMATS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG"}
"""Suffix -> Pillow's name of the format."""
QUALITY = 95
"""Quality of a JPEG [0..100]."""


def save_image(image: Image, path: Path | str, *, metadata: Metadata | None = None) -> Path:
    """Write a picture as PNG or JPEG and return its path.

    Args:
        image: Display RGB.
        path: The file; an existing one is replaced when the new one is complete.
        metadata: Header entries, see `picture_header`. They are stored as text chunks in a PNG, as
            one JSON object in the Exif description of a JPEG.

    Raises:
        UnknownFormatError: If the suffix is not in `FORMATS`.
        OutputError: If the file cannot be written.
    """
    from PIL import Image as pillow

    path = Path(path)
    check_suffix(path, tuple(FORMATS))
    kind = FORMATS[path.suffix.lower()]
    more: dict[str, Any]
    if kind == "JPEG":
        more = {"quality": QUALITY, "subsampling": 0, "exif": exif(metadata or {})}
    else:
        more = {"pnginfo": _chunks(metadata or {})}
    data = io.BytesIO()
    pillow.fromarray(np.ascontiguousarray(image)).save(data, kind, **more)
    write_output(path, data.getbuffer())
    return path


def _chunks(metadata: Metadata) -> PngInfo:
    """Return the entries as named text chunks of a PNG."""
    from PIL.PngImagePlugin import PngInfo

    chunks = PngInfo()
    for key, value in {"Software": WRITER, **as_text(metadata)}.items():
        add = chunks.add_text if value.isascii() else chunks.add_itxt
        add(key, value)
    return chunks


def check_suffix(path: Path, suffixes: tuple[str, ...]) -> None:
    """Raise an error for a file name with another suffix.

    Raises:
        UnknownFormatError: If its suffix is not in `suffixes`.
    """
    if path.suffix.lower() not in suffixes:
        found, expected = f"suffix {path.suffix!r}", f"one of {', '.join(suffixes)}"
        raise UnknownFormatError(str(path), found, expected)
