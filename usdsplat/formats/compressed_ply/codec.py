"""The numbers of a compressed PLY: words of 32 bits within the bounds of a chunk, and bytes.

Everything here is arrays in, arrays out; `compressed_ply` knows the file. Arrays of splats start at
the first splat of a chunk. Nine components of a splat are coded within bounds: position, logarithm
of the scale, colour, three each; all nine go through each step together, which is what it is fast
by.

Source: splat-transform and SuperSplat, as the constants below say.
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
"""Splats that share bounds."""

LOG_SCALE_LIMIT = 20.0
"""Logarithms of scales are kept within +- this, which gives a scale of 0 a logarithm as well."""

_POSITION, _SCALE, _COLOR = slice(0, 3), slice(3, 6), slice(6, 9)
_WORDS = ((_POSITION, 0), (_SCALE, 2), (_COLOR, 3))
"""Components, and the word that holds their codes."""
_TOPS = np.array([2047, 1023, 2047, 2047, 1023, 2047, 255, 255, 255], np.int32)[:, None]
_SHIFTS = np.array([21, 11, 0, 21, 11, 0, 24, 16, 8], np.int32)[:, None]
"""Of the components: highest code, and place in the word."""

_ROTATION_TOP = 1023
_ROTATION_SHIFTS = np.array([20, 10, 0], np.int32)[:, None]
_ROTATION_END = np.float32(math.sqrt(0.5))
_ROTATION_STEP = np.float32(math.sqrt(2) / _ROTATION_TOP)
"""Of the components that are stored: highest code, places in the word, and what codes mean."""

_HARMONICS_STEP = 8 / 256
_HARMONICS_END = 4.0

_TAME = 1e37
"""Between bounds of this size rounding makes nothing infinite."""


def ranges_of(bounds: F32) -> F32:
    """Bounds as `decode_words` needs them.

    Args:
        bounds: Chunk, attribute (position, logarithm of scale, colour), end, axis or channel:
            finite, shape (c, 3, 2, 3).

    Returns:
        Lower bound and distance of two codes, of each component, in each chunk: shape (2, 9, c).
        Colours are coefficients of degree 0.
    """
    out = bounds.transpose(2, 1, 3, 0).reshape(2, 9, -1).astype(np.float64)
    out[:, _COLOR] = rgb_to_dc(out[:, _COLOR])
    out[1] -= out[0]
    out[1] /= _TOPS
    with np.errstate(over="ignore"):  # named when a splat is settled
        return out.astype(np.float32)


def decode_words(builder: CloudBuilder, rows: slice, words: I32, ranges: F32) -> None:
    """Decode all but the harmonics of some splats, and settle them.

    Args:
        builder: Filled at `rows`; harmonics are there already.
        rows: Of the splats.
        words: Position, rotation, scale and colour, shape (4, n); the bits are what counts.
        ranges: Of their chunks, as `ranges_of` gives them, shape (2, 9, c).

    Raises:
        FormatError: If a number is infinite.
    """
    values = _within(ranges, words)
    with np.errstate(over="ignore"):  # settling names what is infinite
        np.exp(values[_SCALE], out=values[_SCALE])
    for axis in range(3):
        builder.positions[rows, axis] = values[axis]
        builder.scales[rows, axis] = values[3 + axis]
        builder.sh[rows, 0, axis] = values[6 + axis]
    np.multiply(words[3] & 255, np.float32(1 / 255), out=builder.opacities[rows])
    is_unit = _decode_rotations(builder.rotations[rows], words[1])
    # Codes between such bounds are finite, all but what exp makes of them: most need no settling.
    is_finite = np.abs(ranges).max() < _TAME and np.isfinite(values[_SCALE].max())
    if not (is_unit and is_finite):
        builder.settle(rows)


def decode_harmonics(out: F32, codes: U8) -> None:
    """Fill the harmonics above degree 0 of some splats, and those of degree 0 with nonsense.

    The outermost codes mean +-4, the others the middle of their interval.

    Args:
        out: Coefficients, shape (n, k + 1, 3), contiguous.
        codes: Channel by channel, shape (n, 3, k).
    """
    wanted = np.empty(out.shape, np.uint8)
    wanted[:, 0] = 1
    for channel in range(3):
        wanted[:, 1:, channel] = codes[:, channel]
    flat = out.reshape(-1)  # a view: its loops are longer
    np.multiply(wanted.reshape(-1), np.float32(_HARMONICS_STEP), out=flat)
    flat += np.float32(_HARMONICS_STEP / 2 - _HARMONICS_END)
    if wanted.min() == 0 or wanted.max() == 255:
        np.copyto(out, -_HARMONICS_END, where=wanted == 0)
        np.copyto(out, _HARMONICS_END, where=wanted == 255)


def encode(cloud: SplatCloud, rows: Rows) -> tuple[U32, F32, U8]:
    """Code some splats of `cloud`.

    Args:
        cloud: Finite; an opacity may be 0 or 1, a scale 0.
        rows: Splats, chunk by chunk; the last chunk may be shorter.

    Returns:
        Position, rotation, scale and colour, shape (n, 4); bounds in the form that `ranges_of`
        takes, shape (ceil(n / 256), 3, 2, 3); harmonics above degree 0 channel by channel, those
        beyond +-4 clamped, shape (n, k).
    """
    # A last chunk is filled up with its own last splat, which leaves its bounds alone.
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
    """Values of the nine components within their ranges, shape (9, n)."""
    count = words.shape[1]
    whole = count // CHUNK
    codes = np.empty((9, count), np.int32)
    for components, word in _WORDS:
        np.right_shift(words[word], _SHIFTS[components], out=codes[components])
    codes &= _TOPS
    values = codes.astype(np.float32)
    low, step = ranges[..., None]
    with np.errstate(over="ignore", invalid="ignore"):  # named when a splat is settled
        chunks = values[:, : whole * CHUNK].reshape(9, whole, CHUNK)  # a view
        chunks *= step[:, :whole]
        chunks += low[:, :whole]
        if rest := count % CHUNK:
            values[:, -rest:] *= step[:, -1]
            values[:, -rest:] += low[:, -1]
    return values


def _encode_within(words: U32, values: F32) -> F32:
    """Code nine components, shape (9, n) of whole chunks; gives their bounds."""
    chunks = values.reshape(9, -1, CHUNK)
    lower, upper = chunks.min(axis=2), chunks.max(axis=2)
    span = upper.astype(np.float64) - lower
    # A flat chunk has no span: all of it is code 0.
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
    """Fill `out`, shape (n, 4), with rotations whose largest component is not stored.

    Returns:
        Whether their length is 1; three components may say that it is more.
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
    """Words whose upper two bits count the component that is largest in magnitude."""
    w, x, y, z = np.ascontiguousarray(quaternions.T)
    is_x, is_z = np.abs(x) > np.abs(w), np.abs(z) > np.abs(y)
    front, back = np.where(is_x, x, w), np.where(is_z, z, y)
    in_back = np.abs(back) > np.abs(front)
    largest = np.where(in_back, is_z + np.int32(2), is_x)
    # Of q and -q the one whose largest component is positive.
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
    """Codes of the coefficients above degree 0, channel by channel; overwrites `sh`."""
    sh *= np.float32(1 / _HARMONICS_STEP)
    sh += np.float32(_HARMONICS_END / _HARMONICS_STEP)
    codes = sh.clip(0, 255, out=sh).astype(np.uint8)  # cuts off: codes stand for middles
    above = codes.shape[1] // 3 - 1
    out = np.empty((len(codes), 3, above), np.uint8)
    for channel in range(3):
        out[:, channel] = codes[:, 3 + channel :: 3]
    return out.reshape(len(codes), -1)
