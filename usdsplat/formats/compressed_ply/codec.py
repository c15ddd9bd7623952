"""Encode and decode the numbers of a compressed PLY.

This module converts arrays only; `compressed_ply` reads and writes the file. Arrays of splats start
at the first splat of a chunk. Nine components of a splat are quantised within bounds: position,
logarithm of the scale and colour, three each. Each step processes all nine together, which is fast.

Source: splat-transform and SuperSplat, which use the constants below.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, SplatCloud
from usdsplat.core.sh import dc_to_rgb, rgb_to_dc
from usdsplat.formats.cloud_builder import CloudBuilder

U8 = npt.NDArray[np.uint8]
U32 = npt.NDArray[np.uint32]
Rows = npt.NDArray[np.intp]

CHUNK = 256
"""Number of splats in a chunk."""

LOG_SCALE_LIMIT = 20.0
"""Limit of the magnitude of logarithms of scales, so that a scale of 0 has a logarithm."""

_POSITION, _SCALE, _COLOR = slice(0, 3), slice(3, 6), slice(6, 9)
_WORDS = ((_POSITION, 0), (_SCALE, 2), (_COLOR, 3))
"""Slices of components, and the index of the word that holds their codes."""
_TOPS = np.array([2047, 1023, 2047, 2047, 1023, 2047, 255, 255, 255], np.int32)[:, None]
_SHIFTS = np.array([21, 11, 0, 21, 11, 0, 24, 16, 8], np.int32)[:, None]
"""Highest code of each component, and its bit position in the word."""

_ROTATION_TOP = 1023
_ROTATION_SHIFTS = np.array([20, 10, 0], np.int32)[:, None]
_ROTATION_END = np.float32(math.sqrt(0.5))
_ROTATION_STEP = np.float32(math.sqrt(2) / _ROTATION_TOP)
"""Highest code of a stored quaternion component, bit positions, and the value range."""

_HARMONICS_STEP = 8 / 256
_HARMONICS_END = 4.0

_TAME = 1e37
"""Limit of the magnitude of bounds below which rounding cannot overflow float32."""


def ranges_of(bounds: F32) -> F32:
    """Return bounds in the form that `decode_words` takes.

    Args:
        bounds: Finite bounds, shape (c, 3, 2, 3): by chunk, by attribute (position, logarithm of
            scale, colour), lower and upper, by axis or channel.

    Returns:
        Lower bound and step between codes, of each component, in each chunk: shape (2, 9, c).
        Colours are coefficients of degree 0.
    """
    out = bounds.transpose(2, 1, 3, 0).reshape(2, 9, -1).astype(np.float64)
    out[:, _COLOR] = rgb_to_dc(out[:, _COLOR])
    out[1] -= out[0]
    out[1] /= _TOPS
    with np.errstate(over="ignore"):  # `settle` reports infinities
        return out.astype(np.float32)


def decode_words(builder: CloudBuilder, rows: slice, words: I32, ranges: F32) -> None:
    """Decode some splats, except for their harmonics, and settle them.

    Args:
        builder: Filled at `rows`; the harmonics above degree 0 are already decoded.
        rows: Of the splats.
        words: Position, rotation, scale and colour words, shape (4, n), read as unsigned bits.
        ranges: Result of `ranges_of` for their chunks, shape (2, 9, c).

    Raises:
        FormatError: If a number is infinite.
    """
    values = _within(ranges, words)
    with np.errstate(over="ignore"):  # `settle` reports infinities
        np.exp(values[_SCALE], out=values[_SCALE])
    for axis in range(3):
        builder.positions[rows, axis] = values[axis]
        builder.scales[rows, axis] = values[3 + axis]
        builder.sh[rows, 0, axis] = values[6 + axis]
    np.multiply(words[3] & 255, np.float32(1 / 255), out=builder.opacities[rows])
    is_unit = _decode_rotations(builder.rotations[rows], words[1])
    # Within these bounds only exp can overflow, so most splats need no settling.
    is_finite = np.abs(ranges).max() < _TAME and np.isfinite(values[_SCALE].max())
    if not (is_unit and is_finite):
        builder.settle(rows)


def decode_harmonics(out: F32, codes: U8) -> None:
    """Decode the harmonics above degree 0 of some splats; overwrites those of degree 0.

    The lowest and highest code mean -4 and +4, the others the middle of their interval.

    Args:
        out: Coefficients, shape (n, k + 1, 3), contiguous.
        codes: Codes, channel by channel, shape (n, 3, k).
    """
    wanted = np.empty(out.shape, np.uint8)
    wanted[:, 0] = 1
    for channel in range(3):
        wanted[:, 1:, channel] = codes[:, channel]
    flat = out.reshape(-1)  # a contiguous view makes NumPy's inner loops longer
    np.multiply(wanted.reshape(-1), np.float32(_HARMONICS_STEP), out=flat)
    flat += np.float32(_HARMONICS_STEP / 2 - _HARMONICS_END)
    if wanted.min() == 0 or wanted.max() == 255:
        np.copyto(out, -_HARMONICS_END, where=wanted == 0)
        np.copyto(out, _HARMONICS_END, where=wanted == 255)


def encode(cloud: SplatCloud, rows: Rows) -> tuple[U32, F32, U8]:
    """Encode some splats of `cloud`.

    Args:
        cloud: Finite; an opacity may be 0 or 1, a scale 0.
        rows: Indices of the splats, chunk by chunk; the last chunk may be shorter.

    Returns:
        Position, rotation, scale and colour words, shape (n, 4); bounds in the form that
        `ranges_of` takes, shape (ceil(n / 256), 3, 2, 3); codes of the harmonics above degree 0,
        channel by channel and clamped to +-4, shape (n, k).
    """
    # The last chunk is padded with its own last splat, which does not change its bounds.
    padded = np.concatenate([rows, np.full(-len(rows) % CHUNK, rows[-1])])
    sh = cloud.sh.take(padded, axis=0).reshape(len(padded), -1)
    values = np.empty((9, len(padded)), np.float32)
    values[_POSITION] = cloud.positions.take(padded, axis=0).T
    values[_SCALE] = cloud.scales.take(padded, axis=0).T
    values[_COLOR] = dc_to_rgb(sh[:, :3].T)
    with np.errstate(divide="ignore"):
        np.log(values[_SCALE], out=values[_SCALE])
    values[_SCALE].clip(-LOG_SCALE_LIMIT, LOG_SCALE_LIMIT, out=values[_SCALE])
    words = np.empty((len(padded), 4), np.uint32)
    bounds = _encode_within(words, values)
    words[:, 1] = _encode_rotations(cloud.rotations.take(padded, axis=0))
    alphas = np.rint(cloud.opacities.take(padded).clip(0, 1) * np.float32(255))
    words[:, 3] |= alphas.astype(np.uint32)
    return words[: len(rows)], bounds, _encode_harmonics(sh[: len(rows)])


def _within(ranges: F32, words: I32) -> F32:
    """Return the values of the nine components within their ranges, shape (9, n)."""
    count = words.shape[1]
    whole = count // CHUNK
    codes = np.empty((9, count), np.int32)
    for components, word in _WORDS:
        np.right_shift(words[word], _SHIFTS[components], out=codes[components])
    codes &= _TOPS
    values = codes.astype(np.float32)
    low, step = ranges[..., None]
    with np.errstate(over="ignore", invalid="ignore"):  # `settle` reports infinities
        chunks = values[:, : whole * CHUNK].reshape(9, whole, CHUNK)  # a view
        chunks *= step[:, :whole]
        chunks += low[:, :whole]
        if rest := count % CHUNK:
            values[:, -rest:] *= step[:, -1]
            values[:, -rest:] += low[:, -1]
    return values


def _encode_within(words: U32, values: F32) -> F32:
    """Encode nine components of whole chunks, shape (9, n), and return the bounds."""
    chunks = values.reshape(9, -1, CHUNK)
    lower, upper = chunks.min(axis=2), chunks.max(axis=2)
    span = upper.astype(np.float64) - lower
    # A chunk without extent along a component has code 0 there.
    slope = np.minimum(_TOPS / np.where(span > 0, span, np.inf), np.finfo(np.float32).max)
    chunks -= lower[..., None]
    chunks *= slope.astype(np.float32)[..., None]
    codes = np.rint(values, out=values).astype(np.int32)
    np.minimum(codes, _TOPS, out=codes)
    codes <<= _SHIFTS
    for components, word in _WORDS:
        words[:, word] = np.bitwise_or.reduce(codes[components], axis=0).view(np.uint32)
    return np.stack([lower, upper]).reshape(2, 3, 3, -1).transpose(3, 1, 0, 2)


def _decode_rotations(out: F32, words: I32) -> bool:
    """Decode rotations, whose largest component is not stored, into `out`, shape (n, 4).

    Returns:
        Whether all have length 1: three stored components may already exceed it.
    """
    largest = words >> 30 & 3
    stored = (words >> _ROTATION_SHIFTS & _ROTATION_TOP).astype(np.float32)
    stored *= _ROTATION_STEP
    stored -= _ROTATION_END
    first, second, third = stored
    squared = np.einsum("in,in->n", stored, stored)
    rest = np.sqrt(np.maximum(1 - squared, 0))
    is_first = largest == 0
    out[:, 0] = np.where(is_first, rest, first)
    out[:, 1] = np.where(largest == 1, rest, np.where(is_first, first, second))
    out[:, 2] = np.where(largest == 2, rest, np.where(largest < 2, second, third))
    out[:, 3] = np.where(largest == 3, rest, third)
    return bool(squared.max() <= 1)


def _encode_rotations(quaternions: F32) -> U32:
    """Encode rotations; the upper two bits of a word are the index of the largest component."""
    w, x, y, z = np.ascontiguousarray(quaternions.T)
    is_x, is_z = np.abs(x) > np.abs(w), np.abs(z) > np.abs(y)
    front, back = np.where(is_x, x, w), np.where(is_z, z, y)
    in_back = np.abs(back) > np.abs(front)
    largest = np.where(in_back, is_z + np.int32(2), is_x)
    # q and -q are the same rotation: encode the one whose largest component is positive.
    slope = np.where(np.where(in_back, back, front) < 0, -1 / _ROTATION_STEP, 1 / _ROTATION_STEP)
    rest = np.stack(
        [
            np.where(largest == 0, x, w),
            np.where(largest < 2, y, x),
            np.where(largest == 3, y, z),
        ]
    )
    rest *= slope
    rest += np.float32(_ROTATION_TOP / 2)
    codes = np.rint(rest, out=rest).clip(0, _ROTATION_TOP).astype(np.int32) << _ROTATION_SHIFTS
    return (largest << np.int32(30) | np.bitwise_or.reduce(codes, axis=0)).view(np.uint32)


def _encode_harmonics(sh: F32) -> U8:
    """Encode the coefficients above degree 0, channel by channel; overwrites `sh`."""
    sh *= np.float32(1 / _HARMONICS_STEP)
    sh += np.float32(_HARMONICS_END / _HARMONICS_STEP)
    # Truncates, because codes stand for interval middles.
    codes = sh.clip(0, 255, out=sh).astype(np.uint8)
    above = codes.shape[1] // 3 - 1
    out = np.empty((len(codes), 3, above), np.uint8)
    for channel in range(3):
        out[:, channel] = codes[:, 3 + channel :: 3]
    return out.reshape(len(codes), -1)
