"""Convert between colour spaces: decode a transfer function, apply a matrix, encode another one.

A conversion is 13 float32 numbers: source gamma, source linear bias, the 3x3 matrix from
source-linear to target-linear in row order, target gamma, target linear bias. The curve of gamma g
and bias b is `((1 + b) x^(1/g) − b)`, with the straight line through zero that meets it smoothly; b
= 0.055, g = 2.4 is sRGB's curve, g = 1 is no curve. A power without a bias leaves negative values
as they are.

Source: OpenUSD's `Gf.ColorSpace`, whose parameters these are; IEC 61966-2-1 for sRGB.
"""

from __future__ import annotations

import math

import numpy as np

from .jit import scalar


@scalar
def straight(gamma, bias):
    """Return the end of the linear segment [encoded], and the factor to linear light within it."""
    one = np.float32(1)
    slope = (gamma / (one + bias)) ** gamma * (bias / (gamma - one)) ** (gamma - one)
    return bias / (gamma - one), slope


@scalar
def decode(x, gamma, bias):
    """Convert an encoded value to linear light."""
    one = np.float32(1)
    if gamma == one:
        return x
    if bias > np.float32(0):
        knee, slope = straight(gamma, bias)
        if x < knee:
            return x * slope
    elif x <= np.float32(0):
        return x
    return np.float32(math.pow((x + bias) / (one + bias), gamma))


@scalar
def encode(x, gamma, bias):
    """Convert linear light to an encoded value."""
    one = np.float32(1)
    if gamma == one:
        return x
    if bias > np.float32(0):
        knee, slope = straight(gamma, bias)
        if x < knee * slope:
            return x / slope
    elif x <= np.float32(0):
        return x
    return np.float32((one + bias) * math.pow(x, one / gamma) - bias)


@scalar
def convert(r, g, b, c):
    """Convert one colour by conversion `c`."""
    r, g, b = decode(r, c[0], c[1]), decode(g, c[0], c[1]), decode(b, c[0], c[1])
    x = c[2] * r + c[3] * g + c[4] * b
    y = c[5] * r + c[6] * g + c[7] * b
    z = c[8] * r + c[9] * g + c[10] * b
    return encode(x, c[11], c[12]), encode(y, c[11], c[12]), encode(z, c[11], c[12])
