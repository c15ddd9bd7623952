"""Write splats sorted along the Morton curve to files, and read ranges of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core import morton
from usdsplat.core.cloud import F64, I64, SplatCloud
from usdsplat.core.output import output_file, output_group
from usdsplat.core.sh import coefficient_count

KEYS, ROWS = ".keys", ".rows"
"""Suffixes of the two files of a run."""

_BLOCK = 1 << 16  # rows written at a time
_KEY = np.dtype("<u8")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Cube:
    """Cube whose octree orders the splats."""

    low: F64
    """Lower corner [unit], shape (3,)."""
    edge: float
    """[unit]"""


def row_type(degree: int) -> np.dtype[np.void]:
    """Return the record of a splat in a run: the arrays of a `SplatCloud` without ids and
    velocities."""
    sh = (coefficient_count(degree), 3)
    return np.dtype(
        [
            ("positions", "<f4", 3),
            ("scales", "<f4", 3),
            ("rotations", "<f4", 4),
            ("opacities", "<f4"),
            ("sh", "<f4", sh),
        ]
    )


def rows_of(cloud: SplatCloud) -> npt.NDArray[np.void]:
    """Return splats as records."""
    kind = row_type(cloud.sh_degree)
    rows = np.empty(len(cloud), kind)
    for name in kind.names or ():
        rows[name] = getattr(cloud, name)
    return rows


def cloud_of(rows: npt.NDArray[np.void]) -> SplatCloud:
    """Return records as splats."""
    names = rows.dtype.names or ()
    arrays: dict[str, Any] = {name: np.ascontiguousarray(rows[name], np.float32) for name in names}
    return SplatCloud(**arrays)


def write_run(path: Path, cloud: SplatCloud, cube: Cube) -> None:
    """Write splats sorted by their keys, those of equal keys in their order.

    Args:
        path: Path of the run without suffix.
        cloud: Finite splats.
        cube: The cube of all splats of the tree.

    Raises:
        OutputError: If the files cannot be written.
    """
    keys = morton.keys(cloud.positions, cube.low, cube.edge)
    order = np.argsort(keys, kind="stable")
    names = row_type(cloud.sh_degree).names or ()
    with output_group():
        with output_file(path.with_suffix(KEYS)) as output, output.open() as file:
            file.write(keys[order].astype(_KEY).data)
        with output_file(path.with_suffix(ROWS)) as output, output.open() as file:
            for first in range(0, len(order), _BLOCK):
                block = order[first : first + _BLOCK]
                rows = np.empty(len(block), row_type(cloud.sh_degree))
                for name in names:
                    rows[name] = getattr(cloud, name)[block]
                file.write(rows.view(np.uint8).data)


def has_run(path: Path) -> bool:
    """Return whether both files of a run exist."""
    return path.with_suffix(KEYS).is_file() and path.with_suffix(ROWS).is_file()


class Runs:
    """Runs in files. Splats of equal keys are ordered by run, then by row.

    Args:
        paths: Paths without suffixes, in the order of the inputs.
        degree: Degree of the harmonics of all runs.
    """

    def __init__(self, paths: Sequence[Path], degree: int) -> None:
        self._rows = [path.with_suffix(ROWS) for path in paths]
        self._keys = [path.with_suffix(KEYS) for path in paths]
        self._mapped: list[npt.NDArray[np.uint64]] = []
        self._type = row_type(degree)
        sizes = [path.stat().st_size // _KEY.itemsize for path in self._keys]
        self.counts: I64 = np.array(sizes, np.int64)
        """Number of splats of each run."""

    def below(self, edges: npt.NDArray[np.uint64]) -> I64:
        """Return the number of keys of each run that are below each edge, shape (r, e)."""
        if not self._mapped:
            self._mapped = [_map(path) for path in self._keys]
        return np.stack([np.searchsorted(keys, edges) for keys in self._mapped])

    def unmap(self) -> None:
        """Release the keys, which `below` maps: what it read of them counts as memory."""
        self._mapped = []

    def gather(self, first: I64, last: I64) -> SplatCloud:
        """Return rows `first` to `last` of each run, merged in the order of their keys."""
        used = [int(run) for run in np.flatnonzero(last > first)]
        ranges = [(run, int(first[run]), int(last[run])) for run in used]
        parts = [_read(self._rows[run], self._type, *rows) for run, *rows in ranges]
        if not parts:
            return cloud_of(np.empty(0, self._type))
        if len(parts) == 1:
            return cloud_of(parts[0])
        keys = np.concatenate([_read(self._keys[run], _KEY, *rows) for run, *rows in ranges])
        return cloud_of(np.concatenate(parts)[np.argsort(keys, kind="stable")])


def _read(path: Path, kind: np.dtype[Any], first: int, last: int) -> npt.NDArray[Any]:
    """Return some items of a file."""
    return np.fromfile(path, kind, last - first, offset=first * kind.itemsize)


def _map(path: Path) -> npt.NDArray[np.uint64]:
    """Map the keys of a run."""
    return np.memmap(path, _KEY, mode="r") if path.stat().st_size else np.empty(0, np.uint64)
