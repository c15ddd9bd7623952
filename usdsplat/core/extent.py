"""Compute the bounding box of splats at the distance at which they stop contributing."""

from __future__ import annotations

import math

import numpy as np

from usdsplat.core.cloud import F32, F64, SplatCloud

REACH = math.sqrt(2 * math.log(255))
"""Distance from the centre, in standard deviations, at which an opaque splat reaches 1/255:
3.33."""

_CHUNK = 1 << 14  # splats per block: temporaries stay in the cache
_ROUNDING = 1e-5  # relative; ten times the float32 rounding error below


def extent(cloud: SplatCloud, *, slack: float = 0.0) -> F64 | None:
    """Return a conservative bounding box of all ellipsoids of REACH standard deviations.

    The half-width of an ellipsoid along an axis is the root of the covariance's diagonal element.

    Args:
        cloud: The splats; those whose values, or their squares, are not finite are ignored.
            Rotations need not be normalised.
        slack: Error of a storage form, relative to each splat's largest scale; the box then also
            holds the splats decoded from it.

    Returns:
        Lower and upper corner [scene unit], shape (2, 3); None without any finite splat.
    """
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for first in range(0, len(cloud), _CHUNK):
        rows = slice(first, first + _CHUNK)
        centres = np.array(cloud.positions[rows].T, np.float64, order="C")
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            size = deviations(cloud.scales[rows], cloud.rotations[rows], slack + _ROUNDING)
            low = np.minimum(low, _finite_min(centres - REACH * size))
            high = np.maximum(high, -_finite_min(-centres - REACH * size))
    return np.stack([low, high]) if np.isfinite(low).all() else None


def deviations(scales: F32, rotations: F32, slack: float = 0.0) -> F32:
    """Return standard deviations along x, y and z, widened by `slack` times the largest scale,
    shape (3, m)."""
    size = np.abs(scales.T, order="C")
    w, x, y, z = np.ascontiguousarray(rotations.T)
    two = np.nan_to_num(
        2 / (w * w + x * x + y * y + z * z), posinf=0.0
    )  # a zero quaternion is the identity
    matrix = (
        (1 - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)),
        (two * (x * y + w * z), 1 - two * (x * x + z * z), two * (y * z - w * x)),
        (two * (x * z - w * y), two * (y * z + w * x), 1 - two * (x * x + y * y)),
    )
    variances = [sum(np.square(m * s) for m, s in zip(r, size, strict=True)) for r in matrix]
    return np.sqrt(variances) + np.float32(slack) * size.max(axis=0)


def _finite_min(corners: F64) -> F64:
    """Return the smallest value in each row of (3, m), ignoring columns that are not finite."""
    lowest: F64 = corners.min(axis=1)
    if np.isfinite(lowest).all():  # min propagates NaN and -inf
        return lowest
    finite = np.isfinite(corners).all(axis=0)
    return np.min(corners[:, finite], axis=1, initial=np.inf)
