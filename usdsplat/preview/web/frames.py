"""Encode a picture for a page: header length, header as JSON, encoded image.

4 bytes   length of the header, unsigned, big-endian
header    UTF-8 JSON: the result of `header`
image     JPEG while a better picture follows, else PNG: final pictures are exact
"""

from __future__ import annotations

import io
import json
import struct
from typing import Any

from usdsplat.preview.values import Picture

QUALITY = 85
"""JPEG quality at 4:4:4: splats are small coloured details."""
_PNG_LEVEL = 1  # low compression: loopback has bandwidth, latency matters


def frame(picture: Picture) -> bytes:
    """Return the message of a picture for a socket."""
    image = encoded(picture)
    head = json.dumps(header(picture), allow_nan=False, separators=(",", ":")).encode()
    return struct.pack(">I", len(head)) + head + image


def encoded(picture: Picture) -> bytes:
    """Return the encoded image: PNG if it is final, else JPEG."""
    from PIL import Image

    buffer = io.BytesIO()
    image = Image.fromarray(picture.image)
    if picture.is_final:
        image.save(buffer, "PNG", compress_level=_PNG_LEVEL)
    else:
        image.save(buffer, "JPEG", quality=QUALITY, subsampling=0)
    return buffer.getvalue()


def header(picture: Picture) -> dict[str, Any]:
    """Return a picture's metadata for a page."""
    height, width = picture.image.shape[:2]
    return {
        "number": picture.number,
        "encoding": "image/png" if picture.is_final else "image/jpeg",
        "width": width,
        "height": height,
        "viewport": list(picture.state.size),
        "scale": picture.scale,
        "is_final": picture.is_final,
        "time": picture.state.time,
        "aov": picture.state.look.aov,
        "splats": picture.splats,
        "total": picture.total,
        "missing": picture.missing,
        "milliseconds": {name: round(ms, 2) for name, ms in picture.milliseconds.items()},
        "megabytes": round(picture.megabytes, 1),
        "device": picture.device,
        "warnings": list(picture.warnings),
    }
