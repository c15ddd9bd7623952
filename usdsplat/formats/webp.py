"""Decode and encode lossless WebP images as arrays of bytes.

Source: the RIFF container and the VP8L bit stream as Google specifies them.
"""

from __future__ import annotations

import io
import math
import struct

import numpy as np
import numpy.typing as npt

from usdsplat.core.errors import FormatError

_CHUNK = struct.Struct("<4sI")
_ANIMATED = 0x02
_VP8L_SIGNATURE = 0x2F

LONGEST_SIDE = 16383
"""Maximum width and height of an image [pixel]."""


def image_size(where: str, data: bytes) -> tuple[int, int]:
    """Return the declared width and height [pixel] of a lossless WebP without decoding it.

    Raises:
        FormatError: If `data` is not a lossless still WebP; `where` names it.
    """
    if data[:4] != b"RIFF" or data[8:12] != b"WEBP":
        raise FormatError(where, f"{data[:12]!r} at the start", "a WebP image")
    start = 12
    canvas = None
    while start + _CHUNK.size <= len(data):
        kind, length = _CHUNK.unpack_from(data, start)
        body = data[start + _CHUNK.size : start + _CHUNK.size + min(length, 10)]
        start += _CHUNK.size + length + length % 2
        if kind == b"VP8X" and len(body) == 10 and not body[0] & _ANIMATED:
            canvas = (_uint24(body[4:7]) + 1, _uint24(body[7:10]) + 1)
        elif kind == b"VP8L" and len(body) >= 5 and body[0] == _VP8L_SIGNATURE:
            bits = int.from_bytes(body[1:5], "little")
            size = ((bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1)
            if canvas not in (None, size):
                raise FormatError(where, f"a canvas of {canvas} for {size} pixels", "one size")
            return size
        elif kind in (b"VP8X", b"VP8L", b"VP8 ", b"ANIM", b"ALPH"):
            break
    raise FormatError(where, "WebP data that is lossy, animated or damaged", "a lossless image")


def decode(where: str, data: bytes) -> npt.NDArray[np.uint8]:
    """Decode pixels in rows from the top, shape (height * width, 4), RGBA.

    Check `image_size` first: this function allocates the declared size.

    Raises:
        FormatError: If the data is damaged.
    """
    from PIL import Image

    try:
        with Image.open(io.BytesIO(data), formats=("WEBP",)) as image:
            return np.asarray(image.convert("RGBA")).reshape(-1, 4)
    except (OSError, ValueError, SyntaxError, EOFError, Image.DecompressionBombError) as error:
        raise FormatError(where, f"damaged WebP data ({error})", "a lossless image") from error


def encode(pixels: npt.NDArray[np.uint8]) -> bytes:
    """Encode pixels losslessly, colours of transparent pixels included.

    Args:
        pixels: RGBA, shape (height, width, 4), sides of 1 to `LONGEST_SIDE`.
    """
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "WEBP", lossless=True, exact=True)
    return out.getvalue()


def size_for(count: int) -> tuple[int, int]:
    """Return width and height [pixel] of a nearly square image of at least `count` pixels.

    Raises:
        ValueError: If `count` exceeds the largest image.
    """
    if count > LONGEST_SIDE**2:
        raise ValueError(f"count: found {count} pixels, expected at most {LONGEST_SIDE**2}")
    width = min(4 * (math.isqrt(max(count - 1, 0)) // 4 + 1), LONGEST_SIDE)
    return width, max(-(-count // width), 1)


def _uint24(data: bytes) -> int:
    return int.from_bytes(data, "little")
