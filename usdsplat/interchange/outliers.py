"""Drop outliers: splats that are far from all others, by the statistics of distances."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from usdsplat.core import edit
from usdsplat.core.cloud import I64, SplatCloud
from usdsplat.core.errors import UsageError
from usdsplat.kernels.device import Device
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.points.coincident import coincident
from usdsplat.kernels.points.nearest import nearest

NEIGHBORS, DEVIATIONS = 20, 2.0
"""Default number of neighbours, and of standard deviations."""

_ROUNDING = 1e-6  # of float32 distances, so that equally spaced splats are all kept


def drop_outliers(
    cloud: SplatCloud,
    *,
    neighbors: int = NEIGHBORS,
    deviations: float = DEVIATIONS,
    device: Device | None = None,
) -> SplatCloud:
    """Drop splats whose nearest neighbours are unusually far away.

    A splat is dropped if the mean distance to its nearest neighbours is more than `deviations`
    standard deviations above the mean of this distance over all splats, or if its centre is not
    finite. With fewer other splats than `neighbors`, all others are used; a single splat is kept.

    Args:
        neighbors: Number of nearest neighbours, >= 1.
        deviations: Number of standard deviations, >= 0; fewer drop more splats.
        device: Device; None for the fastest one.

    Raises:
        UsageError: If a number is out of range.

    Source:
        Rusu et al. 2008, "Towards 3D point cloud based object maps for household environments",
        4.1; PCL's `StatisticalOutlierRemoval` does the same.
    """
    if neighbors < 1:
        raise UsageError("neighbors of the outliers", str(neighbors), "1 or more")
    if not deviations >= 0:
        raise UsageError("deviations of the outliers", str(deviations), "0 or more")
    sound = edit.take(cloud, np.asarray(np.isfinite(cloud.positions).all(axis=1)))
    found = min(neighbors, len(sound) - 1)
    if found < 1:
        return sound
    order, ranks = coincident(sound.positions)
    # At one position, no more splats than neighbours are needed for exact results.
    few = sound.positions[order[ranks <= found]]
    alone = np.ones(len(sound), np.bool_)
    alone[order] = ~_in_crowds(ranks, found)
    _, distances = nearest(
        device or open_device(task="geometry"), few, sound.positions[alone], found + 1
    )
    # The nearest is the point itself or one at the same position: distance 0 either way.
    means = np.zeros(len(sound))
    means[alone] = distances.sum(axis=1, dtype=np.float64) / found
    known = means[np.isfinite(means)]
    if len(known) < 2:  # distances overflow float32: there are no statistics
        return sound
    limit = known.mean() + deviations * known.std(ddof=1)
    return edit.take(sound, np.asarray(means <= (1 + _ROUNDING) * limit))


def _in_crowds(ranks: I64, found: int) -> npt.NDArray[np.bool_]:
    """Return whether more than `found` splats share a position, from their ranks there."""
    first = np.flatnonzero(ranks == 0)
    counts = np.diff(first, append=len(ranks))
    return np.repeat(counts > found, counts)


def weighted_median(values: npt.NDArray[np.floating], weights: npt.NDArray[np.number]) -> float:
    """Return the value at which half of the weight is reached; at least one weight is above 0."""
    order = np.argsort(values, kind="stable")
    share = np.cumsum(weights[order], dtype=np.float64)
    return float(values[order][np.searchsorted(share, 0.5 * share[-1])])
