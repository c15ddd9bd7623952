"""Decode the attributes of an SPZ file; `spz.encoding` is the inverse.

Source: nianticlabs/spz, `src/cc/load-spz.cc`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32
from usdsplat.core.encoding import join_largest
from usdsplat.core.quaternion import normalize
from usdsplat.formats.cloud_builder import CloudBuilder
from usdsplat.formats.spz.container import SpzHeader

Codes = npt.NDArray[np.uint8]

_OPACITIES = (np.arange(256) / 255).astype(np.float32)
_SCALES = np.exp(np.arange(256) / 16 - 10).astype(np.float32)
_DC = ((np.arange(256) / 255 - 0.5) / 0.15).astype(np.float32)

_magnitudes = np.arange(512) / (511 * np.sqrt(2))
_COMPONENTS = np.concatenate([_magnitudes, -_magnitudes]).astype(np.float32)
"""Quaternion component by code: a sign bit above nine bits of magnitude."""


def decode(builder: CloudBuilder, header: SpzHeader, name: str, rows: slice, codes: Codes) -> None:
    """Decode an attribute of some splats.

    All values are finite and settled, except for the half-precision positions of version 1.

    Args:
        builder: Cloud under construction.
        header: Header of the file.
        name: Name of the attribute, as in `SpzHeader.sizes`.
        rows: Rows of the splats.
        codes: Codes of the splats, a row for each splat.
    """
    match name:
        case "positions" if header.version == 1:
            builder.positions[rows] = codes.view("<f2")
        case "positions":
            _fixed_point(builder.positions[rows], codes, header.fractional_bits)
        case "alphas":
            builder.opacities[rows] = _OPACITIES[codes[:, 0]]
        case "colors":
            builder.sh[rows, 0] = _DC[codes]
        case "scales":
            builder.scales[rows] = _SCALES[codes]
        case "rotations" if header.version < 3:
            builder.rotations[rows] = _derived_w(codes)
        case "rotations":
            xyzw = _smallest_three(codes.view("<u4")[:, 0])
            builder.rotations[rows, 0] = xyzw[:, 3]
            builder.rotations[rows, 1:] = xyzw[:, :3]
        case "harmonics":
            signed = (codes ^ 128).view(np.int8)  # equals codes - 128
            out = builder.sh[rows, 1:].reshape(codes.shape)  # a view
            np.multiply(signed, np.float32(1 / 128), out=out, dtype=np.float32)


def _fixed_point(out: F32, codes: Codes, fractional_bits: int) -> None:
    """Decode signed 24-bit little-endian numbers, three a row."""
    words = np.zeros((out.size, 4), np.uint8)
    of_number = codes.reshape(-1, 3)
    for place in range(3):  # a strided copy per byte is faster than copies of three bytes
        words[:, place + 1] = of_number[:, place]
    signed = words.view("<i4")[:, 0] >> 8  # shifted down from the upper bytes to extend the sign
    step = np.float32(2.0**-fractional_bits)
    np.multiply(signed, step, out=out.reshape(-1), dtype=np.float32, casting="same_kind")


def _derived_w(codes: Codes) -> F32:
    """Decode rotations of versions 1 and 2: x, y, z in bytes, w >= 0 from the unit length."""
    xyz = codes.astype(np.float64) / 127.5 - 1
    w = np.sqrt(np.maximum(0, 1 - np.einsum("ni,ni->n", xyz, xyz)))
    return normalize(np.column_stack([w, xyz])).astype(np.float32)


def _smallest_three(words: npt.NDArray[np.uint32]) -> F32:
    """Decode rotations of version 3 on: index of the largest in (x, y, z, w), three signed
    values."""
    rest = np.empty((3, len(words)), np.float32)
    for component, shift in zip(rest, (20, 10, 0), strict=True):
        np.take(_COMPONENTS, words >> shift & 1023, out=component, mode="clip")
    return join_largest((words >> 30).astype(np.uint8), rest.T)
