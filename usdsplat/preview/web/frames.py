"""Encode pictures for a page: exact, sharp, or within a number of bytes.

A message of a picture is one part of its image: 4 bytes with the length of the header, unsigned and
big-endian; the header as UTF-8 JSON; and the bytes of the part.

exact   lossless WebP: bit for bit; 15 to 35 % smaller than PNG and encoded in the same time
sharp   WebP of all pixels
quick   the best rung of `RUNGS` that fits: JPEG on a fast link, which is encoded in a third of the
        time, else WebP, with fewer pixels on a slow one
"""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from usdsplat.preview.values import Picture

Stage = Literal["quick", "sharp", "exact"]

SHARP = 85
"""Quality of sharp WebP."""
_METHOD = 1  # of 6: a good picture in 20 ms; each further one takes half as long again
_SHRINKING = 1.35  # bytes fall with this power of the size of a pixel; measured on renders
_MARGIN = 0.9  # fraction of a budget that a prediction may use


@dataclass(frozen=True, slots=True, kw_only=True)
class Rung:
    """A quality of moving pictures."""

    scale: float
    """Least viewport pixels per side of an encoded pixel."""
    quality: int
    encoding: Literal["image/jpeg", "image/webp"] = "image/webp"
    size: float
    """Typical bytes per pixel at scale 1."""


RUNGS = (
    Rung(scale=1.0, quality=85, encoding="image/jpeg", size=0.17),
    Rung(scale=1.0, quality=75, size=0.08),
    Rung(scale=1.0, quality=55, size=0.065),
    Rung(scale=1.5, quality=60, size=0.07),
    Rung(scale=2.0, quality=60, size=0.07),
    Rung(scale=2.0, quality=40, size=0.055),
    Rung(scale=3.0, quality=45, size=0.06),
    Rung(scale=4.0, quality=40, size=0.055),
    Rung(scale=6.0, quality=30, size=0.048),
    Rung(scale=8.0, quality=25, size=0.045),
)
"""Qualities of moving pictures, the best first."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Encoded:
    """An encoded picture."""

    image: bytes
    header: Mapping[str, Any]
    """Metadata for a page, see `header`."""
    detail: float = 1.0
    """Bytes relative to those that `RUNGS` predicts; of quick pictures."""


def exact(picture: Picture) -> Encoded:
    """Encode a picture bit for bit."""
    image = _written(picture, picture.scale, "WEBP", lossless=True, quality=0, method=0)
    return Encoded(image=image[0], header=header(picture, "image/webp", image[1], stage="exact"))


def sharp(picture: Picture) -> Encoded:
    """Encode all pixels of a picture, with losses that are hard to see."""
    image = _written(picture, picture.scale, "WEBP", quality=SHARP, method=_METHOD)
    return Encoded(image=image[0], header=header(picture, "image/webp", image[1], stage="sharp"))


def quick(picture: Picture, budget: float, *, detail: float = 1.0) -> Encoded:
    """Encode a picture within a budget, as well as that permits.

    Args:
        picture: The picture.
        budget: Most bytes; only the last rung may need more.
        detail: That of the last quick picture, which is probably similar.
    """
    width, height = picture.state.size
    for rung in RUNGS:
        scale = max(rung.scale, picture.scale)
        usual = rung.size * width * height * scale**-_SHRINKING
        if rung is not RUNGS[-1] and usual * detail > _MARGIN * budget:
            continue
        if rung.encoding == "image/jpeg":  # 4:4:4: splats are small coloured details
            found = _written(picture, scale, "JPEG", quality=rung.quality, subsampling=0)
        else:
            found = _written(picture, scale, "WEBP", quality=rung.quality, method=_METHOD)
        image, size = found
        detail = len(image) / usual
        if len(image) <= budget or rung is RUNGS[-1]:
            break
    return Encoded(
        image=image, header=header(picture, rung.encoding, size, stage="quick"), detail=detail
    )


def message(encoded: Encoded, part: int, parts: int, *, message: int) -> bytes:
    """Return the message of one part of an encoded picture.

    Args:
        encoded: The picture.
        part, parts: Index and number of parts; the first one has the whole header.
        message: Number by which the page acknowledges it.
    """
    first, last = (len(encoded.image) * edge // parts for edge in (part, part + 1))
    about = encoded.header if part == 0 else {"number": encoded.header["number"]}
    return packed(
        {**about, "part": part, "parts": parts, "message": message}, encoded.image[first:last]
    )


def packed(head: Mapping[str, Any], body: bytes) -> bytes:
    """Return a binary message."""
    written = json.dumps(head, allow_nan=False, separators=(",", ":")).encode()
    return struct.pack(">I", len(written)) + written + body


def header(
    picture: Picture, encoding: str, size: tuple[int, int], *, stage: Stage
) -> dict[str, Any]:
    """Return a picture's metadata for a page; `size` is that of the encoded image."""
    width, height = size
    return {
        "number": picture.number,
        "encoding": encoding,
        "width": width,
        "height": height,
        "viewport": list(picture.state.size),
        "scale": round(max(picture.state.size[0] / width, picture.scale), 2),
        "is_final": picture.is_final and stage == "exact",
        "is_sharp": picture.is_final and stage != "quick",
        "time": picture.state.time,
        "aov": picture.state.look.aov,
        "splats": picture.splats,
        "total": picture.total,
        "missing": picture.missing,
        "lacks_light": picture.lacks_light,
        "milliseconds": {name: round(ms, 2) for name, ms in picture.milliseconds.items()},
        "megabytes": round(picture.megabytes, 1),
        "device": picture.device,
        "warnings": list(picture.warnings),
    }


def _written(
    picture: Picture, scale: float, form: str, **options: Any
) -> tuple[bytes, tuple[int, int]]:
    """Return an image with pixels of at least `scale`, and its width and height."""
    from PIL import Image

    image = Image.fromarray(picture.image)
    if scale > picture.scale:
        width, height = (max(1, round(side / scale)) for side in picture.state.size)
        size = (min(width, image.width), min(height, image.height))
        image = image.resize(size, Image.Resampling.BOX)
    buffer = io.BytesIO()
    image.save(buffer, form, **options)
    return buffer.getvalue(), image.size
