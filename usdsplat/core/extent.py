"""The box around splats: it holds every one of them as far as it contributes."""

from __future__ import annotations

import math

import numpy as np

from usdsplat.core.cloud import F32, F64, SplatCloud

REACH = math.sqrt(2 * math.log(255))
"""Standard deviations from the centre at which an opaque splat falls below 1/255: 3.33."""

_CHUNK = 1 << 14  # splats at a time: temporaries stay in the cache
_ROUNDING = 1e-5  # relative; ten times what float32 loses below


def extent(cloud: SplatCloud, *, slack: float = 0.0) -> F64 | None:
    """Box around all ellipsoids of REACH standard deviations, a hair too large rather than small.

    An ellipsoid reaches as far along an axis as the root of the covariance's diagonal element says.

    Args:
        cloud: Splats whose numbers, or squares of them, are not finite are left out; rotations need
            not be normalised.
        slack: Error of a stored form, relative to each splat's largest scale; the box is wide
            enough for whatever that form decodes to.

    Returns:
        Lower and upper corner [scene unit], shape (2, 3); None where no splat is left.
    """
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for first in range(0, len(cloud), _CHUNK):
        rows = slice(first, first + _CHUNK)
        centres = np.array(cloud.positions[rows].T, np.float64, order="C")
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            size = _deviations(cloud.scales[rows], cloud.rotations[rows], slack + _ROUNDING)
            low = np.minimum(low, _finite_min(centres - REACH * size))
            high = np.maximum(high, -_finite_min(-centres - REACH * size))
    return np.stack([low, high]) if np.isfinite(low).all() else None


def _deviations(scales: F32, rotations: F32, slack: float) -> F32:
    """Standard deviations along x, y and z, widened, shape (3, m)."""
    size = np.abs(scales.T, order="C")
    w, x, y, z = np.ascontiguousarray(rotations.T)
    two = np.nan_to_num(2 / (w * w + x * x + y * y + z * z), posinf=0.0)  # zero: no rotation
    matrix = (
        (1 - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)),
        (two * (x * y + w * z), 1 - two * (x * x + z * z), two * (y * z - w * x)),
        (two * (x * z - w * y), two * (y * z + w * x), 1 - two * (x * x + y * y)),
    )
    variances = [sum(np.square(m * s) for m, s in zip(r, size, strict=True)) for r in matrix]
    return np.sqrt(variances) + np.float32(slack) * size.max(axis=0)


def _finite_min(corners: F64) -> F64:
    """Smallest value in each row of (3, m), columns that are not finite left out."""
    lowest: F64 = corners.min(axis=1)
    if np.isfinite(lowest).all():  # NaN and -inf come through min
        return lowest
    finite = np.isfinite(corners).all(axis=0)
    return np.min(corners[:, finite], axis=1, initial=np.inf)
