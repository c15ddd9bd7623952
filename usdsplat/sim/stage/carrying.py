"""Frames of a simulation in the stage's space, for a field that moves under it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from usdsplat.core import edit
from usdsplat.core.cloud import F32, F64
from usdsplat.sim.state import Frame, State

SHOWN = "carrying:rotations"
"""In `State.memory`: quaternions of the last frame in the field's space, float32, shape (n, 4)."""
_RIGID = 1e-9


def carried_arrays(matrices: Iterable[F64]) -> frozenset[str]:
    """The arrays of a cloud that change by any of these matrices, shape (4, 4)."""
    found: set[str] = set()
    for matrix in matrices:
        linear = matrix[:3, :3]
        if not np.array_equal(matrix, np.eye(4)):
            found.add("positions")
        if np.abs(linear - np.eye(3)).max() > _RIGID:
            found |= {"rotations", "sh"}
        if np.abs(linear.T @ linear - np.eye(3)).max() > _RIGID:
            found.add("scales")
    return frozenset(found)


def carried(frame: Frame, matrix: F64, state: State, arrays: frozenset[str]) -> Frame:
    """A frame in the field's space.

    Args:
        frame: In the simulation's.
        matrix: To there from the field's, shape (4, 4).
        state: Whose frame it is. It remembers the quaternions, of whose two signs each frame takes
            the one nearer to the last frame's, so that they may be interpolated.
        arrays: Those that `carried_arrays` names for all frames; others are left alone.
    """
    cloud = frame.cloud
    moved = edit.transform(cloud, np.linalg.inv(matrix))
    kept = {name: getattr(cloud, name) for name in ("rotations", "scales", "sh")}
    moved = replace(moved, **{name: each for name, each in kept.items() if name not in arrays})
    if "rotations" in arrays:
        last: F32 = state.memory.get(SHOWN, cloud.rotations)
        away = np.einsum("ni,ni->n", moved.rotations, last) < 0
        turned = np.where(away[:, None], -moved.rotations, moved.rotations)
        state.memory[SHOWN] = turned
        moved = replace(moved, rotations=turned)
    return replace(frame, cloud=moved)
