"""Frames of one field on their way to the layer, kept on disk instead of in memory.

A frame is held back until the next one arrives, because its velocities are those from it to the
next. Also, harmonics must be written at the last frame before they change. Otherwise USD would
interpolate the change over all frames since their last sample.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from usdsplat import schema
from usdsplat.core.cloud import F32, I64, SplatCloud
from usdsplat.sim.arrays_file import load_arrays, save_arrays
from usdsplat.sim.rows import differ, largest
from usdsplat.sim.stage.radiance import Key
from usdsplat.sim.state import Frame

Array = npt.NDArray[Any]
Bool = npt.NDArray[np.bool_]
Rows: TypeAlias = I64 | None

TURNED = math.radians(5.0)
"""Rotation between two frames above which the box of a splat covers every direction."""
_CLOUD = ("positions", "rotations", "scales", "opacities")


@dataclass(frozen=True, slots=True, kw_only=True)
class SpoolOptions:
    """Arrays of a field that a spool keeps, and at what rate."""

    arrays: tuple[str, ...]
    """Arrays of the cloud, except harmonics."""
    harmonics: bool
    """Whether harmonics change."""
    is_whole: bool
    """Whether harmonics are needed even if they do not change, because the layer holds the whole
    field."""
    rate_sh: int
    """See `BakeParameters.rate_sh`."""
    epoch: int
    """Frames of an epoch."""
    is_fixed: bool
    """Whether all frames have the same splats."""
    velocities: bool
    pattern: bool
    slack: float
    """See `schema.compute_extent`."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Pending:
    """The frame that waits for the next one."""

    index: int
    frame: Frame
    is_key: bool
    """Whether its harmonics are written."""
    is_natural: bool
    """Whether its harmonics would be written if no epoch started here."""
    turned: Bool
    """Splats that rotated since the frame before, shape (n,)."""
    born: Bool | None
    """Splats that were not in the frame before, shape (n,)."""


class Spool:
    """Frames of one field."""

    def __init__(self, folder: Path, name: str, keeping: SpoolOptions, rest: SplatCloud) -> None:
        self._rest = rest
        self._rest_box: F32 | None = None
        self._folder = folder
        self._name = name
        self._keeping = keeping
        self._key: Key | None = None
        self.pending: Pending | None = None

    @property
    def frames(self) -> int:
        """Number of frames received."""
        return 0 if self.pending is None else self.pending.index + 1

    def has_same(self, frame: Frame) -> bool:
        """Return whether a frame has the same splats as the capture: none was born and none died
        since the frame before."""
        if len(frame.cloud) != len(self._rest):
            return False
        before = self.pending
        return before is None or match(ids_of(before.frame), ids_of(frame)) is None

    def take(self, frame: Frame, rate: float) -> None:
        """Receive a frame, and spool the one before.

        Args:
            frame: The next frame.
            rate: Frames per second, from the distance to the one before.
        """
        index, before = self.frames, self.pending
        is_natural = self._is_changed(index, frame)
        turned, born = _none(frame), None
        if before is not None:
            rows = None if self._keeping.is_fixed else match(ids_of(before.frame), ids_of(frame))
            old, new = before.frame.cloud, frame.cloud
            now = _turned(old.rotations, new.rotations, rows)
            turned, left = _both(now, rows, len(new))
            if rows is not None:
                born = np.ones(len(new), np.bool_)
                born[rows[rows >= 0]] = False
            is_key = before.is_key or (is_natural and self._keeping.rate_sh < 0)
            self._write(
                replace(before, is_key=is_key, turned=before.turned | left),
                forward(old.positions, new.positions, rows, rate),
            )
        is_first = index % self._keeping.epoch == 0
        self.pending = Pending(
            index=index,
            frame=frame,
            is_key=is_natural or is_first,
            is_natural=is_natural,
            turned=turned,
            born=born,
        )
        if self._keeping.harmonics and (is_natural or is_first):
            self._key = Key.of(frame.cloud)

    def finish(self) -> None:
        """Spool the last frame, with the solver's velocities. Its harmonics are written, because
        otherwise those of the last key would be held to the end."""
        if self.pending is not None:
            last = replace(self.pending, is_key=self.pending.is_key or self._keeping.harmonics)
            self._write(last, last.frame.cloud.velocities)

    def read(self, index: int) -> dict[str, Array]:
        """Return the arrays of a frame, mapped."""
        return load_arrays(self._path(index), mapped=True, checked=False)[0]

    def closing(self) -> Frame:
        """Return the pending frame."""
        assert self.pending is not None
        return self.pending.frame

    def box(self) -> F32:
        """Return the box around the pending frame, shape (2, 3)."""
        assert self.pending is not None
        return self._box(self.pending.frame.cloud, self.pending.turned)

    def forget(self, before: int) -> None:
        """Remove the frames before an index."""
        for path in self._folder.glob(f"{self._name}.*.frame"):
            if int(path.name.split(".")[-2]) < before:
                path.unlink()

    def forget_from(self, first: int) -> None:
        """Remove the frames from an index on; where that fails, they are written again."""
        for path in self._folder.glob(f"{self._name}.*.frame"):
            if int(path.name.split(".")[-2]) >= first:
                with suppress(OSError):
                    path.unlink()

    def arrays(self) -> dict[str, Array]:
        """Return the arrays that `restore` needs."""
        pending = self.pending
        if pending is None:
            return {}
        cloud = pending.frame.cloud
        arrays: dict[str, Array] = {
            "uv": pending.frame.uv,
            "births": pending.frame.births,
            "turned": pending.turned,
            "marks": np.array([pending.index, pending.is_key, pending.is_natural], np.int64),
            "time": np.array(pending.frame.time),
        }
        arrays |= {name: getattr(cloud, name) for name in (*_CLOUD, "sh", "ids", "velocities")}
        arrays |= {} if pending.born is None else {"born": pending.born}
        arrays |= {} if self._key is None else self._key.arrays()
        return {name: array for name, array in arrays.items() if array is not None}

    def restore(self, arrays: Mapping[str, Array]) -> None:
        """Continue from the result of `arrays`."""
        cloud = SplatCloud(
            positions=arrays["positions"],
            rotations=arrays["rotations"],
            scales=arrays["scales"],
            opacities=arrays["opacities"],
            sh=arrays["sh"],
            ids=arrays["ids"],
            velocities=arrays.get("velocities"),
        )
        index, is_key, is_natural = arrays["marks"].tolist()
        self.pending = Pending(
            index=index,
            frame=Frame(
                time=float(arrays["time"]), cloud=cloud, uv=arrays["uv"], births=arrays["births"]
            ),
            is_key=bool(is_key),
            is_natural=bool(is_natural),
            turned=arrays["turned"],
            born=arrays.get("born"),
        )
        self._key = Key.restored(arrays)

    def _is_changed(self, index: int, frame: Frame) -> bool:
        """Return whether the harmonics of a frame must be written."""
        if not self._keeping.harmonics:
            return False
        if self._keeping.rate_sh >= 0:
            return index % max(self._keeping.rate_sh, 1) == 0
        if self._key is None:
            return True
        rows = None if self._keeping.is_fixed else match(self._key.ids, ids_of(frame))
        return self._key.is_left(frame.cloud, rows)

    def _write(self, done: Pending, velocities: F32 | None) -> None:
        """Spool a complete frame."""
        keeping, cloud = self._keeping, done.frame.cloud
        is_first = done.index % keeping.epoch == 0
        arrays: dict[str, Array] = {name: getattr(cloud, name) for name in keeping.arrays}
        arrays["box"] = self._box(cloud, done.turned)
        if keeping.velocities:
            still = np.zeros((len(cloud), 3), np.float32)
            arrays["velocities"] = still if velocities is None else velocities
        if keeping.pattern:
            arrays["uv"] = done.frame.uv
        if not keeping.is_fixed:
            arrays["ids"] = ids_of(done.frame)
            if done.born is not None and not is_first:
                arrays["born_sh"] = cloud.sh[done.born]
                arrays["born_ids"] = ids_of(done.frame)[done.born]
        if (done.is_key or is_first) and (keeping.harmonics or keeping.is_whole):
            arrays["sh"] = cloud.sh
        save_arrays(self._path(done.index), arrays, {"time": done.frame.time}, checked=False)

    def _box(self, cloud: SplatCloud, turned: Bool) -> F32:
        """Return the box around splats that are about to rotate, or just have.

        If few differ from the capture, it is the union of the capture's box and theirs.
        """
        if self._keeping.is_fixed:
            moved = turned.copy()
            for name in ("positions", "rotations", "scales"):
                new, old = getattr(cloud, name), getattr(self._rest, name)
                if new is not old:
                    moved |= differ(new, old)
            if 2 * np.count_nonzero(moved) < len(cloud):
                if self._rest_box is None:
                    none = np.zeros(len(cloud), np.bool_)
                    self._rest_box = _box(self._rest, none, self._keeping.slack)
                if not moved.any():
                    return self._rest_box
                some = _rows_of(cloud, np.flatnonzero(moved))
                return union(self._rest_box, _box(some, turned[moved], self._keeping.slack))
        return _box(cloud, turned, self._keeping.slack)

    def _path(self, index: int) -> Path:
        return self._folder / f"{self._name}.{index:06d}.frame"


def match(first: I64, second: I64) -> Rows:
    """Return the rows of `second` with the ids of `first`, -1 where an id is missing; both ascend.

    Returns:
        Shape (len(first),), or None where they are the same, row by row.
    """
    if first is second or np.array_equal(first, second):
        return None
    if not len(second):
        return np.full(len(first), -1, np.int64)
    rows = np.minimum(np.searchsorted(second, first), len(second) - 1)
    return np.where(second[rows] == first, rows, -1)


def forward(old: F32, new: F32, rows: Rows, rate: float) -> F32:
    """Return the velocities from one frame to the next [unit/s]; 0 for splats that the next one
    lacks."""
    return np.asarray((_then(old, new, rows) - old) * np.float32(rate))


def _then(old: F32, new: F32, rows: Rows) -> F32:
    """Return the values at the next frame in the old rows; the old ones for splats that it
    lacks."""
    if rows is None:
        return new
    values = old.copy()
    values[rows >= 0] = new[rows[rows >= 0]]
    return values


def _turned(old: F32, new: F32, rows: Rows) -> Bool:
    """Return which of the old splats rotate by more than TURNED to the next frame, shape
    (len(old),)."""
    cosine = np.abs(np.einsum("ni,ni->n", old, _then(old, new, rows)))
    return np.asarray(cosine < math.cos(TURNED / 2))


def _both(now: Bool, rows: Rows, new: int) -> tuple[Bool, Bool]:
    """Return `now`, a mask of the old rows, as a mask of the new ones, followed by `now` itself."""
    if rows is None:
        return now, now
    later = np.zeros(new, np.bool_)
    later[rows[now & (rows >= 0)]] = True
    return later, now


def _none(frame: Frame) -> Bool:
    return np.zeros(len(frame.cloud), np.bool_)


def ids_of(frame: Frame) -> I64:
    """Return identities, shape (n,)."""
    ids = frame.cloud.ids
    assert ids is not None  # frames have ids
    return ids


def union(first: F32, second: F32 | None) -> F32:
    """Return the box around two boxes, shape (2, 3)."""
    if second is None:
        return first
    low, high = np.minimum(first[0], second[0]), np.maximum(first[1], second[1])
    return np.stack([low, high])


def _rows_of(cloud: SplatCloud, rows: I64) -> SplatCloud:
    """Return some of the splats, without colours."""
    return SplatCloud(
        positions=cloud.positions[rows],
        rotations=cloud.rotations[rows],
        scales=cloud.scales[rows],
        opacities=cloud.opacities[rows],
        sh=np.zeros((len(rows), 1, 3), np.float32),
    )


def _box(cloud: SplatCloud, turned: Bool, slack: float) -> F32:
    """Return the box around splats; rotating ones may have any orientation."""
    scales = cloud.scales
    if turned.any():
        scales = np.where(turned[:, None], largest(scales)[:, None], scales)
    turning = 2 * math.sin(TURNED / 4)
    return schema.compute_extent(replace(cloud, scales=scales), slack=slack + turning)
