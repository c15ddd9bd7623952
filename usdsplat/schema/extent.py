"""The box that a field claims on a stage: it holds every splat as far as it contributes."""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.core.extent import extent


def compute_extent(cloud: SplatCloud, *, slack: float = 0.0) -> F32:
    """`core.extent.extent` as USD stores it, rounded outwards.

    Args:
        cloud: Splats whose numbers are not finite are left out.
        slack: Error of the stored form, relative to each splat's largest scale.

    Returns:
        Lower and upper corner [scene unit], shape (2, 3); without splats two zero corners.
    """
    box = extent(cloud, slack=slack)
    if box is None:
        return np.zeros((2, 3), np.float32)
    return np.stack([_outwards(box[0], -np.inf), _outwards(box[1], np.inf)])


def _outwards(corner: F64, away: float) -> F32:
    """Nearest float32 that is not on the inner side."""
    rounded = corner.astype(np.float32)
    past = rounded > corner if away < 0 else rounded < corner
    return np.where(past, np.nextafter(rounded, np.float32(away)), rounded).astype(np.float32)
