"""The numbers of a compressed PLY: words of 32 bits within the bounds of a chunk, and bytes.

Everything here is arrays in, arrays out; `compressed_ply` knows the file. Arrays of splats start at
the first splat of a chunk.

Source: splat-transform and SuperSplat; specs of the bits are in the constants below.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, SplatCloud
from usdsplat.core.sh import dc_to_rgb, rgb_to_dc
from usdsplat.formats.filling import Filling

CHUNK = 256
"""Splats that share bounds."""

LOG_SCALE_LIMIT = 20.0
"""Logarithms of scales are kept within +- this, which gives a scale of 0 a logarithm as well."""

_TOPS = np.array([(2047, 1023, 2047), (2047, 1023, 2047), (255, 255, 255)], np.int32)
_SHIFTS = np.array([(21, 11, 0), (21, 11, 0), (24, 16, 8)], np.int32)
"""Of the components of position, scale and colour: highest code, and place in the word."""
_POSITION, _SCALE, _COLOR = range(3)

_ROTATION_TOP = 1023
_ROTATION_SHIFTS = (20, 10, 0)
_ROTATION_END = np.float32(math.sqrt(0.5))
_ROTATION_STEP = np.float32(math.sqrt(2) / _ROTATION_TOP)
"""Of the components that are stored: highest code, places in the word, and what codes mean."""

_TAME = 1e37
"""Between bounds of this size rounding makes nothing infinite."""

_HARMONICS_STEP = 8 / 256
_HARMONICS_END = 4.0

U8 = npt.NDArray[np.uint8]
U32 = npt.NDArray[np.uint32]
Rows = npt.NDArray[np.intp]


def decode_words(filling: Filling, rows: slice, words: tuple[I32, ...], bounds: F32) -> None:
    """Decode and settle all but the harmonics of some splats.

    Args:
        filling: Filled at `rows`.
        rows: Of the splats.
        words: Position, rotation, scale and colour, each of shape (n,); the bits are what counts.
        bounds: Of their chunks, as `decodable` gives them, shape (c, 3, 2, 3).

    Raises:
        FormatError: If a scale is infinite.
    """
    place, turn, size, paint = words
    _lerp(filling.positions[rows], place, _POSITION, bounds)
    scales = filling.scales[rows]
    _lerp(scales, size, _SCALE, bounds)
    _lerp(filling.sh[rows, 0], paint, _COLOR, bounds)
    with np.errstate(over="ignore"):  # settling names what is infinite
        np.exp(scales, out=scales)
    np.multiply(paint & 255, np.float32(1 / 255), out=filling.opacities[rows])
    is_unit = _decode_rotations(filling.rotations[rows], turn)
    # Codes between such bounds are finite, all but what exp makes of them: most need no settling.
    if not is_unit or np.abs(bounds).max() > _TAME or not np.isfinite(scales.max()):
        filling.settle(rows)


def decodable(bounds: F32) -> F32:
    """Bounds as `decode_words` needs them.

    Args:
        bounds: Chunk, attribute (position, logarithm of scale, colour), end, component: finite,
            shape (c, 3, 2, 3).

    Returns:
        The same with the distance of two codes in place of the upper end, and coefficients of
        degree 0 in place of colours.
    """
    out = bounds.astype(np.float64)
    out[:, _COLOR] = rgb_to_dc(out[:, _COLOR])
    out[:, :, 1] -= out[:, :, 0]
    out[:, :, 1] /= _TOPS
    with np.errstate(over="ignore"):  # named when a splat is settled
        return out.astype(np.float32)


def decode_harmonics(out: F32, codes: U8) -> None:
    """Fill `out` with the values of `codes`, both of shape (n, k).

    The outermost codes mean +-4, the others the middle of their interval.
    """
    values = codes.astype(np.float32)
    values *= np.float32(_HARMONICS_STEP)
    np.add(values, np.float32(_HARMONICS_STEP / 2 - _HARMONICS_END), out=out)
    if codes.size and (codes.min() == 0 or codes.max() == 255):
        np.copyto(out, -_HARMONICS_END, where=codes == 0)
        np.copyto(out, _HARMONICS_END, where=codes == 255)


def encode_words(cloud: SplatCloud, rows: Rows) -> tuple[U32, F32]:
    """Code all but the harmonics of some splats of `cloud`.

    Args:
        cloud: Finite; an opacity may be 0 or 1, a scale 0.
        rows: Splats, chunk by chunk; the last chunk may be shorter.

    Returns:
        Position, rotation, scale and colour, shape (n, 4), and bounds in the form that `decodable`
        takes, shape (ceil(n / 256), 3, 2, 3).
    """
    # A last chunk is filled up with its own last splat, which leaves its bounds alone.
    padded = np.concatenate([rows, np.full(-len(rows) % CHUNK, rows[-1])])
    bounds = np.empty((len(padded) // CHUNK, 3, 2, 3), np.float32)
    words = np.empty((len(padded), 4), np.uint32)
    with np.errstate(divide="ignore"):
        sizes = np.log(cloud.scales.take(padded, axis=0))
    sizes.clip(-LOG_SCALE_LIMIT, LOG_SCALE_LIMIT, out=sizes)
    colors = dc_to_rgb(cloud.sh[:, 0][padded])
    alphas = np.rint(cloud.opacities.take(padded).clip(0, 1) * np.float32(255))
    words[:, 0] = _within_bounds(cloud.positions.take(padded, axis=0), _POSITION, bounds)
    words[:, 1] = _encode_rotations(cloud.rotations.take(padded, axis=0))
    words[:, 2] = _within_bounds(sizes, _SCALE, bounds)
    words[:, 3] = _within_bounds(colors, _COLOR, bounds) | alphas.astype(np.uint32)
    return words[: len(rows)], bounds


def encode_harmonics(cloud: SplatCloud, rows: Rows) -> U8:
    """Codes of the coefficients above degree 0 of some splats, channel by channel: shape (n, 3 k).

    Those beyond +-4 are clamped.
    """
    values = cloud.sh.take(rows, axis=0).reshape(len(rows), -1)
    values *= np.float32(1 / _HARMONICS_STEP)
    values += np.float32(_HARMONICS_END / _HARMONICS_STEP)
    codes = values.clip(0, 255, out=values).astype(np.uint8)  # cuts off: codes stand for middles
    above = values.shape[1] // 3 - 1
    out = np.empty((len(rows), 3, above), np.uint8)
    for channel in range(3):
        out[:, channel] = codes[:, 3 + channel :: 3]
    return out.reshape(len(rows), -1)


def _lerp(out: F32, words: I32, attribute: int, bounds: F32) -> None:
    """Fill `out`, shape (n, 3), with what three codes in each word mean within their bounds."""
    count = len(words)
    whole = count // CHUNK
    low, step = bounds[:, attribute].transpose(1, 2, 0)[..., None]  # end, component, chunk
    values = (words >> _SHIFTS[attribute, :, None] & _TOPS[attribute, :, None]).astype(np.float32)
    with np.errstate(over="ignore", invalid="ignore"):  # named when a splat is settled
        chunks = values[:, : whole * CHUNK].reshape(3, whole, CHUNK)  # a view
        chunks *= step[:, :whole]
        chunks += low[:, :whole]
        if rest := count % CHUNK:
            values[:, -rest:] *= step[:, -1]
            values[:, -rest:] += low[:, -1]
    out[:] = values.T


def _decode_rotations(out: F32, words: I32) -> bool:
    """Fill `out`, shape (n, 4), with rotations whose largest component is not stored.

    Returns:
        Whether their length is 1; three components may say that it is more.
    """
    largest = words >> 30 & 3
    first, second, third = (
        (words >> shift & _ROTATION_TOP).astype(np.float32) for shift in _ROTATION_SHIFTS
    )
    for values in (first, second, third):
        values *= _ROTATION_STEP
        values -= _ROTATION_END
    squared = first * first
    squared += second * second
    squared += third * third
    rest = np.sqrt(np.maximum(1 - squared, 0))
    is_first, is_low, is_last = largest == 0, largest < 2, largest == 3
    out[:, 0] = np.where(is_first, rest, first)
    out[:, 1] = np.where(largest == 1, rest, np.where(is_first, first, second))
    out[:, 2] = np.where(largest == 2, rest, np.where(is_low, second, third))
    out[:, 3] = np.where(is_last, rest, third)
    return bool(squared.max() <= 1)


def _encode_rotations(quaternions: F32) -> U32:
    """Words whose upper two bits count the component that is largest in magnitude."""
    w, x, y, z = np.ascontiguousarray(quaternions.T)
    wx, yz = np.abs(x) > np.abs(w), np.abs(z) > np.abs(y)
    front, back = np.where(wx, x, w), np.where(yz, z, y)
    in_back = np.abs(back) > np.abs(front)
    largest = np.where(in_back, yz + np.uint32(2), wx)
    slope = np.where(np.where(in_back, back, front) < 0, -1 / _ROTATION_STEP, 1 / _ROTATION_STEP)
    words = largest << np.uint32(30)
    rest = (
        np.where(largest == 0, x, w),
        np.where(largest < 2, y, x),
        np.where(largest == 3, y, z),
    )
    for shift, values in zip(_ROTATION_SHIFTS, rest, strict=True):
        codes = np.rint(values * slope + np.float32(_ROTATION_TOP / 2))
        words |= codes.clip(0, _ROTATION_TOP).astype(np.uint32) << np.uint32(shift)
    return words


def _within_bounds(values: F32, attribute: int, bounds: F32) -> U32:
    """Fill in the bounds of `values`, shape (n, 3) of whole chunks, and code them in a word."""
    by_chunk = np.ascontiguousarray(values.T).reshape(3, -1, CHUNK)
    lower, upper = by_chunk.min(axis=2), by_chunk.max(axis=2)
    bounds[:, attribute, 0], bounds[:, attribute, 1] = lower.T, upper.T
    low = lower[..., None].astype(np.float64)
    span = upper[..., None] - low
    # A flat chunk has no span: all of it is code 0.
    slope = _TOPS[attribute, :, None, None] / np.where(span > 0, span, np.inf)
    codes = by_chunk - low
    codes *= slope
    words = np.rint(codes, out=codes).astype(np.int32) << _SHIFTS[attribute, :, None, None]
    return (words[0] | words[1] | words[2]).ravel().view(np.uint32)
