"""Find the subject of a picture by what is seen of it, and the camera position that frames it.

A capture has floaters around it, and its background reaches far beyond what it is of. Bounds tell
nothing about that, so splats are weighed in three steps:

1. Where most of what is seen is far away from most splats, as the sky and the ground of a place
   are, splats many times as far from the middle as the others are background.
2. The others are projected along the view onto a grid. A splat belongs to the subject where the
   grid's cells are not transparent, in groups of cells that are not much smaller than the largest
   one. Of these, splats that are far in front of the others or behind are floaters.
3. At each edge of the picture, `OUTSIDE` of the weight of these splats, which is opacity times
   projected area, may be outside.

A camera of given directions sees a point (x, y, z) inside its left, right, lower and upper planes
if |x - x0| / right and |y - y0| / top are at most d - z, where the eye is at (x0, y0, d). So each
plane has one number that limits the eye, the largest x / right + z of the points for the right one,
and the four numbers give the nearest eye in closed form.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64, I64
from usdsplat.render.fields import Box

MOST = 30_000
"""About how many splats are weighed."""
FILL = 0.9
"""Part of the picture's width or height that the subject fills."""
OUTSIDE = 0.0002
"""Part of the weight that may be outside of each edge."""
PLACE = 25.0
"""Distance from the middle of `SHARE` of the weight beyond which a capture is one of a place, whose
background does not count, relative to the median distance of the splats. The largest one of our
captures of single things is 3.3, of a bust on a pedestal."""
SHARE = 0.9
FAR = 6.0
"""Distance from the middle beyond which splats of a place are background, relative to the median of
the weight."""
LARGEST = 0.02
"""Size beyond which a splat has no more weight in that median, relative to the median distance of
the splats from the middle: the sky is few large splats."""
CELLS = 96
"""Number of cells of the grid along its longer side."""
OPAQUE = 0.2
"""Least opacity of the cells of the subject."""
SMALLEST = 0.02
"""Smallest group of cells of the subject, by the sum of their opacities, relative to the largest
one that the field is in."""
DEEPER = 0.5
"""Distance of the subject's nearest and farthest splats from 98 % of its weight, at most, relative
to the depth of that."""
FAINT = 0.25
"""Opacity below which a splat counts as invisible; its reach is the distance at which it falls to
this."""
SPREAD = 1.2
"""Standard deviations from the centre at which the weight of a splat is put on the grid, besides
the centre."""
NEAREST = 0.25
"""Least distance of the eye from the subject, relative to the subject's depth."""
ROUNDING = 1e-9
"""Relative error of distances."""

Mask = npt.NDArray[np.bool_]
Directions = F64
"""Rotation from the world to a camera, rows right, up and back, shape (3, 3)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Subject:
    """Splats with what is needed to weigh them, and points that count whatever they weigh."""

    centers: F64
    """World positions [scene unit], shape (n, 3)."""
    axes: F64
    """Principal axes in the world times standard deviations, as rows, shape (n, 3, 3)."""
    opacities: F64
    """[0..1], shape (n,)."""
    counts: F64
    """Number of splats that each one stands for, shape (n,)."""
    owners: I64
    """Number of the field or tree of each splat, shape (n,). Something of each is framed."""
    points: F64
    """World positions, such as points of surfaces, shape (m, 3)."""

    def frame(
        self, directions: Directions, window: tuple[float, float], *, is_orthographic: bool = False
    ) -> tuple[F64, float]:
        """Return the target and the distance of a camera that frames the subject, centred.

        Args:
            directions: Directions of the camera.
            window: Half of the width and of the height of the picture at distance 1; for an
                orthographic camera they grow with the distance.
            is_orthographic: Whether the projection is orthographic.

        Returns:
            A world position in the middle of the subject, shape (3,), and the distance of the eye
            from it, along the camera's back axis; 0 if the subject is a point. Positions that are
            not finite are ignored. The origin and 0 for an empty subject.
        """
        right, top = FILL * window[0], FILL * window[1]
        depth = 0.0 if is_orthographic else 1.0
        seen = self._projected(directions)
        if seen is None:
            return np.zeros(3), 0.0
        on_right, on_left = seen.limit(1 / right, 0.0, depth), seen.limit(-1 / right, 0.0, depth)
        above, below = seen.limit(0.0, 1 / top, depth), seen.limit(0.0, -1 / top, depth)
        front, behind = seen.limit(0.0, 0.0, 1.0), -seen.limit(0.0, 0.0, -1.0)
        eye = max(on_right + on_left, above + below) / 2
        middle = (front + behind) / 2
        target = (right * (on_right - on_left) / 2, top * (above - below) / 2, middle)
        if not is_orthographic:
            eye = max(eye, front + NEAREST * (front - behind))
        distance = eye if is_orthographic else eye - middle
        is_point = distance <= ROUNDING * (abs(eye) + abs(middle))
        return directions.T @ target, 0.0 if is_point else distance

    def extent(self, directions: Directions) -> tuple[F64, F64]:
        """Return the middle of what is framed, and half of its size along the directions.

        Returns:
            World position and size, each of shape (3,). The middle has the depth of the target of
            `frame`. Zeros for an empty subject.
        """
        seen = self._projected(directions)
        if seen is None:
            return np.zeros(3), np.zeros(3)
        high, low = (
            np.array([side * seen.limit(*(side * axis)) for axis in np.eye(3)]) for side in (1, -1)
        )
        return directions.T @ ((high + low) / 2), (high - low) / 2

    def half_width(self, directions: Directions, eye: F64) -> float:
        """Return how wide a picture must be to show the subject from a given camera position.

        Args:
            directions: Directions of a perspective camera.
            eye: Its world position, shape (3,).

        Returns:
            Half of the width at distance 1; infinity if something is beside or behind the eye, 0
            for an empty subject.
        """
        seen = self._projected(directions)
        return 0.0 if seen is None else seen.half_width(directions @ eye)

    def thinned(self, step: int) -> Subject:
        """Return each `step`-th splat of each owner, which then stand for the others too; all
        points stay."""
        if step <= 1 or not len(self.owners):
            return self
        number = np.bincount(self.owners)
        first = np.cumsum(number) - number
        order = np.argsort(self.owners, kind="stable")
        rows = order[(np.arange(len(order)) - first[self.owners[order]]) % step == 0]
        owners = self.owners[rows]
        more = number / np.maximum(np.bincount(owners, minlength=len(number)), 1)
        return replace(
            self,
            centers=self.centers[rows],
            axes=self.axes[rows],
            opacities=self.opacities[rows],
            counts=self.counts[rows] * more[owners],
            owners=owners,
        )

    def _projected(self, directions: Directions) -> _Projected | None:
        """Return what is framed in camera axes; None if there is nothing."""
        points = self.points @ directions.T
        if not len(self.centers):
            no_axes, no_weight = np.empty((0, 3, 3)), np.empty(0)
            return _Projected(points, points[:0], no_axes, no_weight) if len(points) else None
        is_near = self._is_near()
        centers, axes = self.centers[is_near] @ directions.T, self.axes[is_near] @ directions.T
        opacities, counts = self.opacities[is_near], self.counts[is_near]
        areas = _areas(axes)
        depths = counts * _depths(opacities) * areas
        kept, cell = _seen(centers, axes, depths, self.owners[is_near])
        for owner in np.unique(self.owners[is_near]):
            rows = np.flatnonzero(kept & (self.owners[is_near] == owner))
            kept[rows] = _at_depth(centers[rows, 2], depths[rows])
        weight = (counts * opacities * np.minimum(areas, cell))[kept]
        reach = np.sqrt(2 * np.log(np.maximum(opacities[kept], FAINT) / FAINT))
        return _Projected(points, centers[kept], axes[kept] * reach[:, None, None], weight)

    def _is_near(self) -> Mask:
        """Return which splats are no background, shape (n,)."""
        near = np.ones(len(self.centers), np.bool_)
        areas = np.sort(np.linalg.norm(self.axes, axis=-1), axis=-1)[:, 1:].prod(axis=-1)
        weight = self.counts * self.opacities
        for owner in np.unique(self.owners):
            rows = np.flatnonzero(self.owners == owner)
            near[rows] = _no_background(self.centers[rows], weight[rows], areas[rows])
        return near


@dataclass(frozen=True, slots=True, eq=False)
class _Projected:
    """What is framed of a subject, in camera axes."""

    points: F64
    """Shape (m, 3)."""
    centers: F64
    """Centres of splats, shape (n, 3)."""
    axes: F64
    """Vectors from the centres to where splats end to be visible, as rows, shape (n, 3, 3)."""
    weight: F64
    """Shape (n,)."""

    def limit(self, x: float, y: float, z: float) -> float:
        """Return the farthest position along the normal of a plane."""
        normal = np.array((x, y, z))
        ends = self.centers @ normal + np.linalg.norm(self.axes @ normal, axis=1)
        return self._farthest(self.points @ normal, ends)

    def half_width(self, eye: F64) -> float:
        """See `Subject.half_width`; the eye is in camera axes."""
        before, ahead = eye[2] - self.points[:, 2], eye[2] - self.centers[:, 2]
        if min(before.min(initial=math.inf), ahead.min(initial=math.inf)) <= 0:
            return math.inf
        widths = np.abs(self.centers[:, 0] - eye[0]) + np.linalg.norm(self.axes[..., 0], axis=1)
        return self._farthest(np.abs(self.points[:, 0] - eye[0]) / before, widths / ahead)

    def _farthest(self, points: F64, ends: F64) -> float:
        """Return the largest value of a point, or of nearly all of the weight of the splats."""
        most = [float(points.max())] if len(points) else []
        if len(ends):
            most.append(_quantile(ends, self.weight, 1 - OUTSIDE))
        return max(most)


def of_points(points: npt.NDArray[np.floating]) -> Subject:
    """Return points as a subject, all of which are framed, shape (m, 3)."""
    none = np.empty(0)
    found = np.asarray(points, np.float64).reshape(-1, 3)
    return Subject(
        centers=np.empty((0, 3)), axes=np.empty((0, 3, 3)), opacities=none, counts=none,
        owners=np.empty(0, np.int64),
        points=found[np.isfinite(found).all(axis=1)],
    )  # fmt: skip


def of_box(box: Box) -> Subject:
    """Return the corners of a box as a subject."""
    return of_points(corners(box))


def joined(subjects: Iterable[Subject | None]) -> Subject | None:
    """Return all subjects as one, with about `MOST` splats at most, or one of each owner; None if
    there is nothing in them."""
    found = [each for each in subjects if each is not None and len(each.centers) + len(each.points)]
    if not found:
        return None
    step = sum(len(each.centers) for each in found) // MOST
    found = [each.thinned(step) for each in found]
    owners, count = [], 0
    for each in found:
        owners.append(each.owners + count)
        count += int(each.owners.max(initial=-1)) + 1
    return Subject(
        centers=np.concatenate([each.centers for each in found]),
        axes=np.concatenate([each.axes for each in found]),
        opacities=np.concatenate([each.opacities for each in found]),
        counts=np.concatenate([each.counts for each in found]),
        owners=np.concatenate(owners),
        points=np.concatenate([each.points for each in found]),
    )


def corners(box: Box) -> F64:
    """Return the eight corners of a box, shape (8, 3)."""
    return np.array(np.meshgrid(*zip(*box, strict=True))).reshape(3, 8).T


def _no_background(centers: F64, weight: F64, areas: F64) -> Mask:
    """Return which splats of a field are no background, shape (n,).

    Args:
        centers: Positions, shape (n, 3).
        weight: Weight by area, shape (n,).
        areas: Product of the two larger standard deviations, shape (n,).
    """
    near = np.ones(len(centers), np.bool_)
    for _ in range(4):
        middle = np.median(centers[near], axis=0)
        distance = np.linalg.norm(centers - middle, axis=1)
        usual = float(np.median(distance[near]))
        if not usual or (
            near.all() and _quantile(distance, weight * areas, SHARE) <= PLACE * usual
        ):
            break
        capped = weight * np.minimum(areas, (LARGEST * usual) ** 2)
        now = distance <= FAR * _quantile(distance[near], capped[near], 0.5)
        if (now == near).all() or not now.any():
            break
        near = now
    return near


def _seen(centers: F64, axes: F64, depths: F64, owners: I64) -> tuple[Mask, float]:
    """Return which splats are where a picture is not transparent, and the area of a grid cell.

    Args:
        centers: Positions in camera axes, shape (n, 3).
        axes: Principal axes there, as in `Subject`.
        depths: Optical depth of each splat, integrated over the picture, shape (n,).
        owners: See `Subject`.

    Returns:
        Shape (n,); of a field that is transparent everywhere, all splats. And the area [scene unit
        squared].
    """
    kept, area = np.ones(len(centers), np.bool_), 0.0
    if not len(centers):
        return kept, area
    ends = np.concatenate([np.zeros((len(axes), 1, 2)), axes[..., :2], -axes[..., :2]], axis=1)
    for _ in range(2):  # the second grid is finer, if there are floaters
        low, high = np.quantile(centers[kept, :2], (0.002, 0.998), axis=0)
        middle, half = (low + high) / 2, 0.75 * float((high - low).max()) or 1.0
        cell = 2 * half / CELLS
        places = (centers[:, None, :2] + SPREAD * ends + (half - middle)) * (1 / cell)
        in_grid = ((places >= 0) & (places < CELLS)).all(axis=-1)
        column, row = np.where(in_grid, places.T.swapaxes(1, 2), 0).astype(np.int32)
        index, parts = column + CELLS * row, in_grid * (depths / (len(ends[0]) * cell**2))[:, None]
        grid = np.bincount(index.ravel(), parts.ravel(), CELLS * CELLS).reshape(CELLS, CELLS)
        around = _around(grid, np.add) / 9
        size = np.where(in_grid[:, 0], _groups(1 - np.exp(-around)).ravel()[index[:, 0]], 0)
        largest = np.zeros(int(owners.max()) + 1)
        np.maximum.at(largest, owners, size)
        kept, area = size >= SMALLEST * largest[owners], cell**2
        kept &= (size > 0) | (largest[owners] == 0)
    return kept, area


def _at_depth(values: F64, weight: F64) -> Mask:
    """Return which splats are neither far in front of most of the weight nor far behind, shape
    (n,): floaters may be before the subject in the picture."""
    low, high = _quantile(values, weight, 0.01), _quantile(values, weight, 0.99)
    around = DEEPER * (high - low)
    found: Mask = (values >= low - around) & (values <= high + around)
    return found


def _groups(opacities: F64) -> F64:
    """Return the size of the connected group of each cell, and of the cells beside it, by the sum
    of its opacities; 0 elsewhere.

    Args:
        opacities: Of the cells, shape (CELLS, CELLS).
    """
    cells = opacities >= OPAQUE
    labels = np.where(cells, np.arange(1, cells.size + 1).reshape(cells.shape), 0)
    while True:
        near = _around(labels, np.maximum)
        now = np.where(cells, near, 0)
        if (now == labels).all():
            break
        labels = now
    sizes = np.bincount(labels.ravel(), opacities.ravel(), cells.size + 1)
    sizes[0] = 0.0
    found: F64 = sizes[near]
    return found


def _around(grid: npt.NDArray[Any], combine: np.ufunc) -> npt.NDArray[Any]:
    """Return the combination of each cell with the eight around it; beyond the edges is 0."""
    for _ in range(2):
        wide = np.pad(grid, ((1, 1), (0, 0)))
        grid = combine(combine(wide[:-2], wide[1:-1]), wide[2:]).T
    return grid


def _depths(opacities: F64) -> F64:
    """Return the optical depth at the centres of splats."""
    return -np.log1p(-np.minimum(opacities, 0.99))


def _areas(axes: F64) -> F64:
    """Return the integrals of the projections of Gaussians along z, shape (n,)."""
    x, y = axes[..., 0], axes[..., 1]
    xx, yy, xy = (x * x).sum(axis=1), (y * y).sum(axis=1), (x * y).sum(axis=1)
    return 2 * math.pi * np.sqrt(np.maximum(xx * yy - xy * xy, 0))


def _quantile(values: F64, weight: F64, part: float) -> float:
    """Return the least value at which `part` of the weight is reached; splats without any area
    weigh the same."""
    order = np.argsort(values, kind="stable")
    reached = np.cumsum(weight[order] if weight.any() else np.ones(len(values)))
    index = int(np.searchsorted(reached, part * reached[-1]))
    return float(values[order[min(index, len(values) - 1)]])
