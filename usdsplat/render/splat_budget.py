"""Select the splats to draw under a splat budget: drop those with the smallest opacity × size.

The selection depends on the cloud and the budget, not on the view. It does not flicker when a
camera moves. A smaller selection is always contained in a larger one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32, I32, SplatCloud
from usdsplat.core.edit import take

KEPT = 2
"""Number of subsets that are kept: one for the first picture of a movement, which has fewer splats,
and one for the others."""


@dataclass(frozen=True, slots=True, eq=False)
class SplatSubset:
    """A selection of the splats of a cloud."""

    cloud: SplatCloud
    rows: I32
    """Their rows in the whole cloud, ascending."""


class SplatBudget:
    """Selector of one cloud's subsets, with a cache of the last ones."""

    def __init__(self, cloud: SplatCloud) -> None:
        self._cloud = cloud
        self._weights = conspicuousness(cloud)
        self._most: I32 | None = None
        """Rows of the largest subset so far; smaller ones are chosen among them."""
        self._last: list[SplatSubset] = []

    def part(self, count: int) -> SplatSubset:
        """Return the `count` most conspicuous splats; of equal ones, those with the lowest rows."""
        found = next((each for each in self._last if len(each.rows) == count), None)
        if found is None:
            rows = self._rows(count)
            found = SplatSubset(take(self._cloud, rows), rows)
        self._last = [found, *(each for each in self._last if each is not found)][:KEPT]
        return found

    def _rows(self, count: int) -> I32:
        if self._most is None or len(self._most) < count:
            self._most = most_conspicuous(self._weights, count)
        if len(self._most) == count:
            return self._most
        rows: I32 = self._most[most_conspicuous(self._weights[self._most], count)]
        return rows


def conspicuousness(cloud: SplatCloud) -> F32:
    """Return opacity times the area of the two longest axes of each splat, shape (n,)."""
    x, y, z = cloud.scales.T
    area = np.maximum(np.maximum(x * y, y * z), z * x)
    return np.nan_to_num(cloud.opacities * area, nan=0.0)


def most_conspicuous(weights: F32, count: int) -> I32:
    """Return the rows of the `count` largest weights, ascending; 0 <= count <= n."""
    if count == 0:
        return np.empty(0, np.int32)
    least = np.partition(weights, len(weights) - count)[len(weights) - count]
    kept = weights > least
    equal = np.flatnonzero(weights == least)
    kept[equal[: count - np.count_nonzero(kept)]] = True
    return np.flatnonzero(kept).astype(np.int32)


def shares(fields: Sequence[tuple[int, int]], budget: int) -> list[int]:
    """Share a budget among fields, in proportion to their splats.

    A small field keeps at least one splat, as long as there is room for one in each of its
    instances.

    Args:
        fields: Number of splats and of instances of each field.
        budget: Maximum number of splats of all instances together.

    Returns:
        The number of splats that each field keeps.
    """
    kept = [0] * len(fields)
    left = sum(count * instances for count, instances in fields)
    for i in sorted(range(len(fields)), key=lambda i: fields[i]):
        count, instances = fields[i]
        fair = budget * count // max(left, 1)
        kept[i] = min(count, max(fair, 1), budget // max(instances, 1))
        budget -= kept[i] * instances
        left -= count * instances
    return kept
