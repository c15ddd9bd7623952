"""Niantic's SPZ, versions 1 to 4: fixed point and bytes, attribute by attribute.

19 bytes a splat, 64 with harmonics of degree 3, before gzip or zstd. Lossy: see the error bounds of
the `Capture`.

Source: nianticlabs/spz, the library that defines the format. Its own frame is "rub", but its tools,
and others, pack PLY files without turning them, so most files in the wild hold "rdf"
(nianticlabs/spz issue 84). Where the file does not say, "rdf" is assumed and a note says so.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32
from usdsplat.core.encoding import join_largest
from usdsplat.formats.capture import UNKNOWN_AXES, Capture
from usdsplat.formats.filling import Filling, blocks
from usdsplat.formats.options import READING, Reading
from usdsplat.formats.spz_container import (
    GZIP_MAGIC,
    MAGIC,
    SpzContainer,
    SpzHeader,
    open_container,
)
from usdsplat.formats.spz_extensions import COORDINATE_SYSTEM, parse_extensions, stated_frame

SUFFIXES: tuple[str, ...] = (".spz",)

_SCALES = np.exp(np.arange(256) / 16 - 10).astype(np.float32)
_DC = ((np.arange(256) / 255 - 0.5) / 0.15).astype(np.float32)
_HARMONICS = ((np.arange(256) - 128) / 128).astype(np.float32)

Codes = npt.NDArray[np.uint8]


def recognises(path: Path, head: bytes) -> bool:
    """Whether a file that starts with `head` is SPZ, or gzip, which no other format is."""
    return head.startswith((MAGIC, GZIP_MAGIC))


def read(path: Path, how: Reading = READING) -> Capture:
    """Read splats of any version.

    Raises:
        FormatError: If the header asks for what cannot be, if data is missing, damaged or more than
            the header says, or if a half-precision position is not finite.
    """
    source = str(path)
    with path.open("rb") as file:
        container = open_container(source, file, path.stat().st_size)
        filling = _fill(source, container, how)
        records = parse_extensions(source, container.extensions())
    frame = stated_frame(source, records)
    cloud, notes = filling.cloud()
    if frame is None:
        notes += (UNKNOWN_AXES,)
    unknown = [f"{kind:#010x}" for kind in records if kind != COORDINATE_SYSTEM]
    if unknown:
        notes += (f"ignored extensions {', '.join(unknown)}",)
    return Capture(
        cloud=cloud,
        format=f"SPZ {container.header.version}",
        files=(path,),
        frame=frame or "rdf",
        antialiased=container.header.is_antialiased,
        error_bounds=_error_bounds(container.header),
        notes=notes,
    )


def _error_bounds(header: SpzHeader) -> dict[str, str]:
    """Rounding of the library's encoder."""
    half = header.version == 1
    derived = header.version < 3
    return {
        "positions": "half precision" if half else f"2^-{header.fractional_bits + 1}",
        "scales": "a factor of exp(1/32)",
        "rotations": "some degrees where w is near 0, else 0.7" if derived else "0.2 degrees",
        "opacities": "1/510",
        "sh": "degree 0: 0.013 within +-3.33; degree 1: 1/32, above: 1/16, within +-1",
    }


def _fill(source: str, container: SpzContainer, how: Reading) -> Filling:
    """Decode attribute after attribute; arrays are made when the first one has arrived."""
    header = container.header
    sizes = header.sizes()
    filling: Filling | None = None
    for done, (name, size) in enumerate(sizes.items(), 1):
        codes = np.frombuffer(container.attribute(name), np.uint8).reshape(header.count, size)
        if filling is None:
            filling = Filling(source, header.count, header.degree, how)
        for rows in blocks(header.count):
            _decode(filling, header, name, rows, codes[rows])
        how.progress.step(f"reading {source}", done, len(sizes))
    assert filling is not None  # every version has attributes
    for rows in blocks(header.count):
        filling.settle(rows)
    return filling


def _decode(filling: Filling, header: SpzHeader, name: str, rows: slice, codes: Codes) -> None:
    """Decode one attribute of some splats; `codes` has a row of bytes for each."""
    match name:
        case "positions" if header.version == 1:
            filling.positions[rows] = codes.view("<f2")
        case "positions":
            filling.positions[rows] = _fixed_point(codes, header.fractional_bits)
        case "alphas":
            filling.opacities[rows] = codes[:, 0] / np.float32(255)
        case "colors":
            filling.sh[rows, 0] = _DC[codes]
        case "scales":
            filling.scales[rows] = _SCALES[codes]
        case "rotations" if header.version < 3:
            filling.rotations[rows] = _derived_w(codes)
        case "rotations":
            filling.rotations[rows] = _smallest_three(codes.view("<u4")[:, 0])
        case "harmonics":
            filling.sh[rows, 1:] = _HARMONICS[codes].reshape(len(codes), -1, 3)


def _fixed_point(codes: Codes, fractional_bits: int) -> F32:
    """Signed 24-bit numbers, little endian, three a row."""
    words = np.zeros((len(codes), 3, 4), np.uint8)
    words[:, :, 1:] = codes.reshape(-1, 3, 3)
    signed = words.view("<i4")[:, :, 0] >> 8  # from the upper bytes, so that the sign comes along
    return (signed * 2.0**-fractional_bits).astype(np.float32)


def _derived_w(codes: Codes) -> F32:
    """Rotations of versions 1 and 2: x, y, z in bytes, and w >= 0 from the length."""
    xyz = codes.astype(np.float64) / 127.5 - 1
    w = np.sqrt(np.maximum(0, 1 - np.einsum("ni,ni->n", xyz, xyz)))
    return np.column_stack([w, xyz]).astype(np.float32)


def _smallest_three(words: npt.NDArray[np.uint32]) -> F32:
    """Rotations of version 3 on: index of the largest in (x, y, z, w), three signed magnitudes."""
    parts = np.stack([words >> 20 & 1023, words >> 10 & 1023, words & 1023], axis=1)
    magnitudes = (parts & 511) / (511 * np.sqrt(2))
    rest = np.where(parts & 512, -magnitudes, magnitudes)
    return join_largest(words >> 30, rest)[:, [3, 0, 1, 2]]
