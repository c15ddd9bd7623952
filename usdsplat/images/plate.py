"""Read the colours of a plate: a picture from another source."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32
from usdsplat.core.errors import FormatError
from usdsplat.core.readable import readable
from usdsplat.images.color import COLOR_SPACES, convert

CLIPPED = 0.98
"""Code value from which a display-referred picture may be clipped."""
ALIASES = {
    "acescg": "lin_ap1_scene",
    "aces2065-1": "lin_ap0_scene",
    "lin_rec709": "lin_rec709_scene",
    "lin_srgb": "lin_rec709_scene",
    "linear": "lin_rec709_scene",
    "scene_linear": "lin_rec709_scene",
    "srgb": "srgb_rec709_scene",
    "rec709": "srgb_rec709_scene",
}
"""Names of spaces in files and OpenImageIO, in lower case -> our names."""
NEAR = 1e-3
"""Largest difference of chromaticities that are those of a space: files round them differently."""

SpaceSource = Literal["given", "file", "format", "assumed"]
"""The caller, the file itself, what OpenImageIO assumes for its format, or its pixel type alone."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Plate:
    """A picture, complete in its display window."""

    rgb: F32
    """Linear Rec.709, not premultiplied, shape (h, w, 3)."""
    usable: npt.NDArray[np.bool_]
    """Pixels that are opaque, finite, above black and not clipped, shape (h, w)."""
    space: str
    """Colour space that the file was read as."""
    space_source: SpaceSource
    """Where the colour space is from."""


def read_plate(path: Path, *, space: str | None = None) -> Plate:
    """Read the first part of a picture file.

    Args:
        path: A file of any format that OpenImageIO reads.
        space: Colour space, one of `COLOR_SPACES`; None for the one named in the file, else sRGB
            for integers and linear Rec.709 for floats.

    Raises:
        FormatError: If it cannot be read or has no red, green and blue.
        UsageError: If the space is unknown.
    """
    import OpenImageIO as oiio

    if not path.is_file():
        raise FormatError(str(path), "no such file", "a picture")
    buffer = oiio.ImageBuf(readable(path))
    spec = buffer.spec()
    if buffer.has_error or not spec.nchannels:
        problem = " ".join((buffer.geterror() or "nothing to read").split())
        raise FormatError(str(path), problem, "a picture that OpenImageIO reads")
    names = list(spec.channelnames)
    if not {"R", "G", "B"} <= set(names):
        raise FormatError(str(path), f"channels {', '.join(names)}", "R, G and B")
    is_float = str(spec.format) in ("half", "float", "double")
    source: SpaceSource = "given"
    if space is None:
        space, source = _space(spec, is_float)
    # The whole display window; OpenImageIO has premultiplied the pixels.
    pixels = np.asarray(buffer.get_pixels(oiio.FLOAT, buffer.roi_full))
    whole = np.ones(pixels.shape[:2], np.float32)
    alpha = pixels[..., names.index("A")] if "A" in names else whole
    code = pixels[..., [names.index(name) for name in "RGB"]]
    usable = np.isfinite(code).all(axis=2) & (alpha > 0.99)
    code = np.where(usable[..., None], code, 0.0) / np.where(usable, alpha, 1.0)[..., None]
    if not is_float:
        usable &= (code < CLIPPED).all(axis=2)
    rgb = convert(code, space, "lin_rec709_scene").astype(np.float32)
    usable &= rgb.max(axis=2) > 0
    return Plate(rgb=rgb, usable=usable, space=space, space_source=source)


def _space(spec: Any, is_float: bool) -> tuple[str, SpaceSource]:
    """Return the colour space of a file and where it is from.

    In a file of integers, an entry colorInteropID may be left over from the EXR that it was made
    from: what its format states goes first.
    """
    sources: list[tuple[str, SpaceSource]] = [
        (str(spec.getattribute("colorInteropID") or ""), "file"),
        (str(spec.getattribute("oiio:ColorSpace") or ""), "format"),
    ]
    if is_float:
        sources.insert(1, (_with_primaries(spec.getattribute("chromaticities")), "file"))
    for text, source in sources if is_float else reversed(sources):
        name = ALIASES.get(text.lower(), text)
        if name in COLOR_SPACES:
            return name, source
    return ("lin_rec709_scene" if is_float else "srgb_rec709_scene"), "assumed"


def _with_primaries(found: object) -> str:
    """Return the linear space with the chromaticities of a header, eight numbers; "" if there is
    none."""
    if not isinstance(found, tuple) or len(found) != 8:
        return ""
    for name, space in COLOR_SPACES.items():
        primaries = space.chromaticities
        if space.gamma == 1.0 and primaries and np.allclose(found, primaries, atol=NEAR):
            return name
    return ""
