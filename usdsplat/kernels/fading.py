"""Fade splats of a node of a splat tree against those that replace it.

A faded splat and a fading one are blended with each other, so their optical depths must add up to
one of the whole: with plain products of opacity and weight, two halves of 0.999 would cover only
three quarters. The sum over the splat, the integral of −ln(1 − α) over its Gaussian, is 2πσ² times
the dilogarithm of its opacity. The faded opacity has `weight` times that sum. For small opacities
this is the plain product.

Both directions, from a depth to its sum and back, are polynomials of a variable in which they are
smooth: σ = −ln(1 − Li2 / (π²/6)), which is nearly the depth for large ones. They were fitted to
Chebyshev nodes, for depths up to that of MOST.

Source: Zagier 2007, "The Dilogarithm Function".
"""

from __future__ import annotations

import math

from .jit import scalar

MOST = 0.999
"""Largest contribution of one splat at one pixel: larger opacities count as this one."""
WHOLE = 1 << 16
"""Weights are multiples of 1 / WHOLE, so that all paths of a device draw the same splats."""


@scalar
def tallied(depth):
    """Return the sum σ that stands for an optical depth, with an error of at most 1e-7.

    Args:
        depth: Optical depth, 0 to 6.91, float64.
    """
    rest = 5.251317399800775e-06 + depth * (
        -8.173621262541837e-07 + depth * (5.3650451958793805e-08 - depth * 1.3836444240627135e-09)
    )
    rest = -0.00020106170417639045 + depth * (3.0768651621115417e-06 + depth * rest)
    return depth * (
        0.6079270701894315
        + depth * (0.03280672576610911 + depth * (-0.0006188921150319566 + depth * rest))
    )


@scalar
def depth_of(tally):
    """Return the optical depth that a sum σ stands for, with an error of at most 1e-7.

    Args:
        tally: σ, the result of `tallied` or a sum of such, 0 to 5.34, float64.
    """
    rest = -8.01612156509873e-05 + tally * (
        6.243037059633652e-06 + tally * (-3.0386559895602285e-07 + tally * 6.779911826422816e-09)
    )
    rest = -0.005272158600090422 + tally * (0.0007384054951088037 + tally * rest)
    return tally * (
        1.6449340964350658
        + tally * (-0.14601602429689928 + tally * (0.030433503138610735 + tally * rest))
    )


@scalar
def faded(opacity, weight):
    """Return the opacity [0..1] of a splat that is drawn with a weight in ]0, 1[, float64."""
    whole = -math.log(1.0 - min(float(opacity), MOST))
    if not (whole > 0.0):
        return 0.0
    # in float64, the differences are accurate enough without expm1 and log1p, which take twice as
    # long
    depth = depth_of(-math.log(1.0 - weight * (1.0 - math.exp(-tallied(whole)))))
    return 1.0 - math.exp(-depth)
