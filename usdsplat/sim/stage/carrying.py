"""Transform frames from the simulation's space to a field that moves within it."""

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
    """Return the arrays of a cloud that any of these matrices change, shape (4, 4)."""
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
    """Return a frame in the field's space.

    Args:
        frame: The frame in the simulation's space.
        matrix: From the field's space to the simulation's, shape (4, 4).
        state: State of the frame. It keeps the last quaternions; each frame takes the sign nearer
            to them, so that they can be interpolated.
        arrays: The result of `carried_arrays` for all frames; others do not change.
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
