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
from usdsplat.kernels.device import CpuDevice, open_device
from usdsplat.kernels.points.nearest import nearest
from usdsplat.kernels.thinning import pairs as kernels

NEIGHBORS = 8
"""Of which a splat's partner is one."""
ROUND = 0.25
"""Part of the splats that a round takes away at most: the rest waits for better partners."""
STALLED = 0.02
"""Part below which a round that wanted more has got stuck."""
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
    device: CpuDevice | None = None,
) -> SplatCloud:
    """Merge neighbours until `count` splats are left.

    A merged splat has the place, spread, harmonics and velocity of both, weighted by opacity times
    area, is so opaque that this product is kept, and has the id and the place in the order of the
    heavier. Splats that were merged with none are those that they were. A cloud that has no more
    than `count` is returned as it is; from any other those with a number that is not finite go
    first, and then there may be fewer.

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
    cloud = edit.prune(cloud)
    splats = _Splats.of(cloud, device or open_device())
    total = len(cloud) - count
    stalled = False
    while len(splats.rows) > count:
        here = len(splats.rows)
        progress.step(_LABEL, len(cloud) - here, total)
        wanted = min(here - count, max(1, int(ROUND * here)))
        near = splats.along_curve() if stalled else splats.nearest()
        found = splats.merge(near, wanted)
        stalled = found < wanted and found < STALLED * here
    progress.step(_LABEL, total, total)
    return splats.cloud()


@dataclass(slots=True, eq=False, kw_only=True)
class _Splats:
    """Splats while they are merged: arrays of all that there were, and the rows still there."""

    device: CpuDevice
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
    def of(cls, cloud: SplatCloud, device: CpuDevice) -> _Splats:
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

    def nearest(self) -> I32:
        """Neighbours of each splat that is left, as entries of `rows`, shape (m, k)."""
        points = self.positions[self.rows]
        return nearest(self.device, points, points, NEIGHBORS + 1)[0]

    def along_curve(self) -> I32:
        """Those before and after on a curve through all splats: where many are at one place, all
        have the same few nearest, and hardly any pair is free."""
        order = morton.order(self.positions[self.rows]).astype(np.int32)
        near = np.full((len(order), 2), -1, np.int32)
        near[order[1:], 0] = order[:-1]
        near[order[:-1], 1] = order[1:]
        return near

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
            kept.scales[rows], kept.rotations[rows] = shapes
        velocities = None if kept.velocities is None else self.velocities[self.rows]
        return replace(
            kept,
            positions=self.positions[self.rows],
            opacities=self.opacities[self.rows],
            sh=self.sh[self.rows].reshape(kept.sh.shape),
            velocities=velocities,
        )
