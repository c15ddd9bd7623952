"""Build a cloud while a reader decodes its file."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import numpy.typing as npt

from usdsplat.core import quaternion
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import FormatError
from usdsplat.core.sh import coefficient_count
from usdsplat.formats.options import ReadOptions

BLOCK = 16384
"""Number of rows decoded at a time, so that temporaries stay in the cache."""

Namer = Callable[[str, int], str]
"""Function (field of the cloud, flat column) -> the file's name of that property."""


def blocks(count: int) -> Iterator[slice]:
    """Yield rows 0 to `count` in slices of `BLOCK`."""
    for start in range(0, count, BLOCK):
        yield slice(start, min(start + BLOCK, count))


def _nobody(_rows: int) -> None:
    pass


def threads() -> ThreadPoolExecutor:
    """Return a pool of one thread per processor, at most 8: memory bandwidth limits more."""
    return ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1))


def in_parallel(
    count: int,
    work: Callable[[slice], None],
    *,
    rows: int = BLOCK,
    told: Callable[[int], None] = _nobody,
) -> None:
    """Call `work` for each block of rows 0 to `count`, on all processors.

    NumPy's loops release the GIL, so threads run in parallel. `told` is called in the caller's
    thread with the number of finished rows.

    Raises:
        Exception: The first that `work` raised, in the order of the rows.
    """
    pieces = [slice(start, min(start + rows, count)) for start in range(0, count, rows)]
    with threads() as workers:
        for piece, _ in zip(pieces, workers.map(work, pieces), strict=True):
            told(piece.stop)


def _field_name(field: str, _column: int) -> str:
    return field


class CloudBuilder:
    """A cloud under construction; any thread may fill and settle rows, in any order.

    Create it only after checking that the file is long enough for `count` splats: a header alone
    must not cause an allocation.
    """

    def __init__(self, source: str, count: int, degree: int, how: ReadOptions) -> None:
        self._source = source
        self._drop = how.drop_nonfinite
        self._zero = np.zeros(count, bool)
        self._nonfinite = np.zeros(count, bool)
        self.positions = how.empty((count, 3))
        self.scales = how.empty((count, 3))
        self.rotations = how.empty((count, 4))
        self.opacities = how.empty((count,))
        self.sh = how.empty((count, coefficient_count(degree), 3))

    def settle(self, rows: slice, name: Namer = _field_name) -> None:
        """Check that filled rows are finite and make their rotations unit quaternions.

        Raises:
            FormatError: Naming, by `name`, the first property and row that is not finite, unless
                such splats are to be dropped.
        """
        for field in ("positions", "scales", "rotations", "opacities", "sh"):
            values = getattr(self, field)[rows]
            finite = np.isfinite(values)
            if not finite.all():
                flat = finite.reshape(len(values), -1)
                if not self._drop:
                    raise self._not_finite(field, rows, flat, name)
                self._nonfinite[rows] |= ~flat.all(axis=1)
        quaternions = self.rotations[rows]
        with np.errstate(invalid="ignore"):  # rows that are not finite are dropped in `cloud`
            self._zero[rows] = ~quaternions.any(axis=1)
            quaternions[:] = quaternion.normalize(quaternions)

    def settle_linear(self, rows: slice, name: Namer = _field_name) -> None:
        """Settle rows of a format that stores linear scales, which may therefore be negative.

        A splat with a negative scale is treated like one with a number that is not finite.

        Raises:
            FormatError: As for `settle`, and for the first negative scale.
        """
        scales = self.scales[rows]
        negative = scales < 0
        if negative.any():
            if not self._drop:
                row, column = np.argwhere(negative)[0]
                where = f"{self._source}: {name('scales', int(column))} of splat {rows.start + row}"
                raise FormatError(where, f"{scales[row, column]}", "a number that is not negative")
            scales[negative] = np.nan
        self.settle(rows, name)

    def cloud(self) -> tuple[SplatCloud, tuple[str, ...]]:
        """Return the cloud without the splats that cannot be drawn, and notes on those."""
        kinds = {"their rotation is zero": self._zero & ~self._nonfinite}
        kinds["they contain a number that is not finite"] = self._nonfinite
        counts = {why: int(np.count_nonzero(rows)) for why, rows in kinds.items()}
        kept = ~(self._zero | self._nonfinite) if any(counts.values()) else slice(None)  # no copy
        cloud = SplatCloud(
            positions=self.positions[kept],
            scales=self.scales[kept],
            rotations=self.rotations[kept],
            opacities=self.opacities[kept],
            sh=self.sh[kept],
        )
        return cloud, tuple(f"splats dropped because {why}: {n}" for why, n in counts.items() if n)

    def _not_finite(
        self, field: str, rows: slice, finite: npt.NDArray[np.bool_], name: Namer
    ) -> FormatError:
        """Return an error for the first number that is not finite; `finite` is for `rows`."""
        row = int(np.argmin(finite.all(axis=1)))
        column = int(np.argmin(finite[row]))
        found = getattr(self, field)[rows].reshape(len(finite), -1)[row, column]
        where = f"{self._source}: {name(field, column)} of splat {rows.start + row}"
        return FormatError(where, f"{found}", "a finite number")
