"""Encode splats as the attributes of an SPZ file.

Values out of range are clamped: scales to exp(-10) to exp(5.94), coefficients of degree 0 to +-3.33
and those above to -1 to 0.992. Harmonics keep as many bits as in the library, 5 in degree 1 and 4
above, rounded to nearest, which makes files small.

Source: nianticlabs/spz, `src/cc/load-spz.cc`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.core.encoding import split_largest
from usdsplat.formats.spz.container import MAX_FRACTIONAL_BITS

Codes = npt.NDArray[np.uint8]

LARGEST_STEP = (1 << 23) - 1
"""Largest magnitude of a coordinate, in steps."""

_STEP_DEGREE_1 = 1 << 3
_STEP_ABOVE = 1 << 4
_DEGREE_1 = 9
"""Number of coefficients of degree 1 of a splat, all channels."""


def finest_bits(positions: F32) -> int | None:
    """Return the largest number of fractional bits, 0 to 24, with which no coordinate overflows.

    The error of a position is then at most 2^-(bits + 1). Returns None if even whole numbers
    overflow, or if a coordinate is not finite.
    """
    reach = max(float(positions.max(initial=0)), -float(positions.min(initial=0)))
    for bits in range(MAX_FRACTIONAL_BITS, -1, -1):
        if reach * 2.0**bits < LARGEST_STEP + 0.5:
            return bits
    return None


def encode(cloud: SplatCloud, name: str, rows: slice, fractional_bits: int) -> Codes:
    """Return the codes of the attribute `name` (`SpzHeader.sizes` of version 3 on).

    Returns:
        Codes, a row for each splat.
    """
    match name:
        case "positions":
            return _fixed_point(cloud.positions[rows], fractional_bits)
        case "alphas":
            return _bytes(cloud.opacities[rows, None] * np.float32(255))
        case "colors":
            return _bytes(cloud.sh[rows, 0] * np.float32(0.15 * 255) + np.float32(127.5))
        case "scales":
            with np.errstate(divide="ignore"):  # a scale of 0 becomes the smallest code
                return _bytes(np.log(cloud.scales[rows]) * np.float32(16) + np.float32(160))
        case "rotations":
            words = _smallest_three(cloud.rotations[rows])
            return words.view(np.uint8).reshape(-1, 4)
        case _:
            return _harmonics(cloud.sh[rows, 1:].reshape(rows.stop - rows.start, -1))


def _bytes(values: F32) -> Codes:
    """Round to the nearest of 0 to 255."""
    np.rint(values, out=values)
    return np.clip(values, 0, 255, out=values).astype(np.uint8)


def _fixed_point(positions: F32, fractional_bits: int) -> Codes:
    """Encode signed 24-bit little-endian numbers, three a row."""
    steps = np.rint(positions * np.float32(2.0**fractional_bits)).astype("<i4")
    of_number = steps.reshape(-1, 1).view(np.uint8)
    codes = np.empty((positions.size, 3), np.uint8)
    for place in range(3):  # a strided copy per byte is faster than copies of three bytes
        codes[:, place] = of_number[:, place]
    return codes.reshape(-1, 9)


def _smallest_three(rotations: F32) -> npt.NDArray[np.uint32]:
    """Encode the index of the largest in (x, y, z, w), and sign and nine bits of the others."""
    largest, rest = split_largest(rotations[:, [1, 2, 3, 0]])
    magnitudes = np.minimum(np.rint(np.abs(rest) * np.float32(511 * np.sqrt(2))), 511)
    codes = magnitudes.astype("<u4") | np.signbit(rest).astype("<u4") << 9
    words = largest.astype("<u4") << 30 | codes[:, 0] << 20 | codes[:, 1] << 10 | codes[:, 2]
    return np.ascontiguousarray(words, "<u4")


def _harmonics(values: F32) -> Codes:
    """Return codes 128 v + 128, rounded to the bits that are kept."""
    codes = np.empty(values.shape, np.uint8)
    for columns, step in (
        (slice(0, _DEGREE_1), _STEP_DEGREE_1),
        (slice(_DEGREE_1, None), _STEP_ABOVE),
    ):
        scaled = values[:, columns] * np.float32(128 / step)
        np.rint(scaled, out=scaled)
        scaled *= step
        scaled += 128
        codes[:, columns] = np.clip(scaled, 0, 255, out=scaled)
    return codes
