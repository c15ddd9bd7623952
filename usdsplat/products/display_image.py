"""Write pictures as a screen shows them: PNG or JPEG, 8 bits, sRGB, without alpha."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from usdsplat.core.errors import UnknownFormatError
from usdsplat.core.output import atomic_path

Image = npt.NDArray[np.uint8]
"""Display RGB, row 0 at the top, shape (height, width, 3)."""

FORMATS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG"}
"""Suffix -> Pillow's name of the format."""
QUALITY = 95
"""Of a JPEG [0..100]."""


def save_image(image: Image, path: Path | str) -> Path:
    """Write display RGB, shape (h, w, 3), as PNG or JPEG; return the file.

    Raises:
        UnknownFormatError: If the suffix is none of `FORMATS`.
        OutputError: If the file cannot be written.
    """
    from PIL import Image as pillow

    path = Path(path)
    check_suffix(path, tuple(FORMATS))
    kind = FORMATS[path.suffix.lower()]
    more = {"quality": QUALITY, "subsampling": 0} if kind == "JPEG" else {}
    with atomic_path(path) as temporary:
        pillow.fromarray(np.ascontiguousarray(image)).save(temporary, kind, **more)
    return path


def check_suffix(path: Path, suffixes: tuple[str, ...]) -> None:
    """Refuse a file name that ends otherwise.

    Raises:
        UnknownFormatError: If its suffix is none of `suffixes`.
    """
    if path.suffix.lower() not in suffixes:
        found, expected = f"suffix {path.suffix!r}", f"one of {', '.join(suffixes)}"
        raise UnknownFormatError(str(path), found, expected)
