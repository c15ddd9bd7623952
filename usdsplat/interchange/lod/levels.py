"""Make the proxies of a node from the splats of its children, and find strays.

The low-pass of a classic picture is baked into splats of the capture before they are merged: at the
size of a given pixel, 0.3 pixels² are added to each covariance, and opacities are kept. A picture
of the merged splats, antialiased, then resembles the mean of what a classic picture shows.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.core.extent import REACH
from usdsplat.interchange.decimating import LOW_PASS
from usdsplat.interchange.outliers import weighted_median

KEPT = 4
"""Number of splats below a node for each of its proxies."""
STRAY = 0.5
"""Radius, relative to the size of a node, above which a splat is a stray."""
FEW = 16
"""At most one of so many splats of a node is a stray."""

_LARGEST = float(np.finfo(np.float32).max)
_MIDDLE = 0.05
"""Part of the centres at either end of an axis that do not count for the size of a node."""


def baked(cloud: SplatCloud, pixel: float) -> SplatCloud:
    """Return splats with the low-pass of a classic picture, whose pixels have the size `pixel`
    [unit]; 0 changes nothing."""
    if not pixel:
        return cloud
    scales = np.hypot(cloud.scales, math.sqrt(LOW_PASS) * pixel)
    return replace(cloud, scales=np.minimum(scales, _LARGEST).astype(np.float32))


def proxy_count(splats: int, most: int) -> int:
    """Return the number of proxies for a number of splats: a quarter, but at least 1 and at most
    `most`."""
    return max(1, min(most, -(-splats // KEPT)))


def node_size(positions: F32) -> float:
    """Return the longest edge of the box around the middle nine tenths of the centres of a node,
    along each axis [unit]; 0 without centres."""
    count = len(positions)
    if not count:
        return 0.0
    ends = int(_MIDDLE * (count - 1)), count - 1 - int(_MIDDLE * (count - 1))
    middle = np.partition(positions, ends, axis=0)
    return float((middle[ends[1]].astype(np.float64) - middle[ends[0]]).max())


def strays(cloud: SplatCloud, size: float, *, most: int | None = None) -> npt.NDArray[np.bool_]:
    """Return which splats are too large for a node: their radius is above a part of its size.

    Args:
        cloud: The splats.
        size: Result of `node_size` [unit].
        most: Largest number; the largest splats are taken. None for no limit.
    """
    largest = cloud.scales.max(axis=1, initial=0.0)
    found = largest > np.float32(STRAY * size / REACH)
    if most is not None and np.count_nonzero(found) > most:
        found = np.zeros(len(cloud), np.bool_)
        found[np.argsort(-largest, kind="stable")[:most]] = True
    return found


def typical_size(cloud: SplatCloud) -> float:
    """Return the typical size of splats [unit]: the median, by opacity times area, of the geometric
    mean of the two larger standard deviations; 0 for an invisible cloud."""
    scales = np.sort(cloud.scales.astype(np.float64), axis=1)
    area = scales[:, 1] * scales[:, 2]
    weights = area * cloud.opacities
    return weighted_median(np.sqrt(area), weights) if weights.sum() > 0 else 0.0
