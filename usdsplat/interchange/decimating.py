"""Decimate a cloud: merge neighbouring splats, pairs with the smallest visible change first.

`kernels.thinning.pairs` defines the cost and the result of a merge. Each round finds the cheapest
partner of every splat among its nearest neighbours, and merges the cheapest of these pairs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from usdsplat.core import covariance, edit, morton
from usdsplat.core.cloud import F32, F64, I32, SplatCloud
from usdsplat.core.errors import UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.interchange.outliers import weighted_median
from usdsplat.kernels.device import Device
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.points.coincident import coincident
from usdsplat.kernels.points.nearest import nearest
from usdsplat.kernels.thinning import pairs as kernels

NEIGHBORS = 6
"""Number of nearest neighbours among which a splat's partner is searched."""
FAINTEST = 1 / 255
"""Opacity below which renderers skip a splat."""
RENEWED = 0.3
"""Fraction of the splats of the last search below which neighbours are searched again."""
CROWD = 64
"""If more splats than this share a position, splats at equal positions are merged first."""
STALLED = 0.02
"""A round that merges less than this fraction of the splats, although more are wanted, counts as
stalled: too many splats share their neighbours."""
LOW_PASS = 0.3
"""Variance that classic pictures add to every splat [pixel^2]."""
LINES = 800
"""Lines of the picture for which classic captures are decimated: fewer are better from afar, more
are better close by, and with these both are ahead in `benchmarks.decimation`."""
FAR_LINES = 540
"""Lines of the picture of whose mean levels are made. From four times the framing distance, in
pictures of 480 lines, levels for half this pixel are 0.6 to 6 dB worse and for twice 6 to 10 dB; in
pictures of 240 lines those for twice are better, and these still 5 dB ahead of all else."""
FRAMED = 0.95
"""Fraction of opacity times area that a picture of a capture shows."""
ACROSS = 1080
"""Largest height of what such a picture shows, in middle axes of the median splat."""
BY_COLOR, BY_OPACITY = 1.6, 1.0
"""Weights of squared differences of harmonics and of opacity, relative to shape [nat]."""

_LABEL = "merging splats"
_CHUNK = 1 << 13  # covariances per block: temporaries stay in the cache
_TRIANGLE = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # columns of (xx, xy, xz, yy, yz, zz)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Plan:
    """How splats are merged."""

    blur: float = 0.0
    """Variance added to every splat along every axis [unit^2]."""
    peak: float = kernels.OPAQUE
    """Largest opacity of a merged splat."""
    growth: float
    """Part, by its logarithm, of the mass in excess of this opacity that makes a merged splat
    larger. The rest is assumed to be hidden behind a third splat: widened ones overlap more."""
    round: float
    """Maximum fraction of splats removed in a round. In small rounds, more splats find better
    partners; in large ones, fewer splats in a crowd are merged again and again."""


# Measured: each is the best for its pictures in benchmarks.decimation and minification.
_CLASSIC = _Plan(growth=0.65, round=0.34)
_ANTIALIASED = _Plan(growth=1.0, round=0.3)
_LEVEL = _Plan(growth=0.65, round=0.3)


def decimate(
    cloud: SplatCloud,
    count: int,
    *,
    pixel: float = 0.0,
    progress: Progress = silent,
    device: Device | None = None,
) -> SplatCloud:
    """Merge neighbours until `count` splats are left, for the same use as the cloud.

    A merged splat has the mean position, covariance, harmonics and velocity of both, weighted by
    opacity times area. Its opacity preserves the sum of this product, without what the two hide of
    each other. It has the id and the position in the order of the heavier one. Splats that are not
    merged stay unchanged. A cloud of at most `count` splats is returned as it is. From a larger
    one, all splats with a number that is not finite are removed first, so that fewer than `count`
    may remain, then the splats that are too faint for any picture.

    In classic mode, pictures show splats widened by a low-pass of 0.3 pixel^2, which adds most to
    the visible area of thin ones. With `pixel`, splats are compared and merged as they look there,
    and the low-pass is removed from the results: the cloud should then be drawn in classic mode.

    Args:
        cloud: Splats of any degree.
        count: Number of splats to keep, >= 1.
        pixel: Size of a pixel at the splats [unit], >= 0; see `framing_pixel`. 0 for clouds that
            are drawn antialiased.
        progress: Receives the number of removed splats after each round.
        device: Device; None for the fastest one.

    Raises:
        UsageError: If `count` is less than 1, or `pixel` is negative or not finite.
    """
    _check(count, pixel)
    if len(cloud) <= count:
        return cloud
    plan = replace(_CLASSIC if pixel else _ANTIALIASED, blur=_low_pass(pixel))
    return _merged(cloud, count, plan, progress, device).cloud()


def level(
    cloud: SplatCloud,
    count: int,
    *,
    pixel: float = 0.0,
    peak: float = kernels.OPAQUE,
    progress: Progress = silent,
    device: Device | None = None,
) -> SplatCloud:
    """Return splats that look from afar like the mean of what `cloud` shows close by.

    They are to be drawn antialiased. Close by, a classic capture is seen with a low-pass of 0.3
    pixel^2, so this is added to the covariance of every splat, and it gets smaller from afar as the
    splat does. Then neighbours are merged as in `decimate`. For the next coarser level, decimate
    the result with `pixel` 0.

    Args:
        cloud: Splats of any degree.
        count: Largest number of splats to return, >= 1.
        pixel: Size of the pixel [unit], >= 0, at which a classic capture is seen close by; see
            `framing_pixel`. 0 for an antialiased capture, or a level.
        peak: Largest opacity of a merged splat, > 0. Above 1, pictures draw it with a flat top,
            which is closer to the splats that it stands for, but few formats can store it.
        progress: Receives the number of removed splats after each round.
        device: Device; None for the fastest one.

    Raises:
        UsageError: If `count` is less than 1, or `pixel` is negative or not finite.
    """
    _check(count, pixel)
    plan = replace(_LEVEL, blur=_low_pass(pixel), peak=peak)
    if len(cloud) <= count:
        return _widened(cloud, plan.blur)
    return _merged(cloud, count, plan, progress, device).cloud(widened=True)


def framing_pixel(cloud: SplatCloud, lines: int = LINES) -> float:
    """Return the size of a pixel of a picture that frames a capture [unit].

    The picture frames the sphere that holds FRAMED of the capture's weight, or a part of it that is
    ACROSS typical splats high if this is less: large scenes are seen in parts. Only splats with
    finite numbers count; 0 if they have no weight.

    Args:
        cloud: The capture.
        lines: Height of the picture [pixel].
    """
    middle = np.median(cloud.scales.astype(np.float64), axis=1)
    weight = cloud.opacities * middle * cloud.scales.max(axis=1, initial=0.0)
    sound = np.flatnonzero(np.isfinite(cloud.positions).all(axis=1) & np.isfinite(weight))
    if not len(sound) or not weight[sound].sum() > 0:
        return 0.0
    middle, weight, points = middle[sound], weight[sound], cloud.positions[sound].astype(np.float64)
    weight = np.minimum(weight, np.quantile(weight, 0.99))
    center = [weighted_median(axis, weight) for axis in points.T]  # far splats do not move it
    reach = np.linalg.norm(points - center, axis=1)
    order = np.argsort(reach)
    share = np.cumsum(weight[order])
    radius = reach[order][np.searchsorted(share, FRAMED * share[-1])]
    return float(min(2 * radius, ACROSS * np.median(middle)) / lines)


def _check(count: int, pixel: float) -> None:
    if count < 1:
        raise UsageError("decimation", f"{count} splats", "1 or more")
    if not (math.isfinite(pixel) and pixel >= 0):
        raise UsageError("decimation", f"a pixel of size {pixel:g}", "a finite size, 0 or more")


def _low_pass(pixel: float) -> float:
    """Return the variance of the low-pass of classic pictures [unit^2]."""
    return LOW_PASS * pixel * pixel


def _widened(cloud: SplatCloud, blur: float) -> SplatCloud:
    """Add a variance along every axis of every splat."""
    if blur == 0:
        return cloud
    return replace(cloud, scales=np.hypot(cloud.scales, math.sqrt(blur)).astype(np.float32))


def _merged(
    cloud: SplatCloud,
    count: int,
    plan: _Plan,
    progress: Progress,
    device: Device | None,
) -> _Splats:
    """Merge the cheapest pairs of the shown splats, round by round."""
    cloud = _shown(edit.prune(cloud), count)
    splats = _Splats.of(cloud, plan, device or open_device(task="geometry"))
    total = max(len(cloud) - count, 0)
    searched, fresh, stalled = 0, False, False  # splats at the last search; whether it is the last
    while len(splats.rows) > count:
        here = len(splats.rows)
        progress.step(_LABEL, len(cloud) - here, total)
        if stalled or here < RENEWED * searched or not searched:
            fresh = splats.search(fresh and stalled)
            searched = here if fresh else 0
        else:
            splats.follow()
            fresh = False
        wanted = min(here - count, max(1, int(plan.round * here)))
        found = splats.merge(wanted)
        stalled = found < min(wanted, STALLED * here)
    progress.step(_LABEL, total, total)
    return splats


def _shown(cloud: SplatCloud, count: int) -> SplatCloud:
    """Remove invisible splats, faintest first, while more than `count` remain."""
    faint = np.flatnonzero(cloud.opacities < FAINTEST)
    faint = faint[np.argsort(cloud.opacities[faint], kind="stable")]
    going = faint[: max(len(cloud) - count, 0)]
    return edit.take(cloud, np.delete(np.arange(len(cloud)), going)) if len(going) else cloud


@dataclass(slots=True, eq=False, kw_only=True)
class _Splats:
    """State of a decimation: arrays of all original splats in Morton order, and the remaining
    rows."""

    device: Device
    before: SplatCloud
    order: npt.NDArray[np.intp] | None
    rows: I32
    positions: F32
    covariances: F64
    masses: F64
    volumes: F64
    opacities: F32
    sh: F32
    velocities: F32
    merged: npt.NDArray[np.bool_]
    plan: _Plan
    weights: F64
    near: I32
    costs: F32
    heirs: I32
    mates: I32

    @classmethod
    def of(cls, cloud: SplatCloud, plan: _Plan, device: Device) -> _Splats:
        """Create the state for a cloud, whose arrays are not modified."""
        n = len(cloud)
        codes = morton.codes(cloud.positions)
        order = None
        if (codes[1:] < codes[:-1]).any():
            order = np.argsort(codes, kind="stable")
            cloud = edit.take(cloud, order)
        still = np.empty((n, 0), np.float32)
        splats = cls(
            device=device,
            before=cloud,
            order=order,
            rows=np.arange(n, dtype=np.int32),
            positions=cloud.positions.copy(),
            covariances=device.empty((n, 6), np.float64),
            masses=device.empty(n, np.float64),
            volumes=device.empty(n, np.float64),
            opacities=cloud.opacities.copy(),
            sh=cloud.sh.reshape(n, -1).copy(),
            velocities=still if cloud.velocities is None else cloud.velocities.copy(),
            merged=np.zeros(n, np.bool_),
            plan=plan,
            weights=np.array([BY_COLOR, BY_OPACITY, 1.0]),
            near=device.empty((n, NEIGHBORS), np.int32),
            costs=device.empty((n, NEIGHBORS), np.float32),
            heirs=np.full(n, -1, np.int32),
            mates=np.full(n, -1, np.int32),
        )
        device.run(
            kernels.weigh, cloud.scales, cloud.rotations, cloud.opacities, plan.blur,
            splats.covariances, splats.masses, splats.volumes,
        )  # fmt: skip
        typical = float(splats.masses.mean()) if n else 0.0
        if np.isfinite(typical) and typical > 0:
            splats.weights[2] = typical**-0.75
        return splats

    def search(self, again: bool) -> bool:
        """Find candidate partners of each remaining splat.

        These are the nearest neighbours, with two exceptions. If many splats share a position, the
        candidates are other splats at the same position. If they were searched `again` in vain,
        they are the splats before and after in Morton order. Return whether there was no exception.
        """
        points = self.positions[self.rows]
        order, ranks = coincident(points)
        crowded = bool(ranks.max() >= CROWD)
        if crowded:
            found = _beside(order, np.flatnonzero(ranks))
        elif again:
            found = _beside(morton.order(points), np.arange(1, len(points)))
        else:
            found = nearest(self.device, points, points, NEIGHBORS + 1)[0]
        self.device.run(
            kernels.compare, self.rows, found, *self._values(), self.weights, self.near, self.costs
        )
        return not (crowded or again)

    def follow(self) -> None:
        """Update the candidates after merges."""
        self.device.run(
            kernels.follow, self.rows, self.heirs, self.mates, *self._values(), self.weights,
            self.near, self.costs,
        )  # fmt: skip

    def merge(self, wanted: int) -> int:
        """Merge at most `wanted` of the cheapest pairs and return their number."""
        n = len(self.before)
        # Costs are not negative: they have the order of their bits, and equal ones that of rows.
        bits = self.costs[self.rows, 0].view(np.uint32).astype(np.uint64)
        keys = np.sort(bits << np.uint64(32) | self.rows.astype(np.uint64))
        order = keys.astype(np.uint32).view(np.int32)
        pairs, taken = self.device.empty((wanted, 2), np.int32), np.zeros(n, np.bool_)
        found = int(self.device.run(kernels.match, order, self.near, wanted, taken, pairs))
        self.mates[:] = -1
        self.device.run(
            kernels.merge, pairs[:found], self.plan.peak, self.plan.growth, *self._values(),
            self.velocities, self.merged, self.heirs, self.mates,
        )  # fmt: skip
        self.rows = self.rows[self.heirs[self.rows] < 0]
        return found

    def cloud(self, *, widened: bool = False) -> SplatCloud:
        """Return the remaining splats, in their original order, as they are or `widened` by the
        low-pass."""
        rows = self.rows
        if self.order is not None:
            rows = rows[np.argsort(self.order[rows])]
        kept = edit.take(self.before, rows)
        if widened:
            kept = _widened(kept, self.plan.blur)
        removed = 0.0 if widened else self.plan.blur
        changed = np.flatnonzero(self.merged[rows])
        for first in range(0, len(changed), _CHUNK):
            some = changed[first : first + _CHUNK]
            shown = self.covariances[rows[some]][:, _TRIANGLE] - removed * np.eye(3)
            shapes = covariance.to_scale_rotation(shown)
            kept.scales[some] = np.minimum(shapes[0], np.finfo(np.float32).max)
            kept.rotations[some] = shapes[1]
        velocities = None if kept.velocities is None else self.velocities[rows]
        return replace(
            kept,
            positions=self.positions[rows],
            opacities=self.opacities[rows],
            sh=self.sh[rows].reshape(kept.sh.shape),
            velocities=velocities,
        )

    def _values(self) -> tuple[F32, F64, F64, F64, F32, F32]:
        return (
            self.positions, self.covariances, self.masses, self.volumes, self.opacities, self.sh
        )  # fmt: skip


def _beside(order: npt.NDArray[np.integer], later: npt.NDArray[np.integer]) -> I32:
    """Return the rows before and after each row in `order`, shape (n, 2), -1 for none.

    `later` holds the indices into `order` whose row may merge with the row before it."""
    near = np.full((len(order), 2), -1, np.int32)
    near[order[later], 0] = order[later - 1]
    near[order[later - 1], 1] = order[later]
    return near
