"""Author samples as edits of the capture's arrays: only splats that differ from it are written.

An edit is relative to the capture, not to the frame before, so that frames can be read in any
order. A splat that was edited once stays edited to the end of its epoch, so that values do not
flicker around the tolerance.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Vt

from usdsplat.schema import tokens
from usdsplat.schema.vt import to_vt
from usdsplat.sim.stage.bake_dense import KINDS, common, stored
from usdsplat.sim.stage.epochs import Sample
from usdsplat.sim.stage.plan import Plan
from usdsplat.sim.stage.sample_layer import SampleLayer

Array = npt.NDArray[Any]
Bool = npt.NDArray[np.bool_]


def changed(array: str, new: Array, old: Array, epsilon: float) -> Bool:
    """Return which splats differ from the capture, shape (n,).

    Args:
        array: Name of the cloud's array.
        new: Values now.
        old: Values of the capture.
        epsilon: Tolerance: positions [unit], rotations [radian], scales relative, others absolute.
    """
    if array == "positions":
        return np.asarray(_length(new - old) > epsilon)
    if array == "rotations":
        # chords instead of arc cosines are exact for small angles; a quaternion's sign is ignored
        chord = np.minimum(_length(new - old), _length(new + old))
        return np.asarray(chord > 2 * math.sin(epsilon / 4))
    if array == "scales":
        return np.asarray((np.abs(new - old) > epsilon * np.abs(old)).any(axis=1))
    over = np.abs(new - old) > epsilon
    return np.asarray(over.reshape(len(over), -1).any(axis=1))


class EditAuthor:
    """Author of one field."""

    def __init__(self, plan: Plan, first: float) -> None:
        self._plan = plan
        self._first = first
        self._edited: dict[str, Bool] = {}

    def write(self, part: SampleLayer, sample: Sample) -> None:
        """Add a sample to a part."""
        plan = self._plan
        part.prim(plan.path)
        if sample.is_new:
            self._edited = {array: np.zeros(len(plan.rest), np.bool_) for array in plan.names}
        for array, name in plan.names.items():
            new = getattr(sample, array)
            if new is None:
                continue
            edited = self._edited[array]
            edited |= changed(array, new, getattr(plan.rest, array), plan.epsilon[array])
            value = _edit(name, new, np.flatnonzero(edited))
            kind = KINDS[name][0]
            part.sample(plan.path, name, kind, value, sample.time)
            if sample.time == self._first:
                part.sample(plan.path, name, kind, value, tokens.LONG_AGO)
        common(part, plan, sample)


def _edit(name: str, value: Array, rows: npt.NDArray[np.int64]) -> Any:
    """Write some rows of an array as an array edit."""
    vt = KINDS[name][1]
    chosen = stored(name, value[rows])
    if value.ndim == 3:
        width = value.shape[1]
        rows = (rows[:, None] * width + np.arange(width)).reshape(-1)
        chosen = chosen.reshape(-1, 3)
    builder = getattr(Vt, f"{vt.__name__}EditBuilder")()
    write = builder.Write
    for row, each in zip(rows.tolist(), to_vt(np.ascontiguousarray(chosen), vt), strict=True):
        write(each, row)
    return builder.FinalizeAndReset()


def _length(rows: Array) -> Array:
    return np.asarray(np.sqrt(np.einsum("ni,ni->n", rows, rows)))
