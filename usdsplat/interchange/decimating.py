"""Fewer splats that look like all of them: neighbours merge, the least noticed pairs first.

What a pair costs and what becomes of it is said in `kernels.thinning.pairs`. Each round looks for
every splat's cheapest pair among its nearest neighbours, and merges the cheapest of these.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from usdsplat.core import covariance, edit, morton
from usdsplat.core.cloud import F32, F64, I32, SplatCloud
from usdsplat.core.errors import UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.kernels.device import Device
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.points.coincident import coincident
from usdsplat.kernels.points.nearest import nearest
from usdsplat.kernels.thinning import pairs as kernels

NEIGHBORS = 8
"""Of which a splat's partner is one."""
FAINTEST = 1 / 255
"""Opacity below which renderers leave a splat out."""
ROUND = 0.25
"""Part of the splats that a round takes away at most: the rest waits for better partners."""
CROWD = 64
"""Splats at one place that are too many to search among: they merge before all others."""
STALLED = 0.02
"""Part of the splats below which a round that wanted more has got stuck: too many have the same
neighbours."""
BY_COLOR, BY_OPACITY = 1.6, 1.0
"""What squared differences of harmonics and of opacity are worth, beside those of shape [nat]."""

_LABEL = "merging splats"
_CHUNK = 1 << 13  # covariances factored at a time: their temporaries stay in the cache
_TRIANGLE = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # columns of (xx, xy, xz, yy, yz, zz)


def decimate(
    cloud: SplatCloud,
    count: int,
    *,
    progress: Progress = silent,
    device: Device | None = None,
) -> SplatCloud:
    """Merge neighbours until `count` splats are left.

    A merged splat has the place, spread, harmonics and velocity of both, weighted by opacity times
    area, is so opaque that this product is kept, and has the id and the place in the order of the
    heavier. Splats that were merged with none are those that they were. A cloud that has no more
    than `count` is returned as it is; from any other those with a number that is not finite go
    first, all of them, so that there may be fewer than `count`, and then those that are too faint
    for any picture.

    Args:
        cloud: Of any degree.
        count: Splats wanted, >= 1.
        progress: Told how many are gone after each round.
        device: Where to; None for the fastest one here.

    Raises:
        UsageError: If `count` is less than 1.
    """
    if count < 1:
        raise UsageError("decimation", f"{count} splats", "1 or more")
    if len(cloud) <= count:
        return cloud
    cloud = _shown(edit.prune(cloud), count)
    splats = _Splats.of(cloud, device or open_device(task="geometry"))
    total = max(len(cloud) - count, 0)
    stalled = False
    while len(splats.rows) > count:
        here = len(splats.rows)
        progress.step(_LABEL, len(cloud) - here, total)
        wanted = min(here - count, max(1, int(ROUND * here)))
        found = splats.merge(splats.candidates(stalled), wanted)
        stalled = found < min(wanted, STALLED * here)
    progress.step(_LABEL, total, total)
    return splats.cloud()


def _shown(cloud: SplatCloud, count: int) -> SplatCloud:
    """Without the faintest of those that no picture shows, as long as more than `count` remain."""
    faint = np.flatnonzero(cloud.opacities < FAINTEST)
    faint = faint[np.argsort(cloud.opacities[faint], kind="stable")]
    going = faint[: max(len(cloud) - count, 0)]
    return edit.take(cloud, np.delete(np.arange(len(cloud)), going)) if len(going) else cloud


@dataclass(slots=True, eq=False, kw_only=True)
class _Splats:
    """Splats while they are merged: arrays of all that there were, and the rows still there."""

    device: Device
    before: SplatCloud
    rows: I32
    positions: F32
    covariances: F64
    masses: F64
    volumes: F64
    opacities: F32
    sh: F32
    velocities: F32
    merged: npt.NDArray[np.bool_]

    @classmethod
    def of(cls, cloud: SplatCloud, device: Device) -> _Splats:
        """All of a cloud, whose arrays are left alone."""
        n = len(cloud)
        still = np.empty((n, 0), np.float32)
        splats = cls(
            device=device,
            before=cloud,
            rows=np.arange(n, dtype=np.int32),
            positions=cloud.positions.copy(),
            covariances=device.empty((n, 6), np.float64),
            masses=device.empty(n, np.float64),
            volumes=device.empty(n, np.float64),
            opacities=cloud.opacities.copy(),
            sh=cloud.sh.reshape(n, -1).copy(),
            velocities=still if cloud.velocities is None else cloud.velocities.copy(),
            merged=np.zeros(n, np.bool_),
        )
        device.run(
            kernels.weigh, cloud.scales, cloud.rotations, cloud.opacities, splats.covariances,
            splats.masses, splats.volumes,
        )  # fmt: skip
        return splats

    def candidates(self, stalled: bool) -> I32:
        """Whom each splat that is left may merge with, as entries of `rows`, shape (m, k).

        The nearest, unless there are crowds, whose splats have all of one place at distance 0; or
        unless that got stuck: where distances cannot be told apart, any on the way will do.
        """
        points = self.positions[self.rows]
        order, ranks = coincident(points)
        if ranks.max() >= CROWD:
            return _beside(order, np.flatnonzero(ranks))
        if stalled:
            return _beside(morton.order(points), np.arange(1, len(points)))
        return nearest(self.device, points, points, NEIGHBORS + 1)[0]

    def merge(self, near: I32, wanted: int) -> int:
        """Merge the cheapest pairs of neighbours, `wanted` at most; say how many."""
        m = len(self.rows)
        partners, costs = self.device.empty(m, np.int32), self.device.empty(m, np.float64)
        state = (self.positions, self.covariances, self.masses, self.volumes, self.opacities)
        self.device.run(
            kernels.cheapest, self.rows, near, *state, self.sh, BY_COLOR, BY_OPACITY, partners,
            costs,
        )  # fmt: skip
        pairs, taken = self.device.empty((wanted, 2), np.int32), np.zeros(m, np.bool_)
        order = np.argsort(costs, kind="stable")
        found = int(self.device.run(kernels.match, order, partners, wanted, taken, pairs))
        gone = np.zeros(len(self.before), np.bool_)
        self.device.run(
            kernels.merge, pairs[:found], self.rows, *state, self.sh, self.velocities, self.merged,
            gone,
        )  # fmt: skip
        self.rows = self.rows[~gone[self.rows]]
        return found

    def cloud(self) -> SplatCloud:
        """Those that are left."""
        kept = edit.take(self.before, self.rows)
        changed = np.flatnonzero(self.merged[self.rows])
        for first in range(0, len(changed), _CHUNK):
            rows = changed[first : first + _CHUNK]
            shapes = covariance.to_scale_rotation(self.covariances[self.rows[rows]][:, _TRIANGLE])
            kept.scales[rows] = np.minimum(shapes[0], np.finfo(np.float32).max)
            kept.rotations[rows] = shapes[1]
        velocities = None if kept.velocities is None else self.velocities[self.rows]
        return replace(
            kept,
            positions=self.positions[self.rows],
            opacities=self.opacities[self.rows],
            sh=self.sh[self.rows].reshape(kept.sh.shape),
            velocities=velocities,
        )


def _beside(order: npt.NDArray[np.integer], later: npt.NDArray[np.integer]) -> I32:
    """Each row's neighbours in an order, shape (n, 2); -1 where `later`, the places whose row has
    something to do with the one before, has none."""
    near = np.full((len(order), 2), -1, np.int32)
    near[order[later], 0] = order[later - 1]
    near[order[later - 1], 1] = order[later]
    return near
