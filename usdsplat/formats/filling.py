"""The arrays of a cloud while a reader fills them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from usdsplat.core import quaternion
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import FormatError
from usdsplat.core.sh import coefficient_count

BLOCK = 16384
"""Rows that readers decode at a time: their temporaries stay in the cache."""

Namer = Callable[[str, int], str]
"""(field of the cloud, flat column) -> the file's own name of that property."""


def blocks(count: int) -> Iterator[slice]:
    """Rows 0 to `count` in slices of `BLOCK`."""
    for start in range(0, count, BLOCK):
        yield slice(start, min(start + BLOCK, count))


def _field_name(field: str, _column: int) -> str:
    return field


class Filling:
    """Uninitialised arrays of a cloud, filled and settled by rows, in any order.

    Create it only when the file has been seen to hold `count` splats: nothing is allocated on the
    word of a header.
    """

    def __init__(self, source: str, count: int, degree: int) -> None:
        self._source = source
        self._zero = np.zeros(count, bool)
        self.positions = np.empty((count, 3), np.float32)
        self.scales = np.empty((count, 3), np.float32)
        self.rotations = np.empty((count, 4), np.float32)
        self.opacities = np.empty(count, np.float32)
        self.sh = np.empty((count, coefficient_count(degree), 3), np.float32)

    def settle(self, rows: slice, name: Namer = _field_name) -> None:
        """Check that filled rows are finite and make their rotations unit quaternions.

        Raises:
            FormatError: Naming, by `name`, the first property and row that is not finite.
        """
        for field in ("positions", "scales", "rotations", "opacities", "sh"):
            values = getattr(self, field)[rows]
            finite = np.isfinite(values)
            if not finite.all():
                flat = finite.reshape(len(values), -1)
                row = int(np.argmin(flat.all(axis=1)))
                column = int(np.argmin(flat[row]))
                found = values.reshape(len(values), -1)[row, column]
                where = f"{self._source}: {name(field, column)} of splat {rows.start + row}"
                raise FormatError(where, f"{found}", "a finite number")
        quaternions = self.rotations[rows]
        self._zero[rows] = ~quaternions.any(axis=1)
        quaternions[:] = quaternion.normalize(quaternions)

    def cloud(self) -> tuple[SplatCloud, tuple[str, ...]]:
        """The finished cloud, less the splats whose rotation is zero, and a note if there were."""
        dropped = int(np.count_nonzero(self._zero))
        kept = ~self._zero if dropped else slice(None)  # a slice copies nothing
        cloud = SplatCloud(
            positions=self.positions[kept],
            scales=self.scales[kept],
            rotations=self.rotations[kept],
            opacities=self.opacities[kept],
            sh=self.sh[kept],
        )
        notes = (f"splats dropped because their rotation is zero: {dropped}",)
        return cloud, notes if dropped else ()
