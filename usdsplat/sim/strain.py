"""Estimate the deformation of space around pushed splats from their neighbours."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, I64
from usdsplat.kernels.device import Device
from usdsplat.sim.gradients import LocalGradients
from usdsplat.sim.neighbors import nearest
from usdsplat.sim.rows import differ, largest
from usdsplat.sim.state import FREE, State

Mask: TypeAlias = npt.NDArray[np.bool_]

NEIGHBORS = 12
"""Number of neighbours at rest that a deformation is estimated from."""
OFF = 1e-3
"""Distance from the target position beyond which a splat counts as pushed, as a fraction of its
largest standard deviation."""


class Strain:
    """Strain of one field.

    Args:
        device: Runs the kernels.
        is_fixed: Whether rest positions never change, so that neighbours are found only once.
    """

    def __init__(self, device: Device, *, is_fixed: bool) -> None:
        self._device, self._is_fixed = device, is_fixed
        self._all: LocalGradients | None = None

    def add(self, state: State, wanted: F32, gradient: F32 | None, normals: F32) -> F32 | None:
        """Return the gradient of the deformation from rest to where splats are.

        Args:
            state: The splats; flying ones are left out.
            wanted: Target positions [unit], shape (n, 3).
            gradient: Gradient of the deformation from rest to there, shape (n, 3, 3), changed in
                place; None without any.
            normals: Normals at rest, shape (n, 3).

        Returns:
            `gradient`, or a new array; None if nothing is deformed.
        """
        off = largest(np.abs(state.positions - wanted))
        pushed = (off > OFF * largest(state.rest_scales)) & ((state.flags & FREE) == 0)
        if gradient is None:
            if not pushed.any() and not self._was_deformed(state):
                return None
            gradient = np.empty((len(state), 3, 3), np.float32)
            gradient[:] = np.eye(3, dtype=np.float32)
        if not pushed.any():
            return gradient
        if self._is_fixed:
            self._measure_all(state, pushed, gradient, normals)
        else:
            self._measure_some(state, pushed, gradient, normals)
        return gradient

    def _was_deformed(self, state: State) -> bool:
        """Return whether shapes differ from rest, so that they must be reset."""
        if not np.array_equal(state.scales, state.rest_scales):
            return True
        now, rest = state.rotations, state.rest_rotations
        return bool((differ(now, rest) & differ(now, -rest)).any())

    def _measure_all(self, state: State, pushed: Mask, gradient: F32, normals: F32) -> None:
        """Measure all splats, with cached neighbours."""
        if self._all is None:
            rest = state.rest_positions.copy()
            found, _ = nearest(self._device, rest, rest, NEIGHBORS + 1)
            self._all = LocalGradients.of(self._device, rest, _others(found), normals)
        chosen = pushed.copy()
        chosen[_beside(state, pushed, self._all.neighbours[pushed])] = True
        self._all.measure(
            self._device, state.positions, gradient, sizes=largest(state.rest_scales),
            rows=chosen.astype(np.uint8),
        )  # fmt: skip

    def _measure_some(self, state: State, pushed: Mask, gradient: F32, normals: F32) -> None:
        """Measure pushed splats and those beside them, with neighbours found now."""
        rest, rows = state.rest_positions, np.flatnonzero(pushed)
        found = _others(nearest(self._device, rest, rest[rows], NEIGHBORS + 1)[0])
        others = _beside(state, pushed, found)
        beside = _others(nearest(self._device, rest, rest[others], NEIGHBORS + 1)[0])
        rows, found = np.concatenate([rows, others]), np.concatenate([found, beside])
        used = np.unique(np.concatenate([rows, found[found >= 0]]))
        place = np.full(len(rest) + 1, -1, np.int32)
        place[used] = np.arange(len(used), dtype=np.int32)
        here = place[rows]
        neighbours = np.full((len(used), NEIGHBORS), -1, np.int32)
        neighbours[here] = place[found]  # place[-1] is always -1
        local = LocalGradients.of(self._device, rest[used], neighbours, normals[used])
        out = np.empty((len(used), 3, 3), np.float32)
        chosen = np.zeros(len(used), np.uint8)
        chosen[here] = 1
        local.measure(
            self._device, state.positions[used], out, sizes=largest(state.rest_scales[used]),
            rows=chosen,
        )  # fmt: skip
        gradient[rows] = out[here]


def _beside(state: State, pushed: Mask, found: I32) -> I64:
    """Return the neighbours of pushed splats that are neither pushed nor flying, ascending, shape
    (m,)."""
    others = np.unique(found[found >= 0])
    return others[~pushed[others] & ((state.flags[others] & FREE) == 0)]


def _others(found: np.ndarray) -> np.ndarray:
    """Return the neighbours without the splat itself, which comes first."""
    return np.ascontiguousarray(found[:, 1:])
