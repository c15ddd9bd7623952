"""The contribution of a splat at a pixel, with the same bits in every CUDA kernel.

A contribution under 1/255 does not count, so two kernels that round its exponent differently draw
pictures that differ by up to 1/255. NVVM contracts products and sums as it likes, differently in
each kernel; here every operation says how it is rounded.

Positions are relative to the tile, whose grid lies fixed in the display window: a crop sees the
same numbers as the whole picture. Exponents are scaled by 1 / ln 2: the hardware's exponential is
that of 2.
"""

from __future__ import annotations

import math

import numpy as np
from numba import cuda

from usdsplat.kernels.project import LOG_CUTOFF

TO_BITS = np.float32(1 / math.log(2))
"""Scale of a, b, c and ln(opacity) before they are given to these functions."""
LEAST = np.float32(LOG_CUTOFF * TO_BITS)
"""The scaled exponent under which a contribution does not count."""
MOST = np.float32(0.999)
"""The largest contribution of one splat at one pixel."""


@cuda.jit(device=True, inline="always")
def along_row(dx, a, b, log_opacity):
    """What a column of pixels has in common: (rest, slope) of the exponent at offset dx [pixel]."""
    return cuda.fma(a * dx, dx, log_opacity), b * dx


@cuda.jit(device=True, inline="always")
def exponent(dy, c, slope, rest):
    """The scaled exponent at offset dy [pixel] in that column, ln(opacity) included."""
    return cuda.fma(dy, cuda.fma(c, dy, slope), rest)


@cuda.jit(device=True, inline="always")
def contribution(e):
    """Opacity of a splat where its scaled exponent is e, 0 where it does not count."""
    alpha = min(MOST, math.exp2(e))
    return alpha if e >= LEAST else np.float32(0)


@cuda.jit(device=True, inline="always")
def behind(through, alpha):
    """Transmittance behind a contribution."""
    return cuda.fma(-alpha, through, through)
