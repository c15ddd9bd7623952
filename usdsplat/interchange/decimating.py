"""Decimate a cloud: merge neighbouring splats, pairs with the smallest visible change first.

`kernels.thinning.pairs` defines the cost and the result of a merge. Each round finds the cheapest
partner of every splat among its nearest neighbours, and merges the cheapest of these pairs.
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
"""Number of nearest neighbours among which a splat's partner is searched."""
FAINTEST = 1 / 255
"""Opacity below which renderers skip a splat."""
ROUND = 0.25
"""Maximum fraction of splats removed in a round: the rest may find better partners."""
CROWD = 64
"""If more splats than this share a position, splats at equal positions are merged first."""
STALLED = 0.02
"""A round that merges less than this fraction of the splats, although more are wanted, counts as
stalled: too many splats share their neighbours."""
BY_COLOR, BY_OPACITY = 1.6, 1.0
"""Weights of squared differences of harmonics and of opacity, relative to shape [nat]."""

_LABEL = "merging splats"
_CHUNK = 1 << 13  # covariances per block: temporaries stay in the cache
_TRIANGLE = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # columns of (xx, xy, xz, yy, yz, zz)


def decimate(
    cloud: SplatCloud,
    count: int,
    *,
    progress: Progress = silent,
    device: Device | None = None,
) -> SplatCloud:
    """Merge neighbours until `count` splats are left.

    A merged splat has the mean position, covariance, harmonics and velocity of both, weighted by
    opacity times area. Its opacity preserves the sum of this product. It has the id and the
    position in the order of the heavier one. Splats that are not merged stay unchanged. A cloud of
    at most `count` splats is returned as it is. From a larger one, all splats with a number that is
    not finite are removed first, so that fewer than `count` may remain, then the splats that are
    too faint for any picture.

    Args:
        cloud: Splats of any degree.
        count: Number of splats to keep, >= 1.
        progress: Receives the number of removed splats after each round.
        device: Device; None for the fastest one.

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
    """Remove invisible splats, faintest first, while more than `count` remain."""
    faint = np.flatnonzero(cloud.opacities < FAINTEST)
    faint = faint[np.argsort(cloud.opacities[faint], kind="stable")]
    going = faint[: max(len(cloud) - count, 0)]
    return edit.take(cloud, np.delete(np.arange(len(cloud)), going)) if len(going) else cloud


@dataclass(slots=True, eq=False, kw_only=True)
class _Splats:
    """State of a decimation: arrays of all original splats, and the remaining rows."""

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
        """Create the state for a cloud, whose arrays are not modified."""
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
        """Return candidate partners of each remaining splat as indices into `rows`, shape (m, k).

        These are the nearest neighbours, with two exceptions. If many splats share a position, the
        candidates are other splats at the same position. If the last round stalled, they are the
        splats before and after in Morton order.
        """
        points = self.positions[self.rows]
        order, ranks = coincident(points)
        if ranks.max() >= CROWD:
            return _beside(order, np.flatnonzero(ranks))
        if stalled:
            return _beside(morton.order(points), np.arange(1, len(points)))
        return nearest(self.device, points, points, NEIGHBORS + 1)[0]

    def merge(self, near: I32, wanted: int) -> int:
        """Merge at most `wanted` of the cheapest pairs and return their number."""
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
        """Return the remaining splats."""
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
    """Return the rows before and after each row in `order`, shape (n, 2), -1 for none.

    `later` holds the indices into `order` whose row may merge with the row before it."""
    near = np.full((len(order), 2), -1, np.int32)
    near[order[later], 0] = order[later - 1]
    near[order[later - 1], 1] = order[later]
    return near
