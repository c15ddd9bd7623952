"""Choose a level of detail by the size of a box in a picture, or by its distance.

Source: `screenSizeHeuristicQuery.cpp` and `distanceHeuristicQuery.cpp` in `pxr/usd/usdLod` of
OpenUSD 26.11. There, a box outside the picture has the size 0; here it has the size that it would
have beside the picture, so that shadows and reflections do not change when it leaves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Literal

import numpy as np

from usdsplat.core.cloud import F64

Metric = Literal["sphere", "box", "distance"]
Corner = tuple[float, float, float]

_SINGULAR = 1e-10
"""Determinant of a matrix below which the box of a distance is not used."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LodView:
    """What heuristics need of a view, in the space of the world."""

    eye: Corner
    """Position of the camera [scene unit]."""
    window: tuple[float, float]
    """Width and height of the picture: at a distance of 1 from the eye, or, for an orthographic
    camera, at any distance [scene unit]."""
    to_clip: F64
    """Matrix from the world to clip space, for column vectors, shape (4, 4)."""
    is_orthographic: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class LodHeuristic:
    """A heuristic that chooses by the size of a box in the picture, or by its distance."""

    metric: Metric
    """Part of the picture's area that the sphere around the box has, or the box itself; or distance
    from the eye to the box."""
    low: Corner
    """Lower corner of the box, in the space of the root; for a distance without a box the centre,
    as `high`."""
    high: Corner
    thresholds: tuple[float, ...]
    """Sizes, descending, or distances [scene unit], ascending, at which the next item begins."""
    blend_thresholds: tuple[float, ...] = ()
    """Sizes or distances at which the item before has gone; missing ones do not blend."""

    def level(self, view: LodView, to_world: F64) -> float:
        """Return the index of the item, with a fraction between two.

        Args:
            view: The view.
            to_world: Matrix from the space of the root to the world, for column vectors.
        """
        if self.metric == "distance":
            thresholds, blend = (
                [-t for t in ts] for ts in (self.thresholds, self.blend_thresholds)
            )
            return _level(-self._distance(view, to_world), thresholds, blend)
        sizes = {"sphere": self._sphere_size, "box": self._box_size}
        return _level(sizes[self.metric](view, to_world), self.thresholds, self.blend_thresholds)

    def _sphere_size(self, view: LodView, to_world: F64) -> float:
        low, high = _moved(to_world, self.low), _moved(to_world, self.high)
        radius, centre = float(np.linalg.norm(high - low)) / 2, (low + high) / 2
        if not view.is_orthographic:
            distance = float(np.linalg.norm(np.array(view.eye) - centre))
            radius = radius / distance if distance else math.inf
        area = view.window[0] * view.window[1]
        return math.pi * radius**2 / area if area else math.inf

    def _box_size(self, view: LodView, to_world: F64) -> float:
        corners = np.array(list(product(*zip(self.low, self.high, strict=True))))
        clip = np.c_[corners, np.ones(8)] @ (view.to_clip @ to_world).T
        points: list[tuple[float, float]] = []
        for first, second in _EDGES:
            before, after = clip[first], clip[second]
            near = before[2] + before[3], after[2] + after[3]
            if max(near) < 0:
                continue
            if min(near) < 0:
                cut = before + near[0] / (near[0] - near[1]) * (after - before)
                before, after = (cut, after) if near[0] < 0 else (before, cut)
            points += [(p[0] / p[3], p[1] / p[3]) for p in (before, after) if p[3]]
        return _hull_area(points) / 4  # the picture is 2 wide and 2 high

    def _distance(self, view: LodView, to_world: F64) -> float:
        eye = np.array(view.eye)
        nearest: F64 = np.array(self.low, np.float64)
        if self.low != self.high and abs(np.linalg.det(to_world)) > _SINGULAR:
            inside = _moved(np.linalg.inv(to_world).astype(np.float64), eye)
            nearest = np.clip(inside, self.low, self.high)
        return float(np.linalg.norm(eye - _moved(to_world, nearest)))


def nearest_index(level: float, count: int) -> int:
    """Return the item nearest to a level, which may be any number; halves are rounded up."""
    if math.isnan(level):
        return 0
    return math.floor(min(max(level, 0.0), count - 1) + 0.5)


_EDGES = [(i, j) for i, j in product(range(8), repeat=2) if i < j and (i ^ j) in (1, 2, 4)]
"""Edges of a box, whose corners are in the order of binary numbers."""


def _level(size: float, thresholds: Sequence[float], blend: Sequence[float]) -> float:
    """Return the index of the item for a size, with a fraction where two items blend."""
    index = 0
    while index < len(thresholds) and not size > thresholds[index]:
        index += 1
    if not 0 < index <= len(blend):
        return float(index)
    start, end = thresholds[index - 1], blend[index - 1]
    if index < len(thresholds):
        end = max(end, thresholds[index])
    if start >= size > end:
        return index - 1 + (size - start) / (end - start)
    return float(index)


def _hull_area(points: Sequence[tuple[float, float]]) -> float:
    """Return the area of the convex hull of points.

    Source: Andrew 1979, "Another efficient algorithm for convex hulls in two dimensions".
    """

    def half(ordered: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        kept: list[tuple[float, float]] = []
        for x, y in ordered:
            while len(kept) > 1:
                (ax, ay), (bx, by) = kept[-2:]
                if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0:
                    break
                kept.pop()
            kept.append((x, y))
        return kept[:-1]

    ordered = sorted(set(points))
    hull = half(ordered) + half(ordered[::-1])
    return sum(ax * by - bx * ay for (ax, ay), (bx, by) in pairwise([*hull, *hull[:1]])) / 2


def _moved(matrix: F64, point: Sequence[float] | F64) -> F64:
    """Return a point transformed by a matrix for column vectors."""
    moved: F64 = matrix[:3, :3] @ np.asarray(point, np.float64) + matrix[:3, 3]
    return moved
