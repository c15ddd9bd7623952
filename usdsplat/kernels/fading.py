"""Fade splats of a node of a splat tree against those that replace it.

A faded splat and a fading one are blended with each other, so their optical depths must add up to
one of the whole: with plain products of opacity and weight, two halves of 0.999 would cover only
three quarters. The sum over the splat, the integral of −ln(1 − α) over its Gaussian, is 2πσ² times
the dilogarithm of its opacity. The faded opacity has `weight` times that sum. For small opacities
this is the plain product.

Source: Zagier 2007, "The Dilogarithm Function", for the series and the reflection.
"""

from __future__ import annotations

import math

from .jit import scalar

MOST = 0.999
"""Largest contribution of one splat at one pixel: larger opacities count as this one."""
WHOLE = 1 << 16
"""Weights are multiples of 1 / WHOLE, so that all paths of a device draw the same splats."""
STEPS = 8
"""Newton steps. The result is within 1e-7 for any opacity and weight."""


@scalar
def dilogarithm(depth):
    """Return Li2(1 − exp(−depth)) for depth >= 0, float64, to 1e-9."""
    if depth > 0.6931471805599453:
        # reflection: Li2(x) + Li2(1 − x) = π²/6 − ln(x) ln(1 − x)
        passed = -math.log(1.0 - math.exp(-depth))
        return 1.6449340668482264 - passed * depth - _series(passed)
    return _series(depth)


@scalar
def _series(depth):
    """Return Li2(1 − exp(−depth)) for small depths, by Bernoulli numbers."""
    square = depth * depth
    rest = 1.0 / 211680.0 - square * (1.0 / 10886400.0 - square / 526901760.0)
    rest = 1.0 / 36.0 - square * (1.0 / 3600.0 - square * rest)
    return depth * (1.0 - 0.25 * depth + square * rest)


@scalar
def faded(opacity, weight):
    """Return the opacity [0..1] of a splat that is drawn with a weight in ]0, 1[, float64."""
    whole = -math.log(1.0 - min(float(opacity), MOST))
    if not (whole > 0.0):
        return 0.0
    wanted = weight * dilogarithm(whole)
    # Li2 is concave in the depth and at most the depth: the root is between these
    least, most = wanted, weight * whole
    depth = most
    for _ in range(STEPS):
        slope = depth / math.expm1(depth)
        depth = min(most, max(least, depth + (wanted - dilogarithm(depth)) / slope))
    return 1.0 - math.exp(-depth)
