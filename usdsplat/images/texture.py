"""Read textures with OpenImageIO as linear Rec.709.

Values are decoded before they are averaged. A picture of more than `LARGEST` pixels a side is
reduced by an integer factor: each pixel of the result is the mean of a square of original ones,
smaller at the right and lower edge.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio

from usdsplat.core.cloud import F32
from usdsplat.core.errors import FormatError
from usdsplat.core.readable import readable
from usdsplat.core.scratch import scratch_folder
from usdsplat.images.color import convert

LARGEST = 4096
"""Maximum size of a returned picture [pixel]."""
READABLE = 1 << 30
"""Maximum number of pixels of a file."""

Encoding = Literal["auto", "sRGB", "raw"]
Channel = Literal["luminance", "r", "g", "b", "a"]
LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Weights of red, green and blue, of Rec.709."""


def read_texture(path: Path | str, *, encoding: Encoding = "auto", largest: int = LARGEST) -> F32:
    """Read the picture at `path`.

    Args:
        path: A file of any format that OpenImageIO reads; the first part or level is read.
        encoding: Encoding of colours; auto is sRGB for 8-bit colour pictures, else raw, as in
            UsdUVTexture.
        largest: Size above which the picture is reduced [pixel].

    Returns:
        Linear Rec.709, shape (h, w, 3), row 0 at the top; grey becomes equal channels, alpha is
        dropped.

    Raises:
        FormatError: If the file cannot be read as a picture.
    """
    pixels = _read(str(path))
    colored = pixels.shape[2] >= 3
    if encoding == "auto":
        encoding = "sRGB" if pixels.dtype == np.uint8 and colored else "raw"
    step = -(-max(pixels.shape[:2]) // largest)
    rgb = pixels[..., :3] if colored else np.repeat(pixels[..., :1], 3, axis=2)
    return _linear(rgb, encoding, step)


def read_channel(path: Path | str, channel: Channel, *, largest: int = LARGEST) -> F32:
    """Read one channel of a picture, without decoding colours.

    Args:
        path: A file of any format that OpenImageIO reads; the first part or level is read.
        channel: A channel, or the luminance of Rec.709; a grey picture has equal colours.
        largest: Size above which the picture is reduced [pixel].

    Returns:
        0 to 1 for pictures of integers, shape (h, w), row 0 at the top.

    Raises:
        FormatError: If the file cannot be read as a picture, or has no such channel.
    """
    pixels = _read(str(path), is_plain=True)
    count, step = pixels.shape[2], -(-max(pixels.shape[:2]) // largest)
    alpha = {2: 1, 4: 3}.get(count)
    if channel == "a" and alpha is None:
        raise FormatError(str(path), f"{count} channels without alpha", "one with alpha")
    rows = [alpha or 0] * 3 if channel == "a" else [0, 1, 2] if count >= 3 else [0, 0, 0]
    rgb = _linear(pixels[..., rows], "raw", step)
    if channel == "luminance":
        return np.ascontiguousarray(rgb @ np.array(LUMINANCE, np.float32))
    return np.ascontiguousarray(rgb[..., max("rgb".find(channel), 0)])


def read_packed_texture(data: bytes, name: str, *, encoding: Encoding = "auto") -> F32:
    """Read a picture from bytes, as `read_texture` does; the suffix of `name` is its format.

    Raises:
        FormatError: If it cannot be read as a picture.
    """
    # OpenImageIO's Python interface reads from files only.
    with scratch_folder() as folder:
        path = folder / f"texture{Path(name).suffix}"
        path.write_bytes(data)
        try:
            return read_texture(path, encoding=encoding)
        except FormatError as error:
            raise FormatError(name, error.found, error.expected) from None


def _read(path: str, *, is_plain: bool = False) -> npt.NDArray[Any]:
    """Read all channels in the file's own type, shape (h, w, c); colours that are not premultiplied
    in the file are premultiplied unless `is_plain`."""
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", int(is_plain))
    file = oiio.ImageInput.open(readable(path), config)
    if file is None:
        raise FormatError(path, _reason(), "a picture")
    try:
        spec = file.spec()
        if spec.width * spec.height * spec.depth > READABLE or spec.depth != 1:
            found = f"{spec.width} x {spec.height} x {spec.depth} pixels"
            raise FormatError(path, found, f"a flat picture of at most {READABLE}")
        whole = spec.format.basetype in (oiio.UINT8, oiio.UINT16)
        kind = spec.format if whole else oiio.TypeFloat
        pixels = file.read_image(0, 0, 0, min(spec.nchannels, 4), kind)
        if pixels is None:
            raise FormatError(path, file.geterror() or "pixels that cannot be read", "a picture")
    finally:
        file.close()
    return np.asarray(pixels).reshape(spec.height, spec.width, -1)


def _reason() -> str:
    """Return OpenImageIO's error message on one line."""
    return " ".join(oiio.geterror().split()) or "a file that cannot be read"


def _linear(rgb: npt.NDArray[Any], encoding: Encoding, step: int) -> F32:
    """Decode, and reduce by `step`, row by row."""
    height, width = -(-rgb.shape[0] // step), -(-rgb.shape[1] // step)
    table = _table(rgb.dtype, encoding)
    found = np.empty((height, width, 3), np.float32)
    for y in range(height):
        rows = rgb[y * step : (y + 1) * step]
        linear = table[rows] if table is not None else _decoded(rows, encoding)
        found[y] = linear[0] if step == 1 else _mean(linear, step)
    return found


def _table(dtype: np.dtype[Any], encoding: Encoding) -> F32 | None:
    """Return the linear value of each integer; None for float pixels."""
    if dtype.kind != "u":
        return None
    top = np.iinfo(dtype).max
    return _decoded(np.arange(top + 1, dtype=np.float32) / np.float32(top), encoding)


def _decoded(values: npt.NDArray[Any], encoding: Encoding) -> F32:
    if encoding == "raw":
        return values.astype(np.float32)
    triples = np.stack([values] * 3, axis=-1) if values.ndim == 1 else values
    linear = convert(triples, "srgb_rec709_scene", "lin_rec709_scene").astype(np.float32)
    return linear[:, 0] if values.ndim == 1 else linear


def _mean(rows: F32, step: int) -> F32:
    """Return the means of squares of `step` pixels a side in a row, shape (width, 3)."""
    starts = np.arange(0, rows.shape[1], step)
    sums = np.add.reduceat(rows.sum(axis=0, dtype=np.float64), starts, axis=0)
    counts = np.diff(np.append(starts, rows.shape[1])) * len(rows)
    return (sums / counts[:, None]).astype(np.float32)
