"""Pack splats in 16 bytes and harmonics in one byte per coefficient.

The layout is `smallestThree47_log16_v1`. It is fixed, because files depend on it: a change needs a
new token and a second reader.

Core, four 32-bit integers x, y, z, w per splat, least significant bit first:

    x   scale 0 (16)   scale 1 (16)
    y   scale 2 (16)   rotation a (15)   opacity bit 0 (1)
    z   rotation b (15)   rotation c (15)   index of the largest component (2)
    w   red (8)   green (8)   blue (8)   opacity bits 1..8 (8)

- Scale: code 0 is exactly 0; code q = 1..65535 is 2^(q / 1024 - 32) scene units, so powers of two
  are exact. Positive scales outside are clamped to the nearest code and stay positive.
- Rotation: of the unit quaternion (w, x, y, z), the component of largest magnitude is omitted and
  made positive; a, b, c are the others in order, (q - 16383) / 16383 / sqrt(2) with
  q = 0..32766. The identity is exact.
- Opacity: q / 511, q = 0..511. 0 and 1 are exact.
- Degree-0 colour, 0.5 + C0 sh[0], per channel: lower + (upper - lower) q / 255, where
  `color_range` holds the minimum and maximum that occur in the cloud, without a limit.

Harmonics of degree 1 and above: the coefficients of each splat in stock order, interleaved RGB, one
signed byte q = -127..127 each, padded with zeros to whole int4. A coefficient of degree l is q /
127 * harmonics_range[l - 1], the largest magnitude of that degree in the cloud. Zero is exact.

Worst-case errors: rotation 0.0086 degrees (2 sqrt(12) half steps; the documented bound
is 0.01); scale 0.034 % (2^(1/2048) - 1) inside the range; opacity 1/1022; colour
(upper - lower) / 510; harmonics of degree l harmonics_range[l - 1] / 254.
"""

from __future__ import annotations

import functools
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core import encoding, quaternion
from usdsplat.core.cloud import F32, I64, SplatCloud
from usdsplat.core.errors import UsageError
from usdsplat.core.sh import coefficient_count, dc_to_rgb, rgb_to_dc
from usdsplat.schema.vt import empty

I32 = npt.NDArray[np.int32]
U32 = npt.NDArray[np.uint32]

TOKEN = "smallestThree47_log16_v1"

ROTATION_ERROR = math.radians(0.01)
"""Upper bound of the rotation error [radian]."""
SCALE_ERROR = 2.0 ** (1 / 2048) - 1
"""Relative error of scales from 2^-32 to 2^32 [scene unit]."""

BOUNDS = {
    "rotations": "0.01 degrees",
    "scales": "0.034 %",
    "opacities": "1/1022",
    "sh": "1/510 of the range of colours, 1/254 of the largest harmonic of each degree",
}
"""Field of the cloud -> error that packing adds, for display."""

_ROTATION_TOP = 32766
_SCALE_STEPS = 1024  # codes per octave
_SCALE_OFFSET = 32  # octaves below 1
_CHUNK = 1 << 14  # splats per block: temporaries stay in the cache


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PackedArrays:
    """Arrays of a packed prim other than its centres; the module describes the layout."""

    core: I32
    """16-byte records, shape (n, 4)."""
    color_range: F32
    """Minimum and maximum of the degree-0 colours, shape (2, 3)."""
    harmonics: I32
    """Harmonics bytes, shape (n * harmonics_width(degree), 4)."""
    harmonics_range: F32
    """Largest magnitude of degree 1, 2, ..., shape (degree,)."""

    @property
    def degree(self) -> int:
        """Degree of the harmonics, 0 to 4."""
        return len(self.harmonics_range)


def harmonics_width(degree: int) -> int:
    """Return the number of int4 that hold the harmonics of one splat."""
    return -(-3 * (coefficient_count(degree) - 1) // 16)


def pack(cloud: SplatCloud) -> PackedArrays:
    """Quantise everything but the centres, ids and velocities.

    Args:
        cloud: Rotations need not be normalised; opacities outside [0..1] are clamped.

    Raises:
        UsageError: If a value is not finite.
    """
    color_range, ranges = _ranges(cloud.sh)
    for name in ("scales", "rotations", "opacities"):
        if not np.isfinite(getattr(cloud, name)).all():
            raise _not_finite(name)
    core = empty((len(cloud), 4), np.int32)
    for rows in _chunks(len(cloud)):
        _pack_core(cloud, color_range, rows, core[rows].view(np.uint32))
    return PackedArrays(
        core=core,
        color_range=color_range,
        harmonics=_pack_harmonics(cloud.sh, ranges),
        harmonics_range=ranges,
    )


def unpack(
    positions: F32, arrays: PackedArrays, *, ids: I64 | None = None, velocities: F32 | None = None
) -> SplatCloud:
    """Decode splats.

    Args:
        positions: Centres [scene unit], shape (n, 3); n rows of `arrays.core` are needed.
        arrays: Result of `pack`, or the arrays of a prim, with the shapes of `PackedArrays`.
        ids: Ids, shape (n,).
        velocities: Velocities [scene unit / s], shape (n, 3).

    Source: the layout above.
    """
    n = len(positions)
    scales, rotations = np.empty((n, 3), np.float32), np.empty((n, 4), np.float32)
    opacities = np.empty(n, np.float32)
    sh = np.empty((n, coefficient_count(arrays.degree), 3), np.float32)
    core = arrays.core.view(np.uint32)
    for rows in _chunks(n):
        x, y, z, w = core[rows].T
        table = _scale_table()
        scales[rows, 0], scales[rows, 1] = table[x & 0xFFFF], table[x >> 16]
        scales[rows, 2] = table[y & 0xFFFF]
        rotations[rows] = _rotations(y, z)
        opacities[rows] = (w >> 24 << 1 | y >> 31).astype(np.float32) / np.float32(511)
        sh[rows, 0] = _colors(w, arrays.color_range)
    _unpack_harmonics(arrays, sh)
    return SplatCloud(
        positions=positions,
        scales=scales,
        rotations=rotations,
        opacities=opacities,
        sh=sh,
        ids=ids,
        velocities=velocities,
    )


def _pack_core(cloud: SplatCloud, color_range: F32, rows: slice, out: U32) -> None:
    """Write the 16-byte records of some rows."""
    scale = _scale_codes(cloud.scales[rows]).T
    unit = quaternion.normalize(cloud.rotations[rows])
    largest, rotation = encoding.encode_smallest_three(unit, top=_ROTATION_TOP)
    a, b, c = rotation.T
    opacity = encoding.quantize(cloud.opacities[rows], 0.0, 1.0, 511)
    colors = dc_to_rgb(cloud.sh[rows, 0].astype(np.float64))
    red, green, blue = encoding.quantize(colors, color_range[0], color_range[1], 255).T
    out[:, 0] = scale[0] | scale[1] << 16
    out[:, 1] = scale[2] | a << 16 | (opacity & 1) << 31
    out[:, 2] = b | c << 15 | largest.astype(np.uint32) << 30
    out[:, 3] = red | green << 8 | blue << 16 | opacity >> 1 << 24


def _scale_codes(scales: F32) -> U32:
    """Return the nearest codes; only a scale of 0 gets code 0."""
    with np.errstate(divide="ignore"):
        octaves = np.log2(scales.astype(np.float64))
    codes = np.rint((octaves + _SCALE_OFFSET) * _SCALE_STEPS)
    return np.where(scales == 0, 0, np.clip(codes, 1, 65535)).astype(np.uint32)


@functools.cache
def _scale_table() -> F32:
    """Return the scale of every code, shape (65536,)."""
    table = np.exp2(np.arange(65536) / _SCALE_STEPS - _SCALE_OFFSET)
    table[0] = 0.0
    return table.astype(np.float32)


def _rotations(y: U32, z: U32) -> F32:
    """Decode the unit quaternions (w, x, y, z) of records."""
    codes = np.stack([y >> 16 & 0x7FFF, z & 0x7FFF, z >> 15 & 0x7FFF], axis=1)
    return encoding.decode_smallest_three(z >> 30, codes, top=_ROTATION_TOP)


def _colors(w: U32, color_range: F32) -> npt.NDArray[Any]:
    """Decode the degree-0 coefficients of records."""
    codes = np.stack([w & 0xFF, w >> 8 & 0xFF, w >> 16 & 0xFF], axis=1)
    return rgb_to_dc(encoding.dequantize(codes, color_range[0], color_range[1], 255))


def _ranges(sh: F32) -> tuple[F32, F32]:
    """Return the range of degree-0 colours, (2, 3), and the peak of each degree >= 1.

    The range of an empty cloud is 0 to 1.
    """
    n, k, _ = sh.shape
    if not n:
        empty = np.array([[0, 0, 0], [1, 1, 1]], np.float32)
        return empty, np.zeros(math.isqrt(k) - 1, np.float32)
    flat = sh.reshape(n, 3 * k)
    low = np.min([flat[rows].min(axis=0) for rows in _chunks(n)], axis=0)
    high = np.max([flat[rows].max(axis=0) for rows in _chunks(n)], axis=0)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise _not_finite("sh")
    colors = dc_to_rgb(np.stack([low[:3], high[:3]]).astype(np.float64))
    peaks = np.maximum(high, -low)
    bands = [slice(3 * degree**2, 3 * (degree + 1) ** 2) for degree in range(1, math.isqrt(k))]
    return colors.astype(np.float32), np.array([peaks[band].max() for band in bands], np.float32)


def _steps(ranges: F32) -> F32:
    """Return the step of each coefficient and channel above degree 0, shape (3 (k - 1),)."""
    counts = [3 * (2 * degree + 1) for degree in range(1, len(ranges) + 1)]
    return np.repeat(ranges / np.float32(127), counts)


def _pack_harmonics(sh: F32, ranges: F32) -> I32:
    """Encode all coefficients above degree 0 as signed bytes, padded to whole int4."""
    n, k, _ = sh.shape
    used = 3 * (k - 1)
    if not used:
        return np.empty((0, 4), np.int32)
    width = harmonics_width(len(ranges))
    packed = empty((n * width, 4), np.int32)
    codes = packed.view(np.int8).reshape(n, 16 * width)
    steps = _steps(ranges)
    slopes = np.divide(1, steps, out=np.zeros_like(steps), where=steps > 0)
    for rows in _chunks(n):
        scaled = sh[rows, 1:].reshape(-1, used) * slopes
        np.rint(scaled, out=scaled)
        codes[rows, :used] = np.clip(scaled, -127, 127, out=scaled)
        codes[rows, used:] = 0
    return _little_endian(packed)


def _unpack_harmonics(arrays: PackedArrays, sh: F32) -> None:
    """Decode the harmonics above degree 0 into sh[:, 1:]."""
    n, k, _ = sh.shape
    used = 3 * (k - 1)
    if not used or not n:
        return
    width = harmonics_width(arrays.degree)
    codes = _little_endian(np.ascontiguousarray(arrays.harmonics)).view(np.int8)
    codes = codes.reshape(-1, 16 * width)
    steps = _steps(arrays.harmonics_range)
    flat = sh.reshape(n, 3 * k)
    for rows in _chunks(n):
        np.multiply(codes[rows, :used], steps, out=flat[rows, 3:])


def _little_endian(integers: I32) -> I32:
    """Convert between native and little-endian byte order."""
    return integers if sys.byteorder == "little" else integers.byteswap()


def _chunks(n: int) -> Iterator[slice]:
    """Return slices that cover n rows."""
    return (slice(first, min(first + _CHUNK, n)) for first in range(0, n, _CHUNK))


def _not_finite(name: str) -> UsageError:
    return UsageError(
        f"packed form, {name}", "a value that is not finite", "finite numbers; prune the cloud"
    )
