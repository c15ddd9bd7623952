"""Convert a grade to one matrix, which renderers apply at no cost.

White balance adapts the given light to D65, more precisely to 6504 K on the same locus, by
Bradford's chromatic adaptation. The locus is CIE daylight from 5000 K up and black bodies up to
4000 K, with linear interpolation in CIE 1960 u v between, so that it is continuous.

Source: CIE 15:2004 for daylight; Krystek 1985 for black bodies, an approximation good to 1e-4 in
u v; ANSI C78.377 for Duv; adaptation and primaries as in `color`.
"""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import F64
from usdsplat.core.grade import NEUTRAL_TEMPERATURE, Grade
from usdsplat.images.color import REC709, adaptation, color_space, luminance, to_xyz

WARM, COOL = 4000.0, 5000.0
"""Limits of black bodies (up to the first) and daylight (from the second) [K]."""


def grade_matrix(grade: Grade, space: str) -> tuple[float, ...]:
    """Return the matrix of a grade on linear RGB.

    Args:
        grade: A grade that passes `Grade.check`.
        space: Name of the colour space with the primaries of the RGB; data counts as Rec.709.

    Returns:
        Matrix 3x3, row-major, for column vectors; exactly identity for a neutral grade.

    Raises:
        UsageError: If the space is unknown.
    """
    primaries = color_space(space).chromaticities or REC709
    matrix = np.reshape(np.array(grade.matrix, np.float64), (3, 3))
    if (grade.temperature, grade.tint) != (NEUTRAL_TEMPERATURE, 0.0):
        adapted = adaptation(white_xyz(grade.temperature, grade.tint), white_xyz())
        rgb_to_xyz = to_xyz(primaries)
        matrix = np.linalg.solve(rgb_to_xyz, adapted @ rgb_to_xyz) @ matrix
    matrix = (2.0**grade.exposure * np.array(grade.gain))[:, None] * matrix
    if grade.saturation != 1.0:
        grey = np.tile(luminance(primaries), (3, 1))
        matrix = (grey + grade.saturation * (np.eye(3) - grey)) @ matrix
    return tuple(matrix.ravel().tolist())


def white_xyz(temperature: float = NEUTRAL_TEMPERATURE, tint: float = 0.0) -> F64:
    """Return CIE XYZ of a white light, Y = 1, shape (3,).

    Args:
        temperature: Colour temperature [K], 1000 to 25000.
        tint: Duv, the distance from the locus in CIE 1960 u v; positive is greenish.
    """
    u, v = _locus(temperature)
    if tint:
        before, after = _locus(temperature * 0.999), _locus(temperature * 1.001)
        along = np.array(after) - before
        across = np.array((along[1], -along[0])) / np.hypot(*along)
        u, v = (u, v) + tint * across
    x, y = 3 * u / (2 * u - 8 * v + 4), 2 * v / (2 * u - 8 * v + 4)
    return np.array((x / y, 1.0, (1 - x - y) / y))


def _locus(temperature: float) -> tuple[float, float]:
    """Return CIE 1960 u v of a white light."""
    if temperature <= WARM:
        return _black_body(temperature)
    if temperature >= COOL:
        return _daylight(temperature)
    (u0, v0), (u1, v1) = _black_body(temperature), _daylight(temperature)
    part = (temperature - WARM) / (COOL - WARM)
    return u0 + part * (u1 - u0), v0 + part * (v1 - v0)


def _black_body(t: float) -> tuple[float, float]:
    u = (0.860117757 + 1.54118254e-4 * t + 1.28641212e-7 * t * t) / (
        1 + 8.42420235e-4 * t + 7.08145163e-7 * t * t
    )
    v = (0.317398726 + 4.22806245e-5 * t + 4.20481691e-8 * t * t) / (
        1 - 2.89741816e-5 * t + 1.61456053e-7 * t * t
    )
    return u, v


def _daylight(t: float) -> tuple[float, float]:
    if t <= 7000.0:
        x = 0.244063 + 0.09911e3 / t + 2.9678e6 / t**2 - 4.6070e9 / t**3
    else:
        x = 0.237040 + 0.24748e3 / t + 1.9018e6 / t**2 - 2.0064e9 / t**3
    y = -3.0 * x * x + 2.870 * x - 0.275
    return 4 * x / (-2 * x + 12 * y + 3), 6 * y / (-2 * x + 12 * y + 3)
