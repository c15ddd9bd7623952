"""Compute the extent of a field: a box that contains every splat out to its reach."""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.core.extent import extent


def compute_extent(cloud: SplatCloud, *, slack: float = 0.0) -> F32:
    """Return `core.extent.extent` as float32, rounded outwards.

    Args:
        cloud: The splats; those with a number that is not finite are ignored.
        slack: Error of the storage form, relative to each splat's largest scale.

    Returns:
        Lower and upper corner [scene unit], shape (2, 3); both zero without splats.
    """
    box = extent(cloud, slack=slack)
    if box is None:
        return np.zeros((2, 3), np.float32)
    return np.stack([_outwards(box[0], -np.inf), _outwards(box[1], np.inf)])


def _outwards(corner: F64, away: float) -> F32:
    """Return the nearest float32 that is not on the inner side of the corner."""
    rounded = corner.astype(np.float32)
    past = rounded > corner if away < 0 else rounded < corner
    return np.where(past, np.nextafter(rounded, np.float32(away)), rounded).astype(np.float32)
