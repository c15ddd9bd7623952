"""Convert between RGB colour spaces, which have their Gf names.

The coefficients of a capture are in the colour space it was trained in; a picture may be in
another. Splats in kernels and pixels in files need the same three steps: invert the source's
transfer curve, multiply by a matrix, apply the target's curve. `conversion` packs them in an array
of thirteen numbers for kernels.

A transfer curve has a `gamma` g and a `linear_bias` a, as in USD's `GfColorSpace`: an encoded t is
linear `((t + a) / (1 + a)) ** g` at and above `a / (g - 1)`, and below that on the straight line
through 0 that meets the power function there. The line also applies to negative values. Without a
bias its slope is 1, so a pure power function leaves negative values unchanged. Values above 1 are
not clamped.

Source: OpenUSD's `GfColorSpace` documentation; primaries from ITU-R BT.709 and BT.2020, SMPTE
EG 432-1, Adobe RGB (1998), SMPTE ST 2065-1 and S-2014-004; adaptation to D65 by Bradford, 1985.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, F64
from usdsplat.core.errors import UsageError
from usdsplat.core.grade import UNIT

Chromaticities = tuple[float, float, float, float, float, float, float, float]
"""CIE 1931 x y of red, green, blue and white."""

D65 = (0.3127, 0.3290)
ACES_WHITE = (0.32168, 0.33767)

REC709: Chromaticities = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, *D65)
REC2020: Chromaticities = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, *D65)
P3D65: Chromaticities = (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, *D65)
ADOBE: Chromaticities = (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, *D65)
AP0: Chromaticities = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, *ACES_WHITE)
AP1: Chromaticities = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, *ACES_WHITE)

BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)

SRGB = (2.4, 0.055)


@dataclass(frozen=True, slots=True)
class ColorSpace:
    """An RGB colour space; `chromaticities` is None for data, which is never converted."""

    chromaticities: Chromaticities | None
    gamma: float = 1.0
    linear_bias: float = 0.0


COLOR_SPACES: dict[str, ColorSpace] = {
    "lin_rec709_scene": ColorSpace(REC709),
    "srgb_rec709_scene": ColorSpace(REC709, *SRGB),
    "g18_rec709_scene": ColorSpace(REC709, 1.8),
    "g22_rec709_scene": ColorSpace(REC709, 2.2),
    "g24_rec709_scene": ColorSpace(REC709, 2.4),
    "lin_ap1_scene": ColorSpace(AP1),
    "srgb_ap1_scene": ColorSpace(AP1, *SRGB),
    "g22_ap1_scene": ColorSpace(AP1, 2.2),
    "lin_ap0_scene": ColorSpace(AP0),
    "lin_p3d65_scene": ColorSpace(P3D65),
    "srgb_p3d65_scene": ColorSpace(P3D65, *SRGB),
    "lin_rec2020_scene": ColorSpace(REC2020),
    "lin_adobergb_scene": ColorSpace(ADOBE),
    "g22_adobergb_scene": ColorSpace(ADOBE, 563 / 256),
    "raw": ColorSpace(None),
    "data": ColorSpace(None),
    "identity": ColorSpace(None),
    "unknown": ColorSpace(None),
    # Written by other tools and unknown to Gf: the same numbers, display-referred.
    "srgb_rec709_display": ColorSpace(REC709, *SRGB),
}
"""Known colour spaces by their `ColorSpaceAPI` token."""


def color_space(name: str, *, where: str = "color space") -> ColorSpace:
    """Return the space called `name`; `where` names the option or prim in error messages.

    Raises:
        UsageError: If the name is unknown; the message lists the known ones.
    """
    if name not in COLOR_SPACES:
        raise UsageError(where, repr(name), f"one of {', '.join(COLOR_SPACES)}")
    return COLOR_SPACES[name]


def conversion(source: str, target: str, *, grade: tuple[float, ...] = UNIT) -> F32:
    """Return the parameters with which kernels convert colours from one space to another.

    Args:
        source: Name of the space of the colours.
        target: Name of the space of the result.
        grade: 3x3 matrix applied to source-linear RGB, row-major, for column vectors.

    Returns:
        Shape (13,), float32: source gamma, source linear bias, the matrix from source-linear to
        target-linear RGB (row-major, 9 values), target gamma, target linear bias. The result is
        neutral (`is_identity`) if nothing changes; without a grade also if either space is data.

    Raises:
        UsageError: If either name is unknown.
    """
    numbers = _numbers(source, target)
    if tuple(grade) == UNIT:
        return np.array(numbers, np.float32)
    if numbers == _NEUTRAL:  # a grade needs linear colour: decode and encode again
        curve = COLOR_SPACES[source]
        numbers = (curve.gamma, curve.linear_bias, *UNIT, curve.gamma, curve.linear_bias)
    matrix = np.reshape(numbers[2:11], (3, 3)) @ np.reshape(grade, (3, 3))
    return np.array((*numbers[:2], *matrix.ravel(), *numbers[11:]), np.float32)


def conversion_curve(name: str) -> F32:
    """Return gamma and linear bias of a space's transfer curve, shape (2,); (1, 0) for data.

    Raises:
        UsageError: If the name is unknown.
    """
    space = color_space(name)
    return np.array([space.gamma, space.linear_bias], np.float32)


def is_identity(numbers: npt.NDArray[np.floating]) -> bool:
    """Return whether a `conversion` changes nothing, so that callers can skip it."""
    return bool(np.array_equal(numbers, np.array(_NEUTRAL, np.float32)))


def convert(rgb: npt.ArrayLike, source: str, target: str) -> F64:
    """Convert colours in float64: the reference for the kernels, and for small tasks.

    Args:
        rgb: Straight (not premultiplied) colours, shape (..., 3); negative values and those above 1
            are legal.
        source: Name of the space of `rgb`.
        target: Name of the space of the result.

    Returns:
        Converted colours, shape (..., 3), float64.

    Raises:
        UsageError: If either name is unknown.
    """
    numbers = _numbers(source, target)
    linear = _decode(np.asarray(rgb, np.float64), numbers[0], numbers[1])
    return _encode(linear @ np.reshape(numbers[2:11], (3, 3)).T, numbers[11], numbers[12])


def decode(rgb: npt.ArrayLike, space: str) -> F64:
    """Return linear colours of encoded ones, with the primaries of the space.

    Args:
        rgb: Straight colours, any shape; negative values and those above 1 are legal.
        space: Name of the space.

    Raises:
        UsageError: If the name is unknown.
    """
    found = color_space(space)
    return _decode(np.asarray(rgb, np.float64), found.gamma, found.linear_bias)


def encode(rgb: npt.ArrayLike, space: str) -> F64:
    """Invert `decode`."""
    found = color_space(space)
    return _encode(np.asarray(rgb, np.float64), found.gamma, found.linear_bias)


def light_matrices(space: str) -> F64:
    """Return the matrices from linear RGB of a space to linear Rec.709, in which lights are, and
    back, shape (2, 3, 3); none, (0, 3, 3), if the primaries are the same or the space is data.

    Raises:
        UsageError: If the name is unknown.
    """
    own = color_space(space).chromaticities
    if own is None or own == REC709:
        return np.empty((0, 3, 3))
    return np.stack([_matrix(own, REC709), _matrix(REC709, own)])


def decode_light(rgb: npt.ArrayLike, space: str) -> F64:
    """Return linear Rec.709 colours of encoded ones, shape (..., 3); of data as `decode`."""
    linear = decode(rgb, space)
    for to_light in light_matrices(space)[:1]:
        linear = linear @ to_light.T
    return linear


def encode_light(light: npt.ArrayLike, space: str) -> F64:
    """Invert `decode_light`."""
    linear = np.asarray(light, np.float64)
    for from_light in light_matrices(space)[1:]:
        linear = linear @ from_light.T
    return encode(linear, space)


def to_xyz(chromaticities: Chromaticities) -> F64:
    """Return the matrix from linear RGB to CIE XYZ under D65, column vectors, shape (3, 3)."""
    d65 = np.array([D65[0], D65[1], 1 - sum(D65)]) / D65[1]
    matrix = _own_xyz(chromaticities)
    return adaptation(matrix.sum(axis=1), d65) @ matrix


def luminance(chromaticities: Chromaticities) -> F64:
    """Return the weights of linear red, green and blue in the luminance, shape (3,), sum 1."""
    return _own_xyz(chromaticities)[1]


def adaptation(source: F64, target: F64) -> F64:
    """Return the Bradford adaptation of CIE XYZ from white `source` to `target`, (3, 3)."""
    ratio = (BRADFORD @ target) / (BRADFORD @ source)
    return np.linalg.inv(BRADFORD) @ (ratio[:, None] * BRADFORD)


_NEUTRAL = (1.0, 0.0, *UNIT, 1.0, 0.0)


def _numbers(source: str, target: str) -> tuple[float, ...]:
    """Return `conversion` before it is rounded to float32."""
    one, two = color_space(source), color_space(target)
    if one == two or one.chromaticities is None or two.chromaticities is None:
        return _NEUTRAL
    matrix = _matrix(one.chromaticities, two.chromaticities).ravel().tolist()
    return (one.gamma, one.linear_bias, *matrix, two.gamma, two.linear_bias)


def _matrix(source: Chromaticities, target: Chromaticities) -> F64:
    """Return the matrix between linear RGB spaces, (3, 3); exactly identity within one gamut."""
    if source == target:
        return np.eye(3)
    return np.linalg.inv(to_xyz(target)) @ to_xyz(source)


def _own_xyz(chromaticities: Chromaticities) -> F64:
    """Return the matrix from linear RGB to CIE XYZ under the space's own white, shape (3, 3)."""
    xy: F64 = np.array(chromaticities).reshape(4, 2)
    columns = np.stack([xy[:, 0], xy[:, 1], 1 - xy.sum(axis=1)])
    red_green_blue, white = columns[:, :3], columns[:, 3] / xy[3, 1]
    own: F64 = red_green_blue * np.linalg.solve(red_green_blue, white)
    return own


def _line(gamma: float, bias: float) -> tuple[float, float]:
    """Return the end of a curve's straight part (encoded), and its slope encoded / linear."""
    if bias == 0.0:
        return 0.0, 1.0
    end = bias / (gamma - 1.0)
    return end, end / ((end + bias) / (1.0 + bias)) ** gamma


def _decode(encoded: F64, gamma: float, bias: float) -> F64:
    """Invert a transfer curve."""
    if gamma == 1.0:
        return encoded
    end, slope = _line(gamma, bias)
    curve = ((np.maximum(encoded, end) + bias) / (1.0 + bias)) ** gamma
    return np.where(encoded < end, encoded / slope, curve)


def _encode(linear: F64, gamma: float, bias: float) -> F64:
    """Apply a transfer curve."""
    if gamma == 1.0:
        return linear
    end, slope = _line(gamma, bias)
    curve = np.maximum(linear, end / slope) ** (1.0 / gamma) * (1.0 + bias) - bias
    return np.where(linear < end / slope, linear * slope, curve)
