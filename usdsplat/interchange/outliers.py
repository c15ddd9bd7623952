"""Splats that float far from all others, by the statistics of how near splats are."""

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
"""Looked at, and allowed, if nothing else is asked for."""

_ROUNDING = 1e-6  # of distances in float32: splats that are all as far apart are all kept


def drop_outliers(
    cloud: SplatCloud,
    *,
    neighbors: int = NEIGHBORS,
    deviations: float = DEVIATIONS,
    device: Device | None = None,
) -> SplatCloud:
    """Drop splats whose nearest neighbours are farther away than is usual here.

    A splat goes if the mean distance to its nearest neighbours is more than `deviations` standard
    deviations above the mean of that number over all splats; or if its centre is not finite. Splats
    that have fewer neighbours are judged by those that there are, and one alone stays.

    Args:
        neighbors: How many, >= 1.
        deviations: How many, >= 0; fewer drop more.
        device: Where to; None for the fastest one here.

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
    # All the same to whoever is near: no more at one place than anybody asks for.
    few = sound.positions[order[ranks <= found]]
    alone = np.ones(len(sound), np.bool_)
    alone[order] = ~_in_crowds(ranks, found)
    _, distances = nearest(
        device or open_device(task="geometry"), few, sound.positions[alone], found + 1
    )
    # The nearest is the point itself, or another at the same place: at distance 0 either way.
    means = np.zeros(len(sound))
    means[alone] = distances.sum(axis=1, dtype=np.float64) / found
    known = means[np.isfinite(means)]
    if len(known) < 2:  # too far apart for float32: nobody can say what is usual
        return sound
    limit = known.mean() + deviations * known.std(ddof=1)
    return edit.take(sound, np.asarray(means <= (1 + _ROUNDING) * limit))


def _in_crowds(ranks: I64, found: int) -> npt.NDArray[np.bool_]:
    """Whether more than `found` are at a splat's place, by how many of them are before each."""
    first = np.flatnonzero(ranks == 0)
    counts = np.diff(first, append=len(ranks))
    return np.repeat(counts > found, counts)
