"""Compute the contribution of a splat at a pixel, with the same bits in every CUDA kernel.

A contribution under 1/255 is cut off, so two kernels that round its exponent differently draw
pictures that differ by up to 1/255. NVVM contracts products and sums differently in each kernel.
Here every operation states its rounding.

Positions are relative to the tile, whose grid is fixed in the display window, so a crop gets the
same numbers as the whole picture. Exponents are scaled by 1 / ln 2, because the hardware's
exponential has base 2.
"""

from __future__ import annotations

import math

import numpy as np
from numba import cuda

from usdsplat.kernels.project import LOG_CUTOFF

TO_BITS = np.float32(1 / math.log(2))
"""Scale of a, b, c and ln(opacity) in the arguments of these functions."""
LEAST = np.float32(LOG_CUTOFF * TO_BITS)
"""Scaled exponent below which a contribution is cut off."""
MOST = np.float32(0.999)
"""Largest contribution of one splat at one pixel."""


@cuda.jit(device=True, inline="always")
def along_row(dx, a, b, log_opacity):
    """Return the part of the exponent that a column of pixels shares: (rest, slope) at offset dx
    [pixel]."""
    return cuda.fma(a * dx, dx, log_opacity), b * dx


@cuda.jit(device=True, inline="always")
def exponent(dy, c, slope, rest):
    """Return the scaled exponent at offset dy [pixel] in that column, with ln(opacity) included."""
    return cuda.fma(dy, cuda.fma(c, dy, slope), rest)


@cuda.jit(device=True, inline="always")
def contribution(e):
    """Return the contribution of a splat for the scaled exponent e, 0 below the cutoff."""
    alpha = min(MOST, math.exp2(e))
    return alpha if e >= LEAST else np.float32(0)


@cuda.jit(device=True, inline="always")
def behind(through, alpha):
    """Return the transmittance behind a contribution."""
    return cuda.fma(-alpha, through, through)
