"""Samples of an epoch: the same splats in the same rows at each of them.

USD interpolates arrays of equal length and holds others, so that counts may change only between
epochs. Within an epoch, every splat that exists at any of its frames, or at the first of the next,
has a row: before birth at the place of birth, without size or opacity; after death at its last
place, without opacity. Just before an epoch ends there is a sample with the old rows and the values
of the next frame, so that only the number of rows changes there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I64
from usdsplat.sim.stage.spool import Spool, union
from usdsplat.sim.state import Frame

Array = npt.NDArray[Any]

UNBORN_SCALE = np.float32(1e-6)
"""Size of splats that are not born yet [unit]."""
BEFORE = 2.0**-14
"""Distance of an epoch's last sample from its end, in frames."""
_VALUES = ("positions", "rotations", "scales", "opacities")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Sample:
    """Values that are written at one time."""

    time: float
    positions: F32 | None
    """Positions; None for each array that is not written."""
    rotations: F32 | None
    scales: F32 | None
    opacities: F32 | None
    box: F32
    """Extent from this sample to the next, shape (2, 3)."""
    sh: F32 | None
    """Harmonics; None where they are not written."""
    velocities: F32 | None
    uv: F32 | None
    ids: I64 | None
    """Ids, at both ends of an epoch; None elsewhere, and where the population is fixed."""
    is_new: bool
    """Whether an epoch starts here."""


def samples(
    spool: Spool, frames: range, times: Sequence[float], *, is_closed: bool
) -> Iterator[Sample]:
    """Iterate over the samples of an epoch.

    Args:
        spool: Holds the frames.
        frames: Indices of the epoch's frames.
        times: Times of all frames [time code].
        is_closed: Whether another epoch follows; the spool's pending frame is its first.
    """
    if not len(frames):
        return
    following = spool.box() if is_closed else None
    found = spool.read(frames[0])
    closing = _arrays(spool.closing()) if is_closed else None
    rows = _Rows.of(spool, frames, closing) if "ids" in found else None
    for index in frames:
        arrays = found
        if index != frames[-1]:
            found = spool.read(index + 1)
        box = union(arrays["box"], following if index == frames[-1] else found["box"])
        held = arrays if rows is None else rows.moved(arrays)
        yield _sample(times[index], held, box, is_new=index == frames[0], is_end=False)
    if rows is not None and closing is not None:
        end, step = times[frames[-1] + 1], times[frames[-1] + 1] - times[frames[-1]]
        assert following is not None
        held = rows.moved(closing)
        box = union(found["box"], following)
        yield _sample(end - BEFORE * step, held, box, is_new=False, is_end=True)


class _Rows:
    """Rows of an epoch, with the values of the last frame."""

    def __init__(self, ids: I64, values: dict[str, Array]) -> None:
        self._ids = ids
        self._values = values

    @classmethod
    def of(cls, spool: Spool, frames: range, closing: dict[str, Array] | None) -> _Rows:
        """Return rows with the values at which splats first appear, before birth."""
        ids = np.empty(0, np.int64) if closing is None else closing["ids"]
        for index in frames:
            found = spool.read(index)["ids"]
            ids = ids if np.array_equal(found, ids) else np.union1d(ids, found)
        values: dict[str, Array] = {"ids": ids}
        unseen = np.ones(len(ids), np.bool_)
        for index in frames:
            arrays = spool.read(index)
            at = np.searchsorted(ids, arrays["ids"])
            new = unseen[at]
            if index == frames[0] or new.any():
                _put(values, arrays, at, new, len(ids))
                if "born_sh" in arrays:
                    born = np.searchsorted(ids, arrays["born_ids"])
                    values["sh"][born] = arrays["born_sh"]
                unseen[at] = False
            if not unseen.any():
                break
        if closing is not None and unseen.any():
            at = np.searchsorted(ids, closing["ids"])
            kept = {name: array for name, array in closing.items() if name in values}
            _put(values, kept, at, unseen[at], len(ids))
        values["opacities"][:] = 0
        values["scales"][:] = UNBORN_SCALE
        return cls(ids, values)

    def moved(self, arrays: dict[str, Array]) -> dict[str, Array]:
        """Set the rows to another frame's values, and return all arrays.

        Values that the frame lacks stay, except that the opacity and velocity of splats that it
        lacks become 0. Harmonics are returned only if the frame has some.
        """
        said = {name: arrays[name] for name in self._values if name in arrays}
        if np.array_equal(said["ids"], self._ids):
            self._values |= said
        elif len(self._ids):
            near = np.minimum(np.searchsorted(self._ids, said["ids"]), len(self._ids) - 1)
            there = self._ids[near] == said["ids"]
            alive = near[there]
            for name, old in self._values.items():
                fades = name in ("opacities", "velocities")
                if name != "ids" and (fades or name in said):
                    value = np.zeros_like(old) if fades else old.copy()
                    value[alive] = said[name][there] if name in said else old[alive]
                    self._values[name] = value
        return {k: v for k, v in self._values.items() if k != "sh" or k in said}


def _put(values: dict[str, Array], arrays: dict[str, Array], at: Array, new: Array, n: int) -> None:
    """Set the rows of a frame's splats."""
    for name, array in arrays.items():
        if name in ("ids", "box", "born_sh", "born_ids"):
            continue
        if name not in values:
            values[name] = np.zeros((n, *array.shape[1:]), array.dtype)
        values[name][at[new]] = array[new]


def _arrays(frame: Frame) -> dict[str, Array]:
    """Return a frame that is not spooled yet; without velocities, which are not known yet."""
    cloud = frame.cloud
    assert cloud.ids is not None
    values = {name: getattr(cloud, name) for name in _VALUES}
    return {**values, "sh": cloud.sh, "ids": cloud.ids, "uv": frame.uv}


def _sample(
    time: float, arrays: dict[str, Array], box: F32, *, is_new: bool, is_end: bool
) -> Sample:
    return Sample(
        time=time,
        positions=arrays.get("positions"),
        rotations=arrays.get("rotations"),
        scales=arrays.get("scales"),
        opacities=arrays.get("opacities"),
        box=box,
        sh=arrays.get("sh"),
        velocities=arrays.get("velocities"),
        uv=arrays.get("uv"),
        ids=arrays.get("ids") if is_new or is_end else None,
        is_new=is_new,
    )
