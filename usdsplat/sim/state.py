"""Particle state: every array that the solver changes and cannot compute again.

Rows are splats by ascending identity: first the capture's in their order, then the born ones.
Frames are written in this order without sorting.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I64, SplatCloud

U32: TypeAlias = npt.NDArray[np.uint32]

ALIVE, PINNED, BORN, FREE, DYING = (np.uint32(1 << bit) for bit in range(5))
"""Bits of `State.flags`: exists; never moves; born in the simulation; flies; is dying."""


@dataclass(slots=True, eq=False, kw_only=True)
class State:
    """State of n splats. All arrays may be replaced at once by arrays of another n."""

    positions: F32
    """Positions [unit], shape (n, 3)."""
    rotations: F32
    """Unit quaternions (w, x, y, z), shape (n, 4)."""
    scales: F32
    """[unit], shape (n, 3)."""
    opacities: F32
    """[0..1], shape (n,)."""
    sh: F32
    """Shape (n, k, 3); the same array as `rest_sh` until a splat turns or changes colour."""
    rest_positions: F32
    """Positions where splats were captured or born, moved by growth and redistribution, shape
    (n, 3)."""
    rest_rotations: F32
    rest_scales: F32
    rest_opacities: F32
    rest_sh: F32
    velocities: F32
    """[unit/s], shape (n, 3)."""
    support: F32
    """Radius of the neighbourhood h [unit], shape (n,)."""
    uv: F32
    """Pattern at each splat, shape (n, 2)."""
    weight: F32
    """Selection weight [0..1], shape (n,)."""
    ids: I64
    """Ascending, never reused, shape (n,); the capture's are its own or row numbers."""
    parents: I64
    """Identity of the parent, -1 for captured splats, shape (n,)."""
    births: F32
    """Time of birth since the simulation's start [s], shape (n,)."""
    flags: U32
    """Shape (n,)."""
    step: int = 0
    """Substeps since the simulation's start: the clock."""
    next_id: int = 0
    memory: dict[str, npt.NDArray[Any]] = field(default_factory=dict)
    """What stages keep for each splat, by "stage:name", first axis n; follows births and deaths."""
    globals: dict[str, npt.NDArray[Any]] = field(default_factory=dict)
    """What else stages keep to continue bit for bit, by "stage:name"."""

    @classmethod
    def of(cls, cloud: SplatCloud, selection: F32 | None = None) -> State:
        """Return the state of a capture at rest.

        Args:
            cloud: The capture; arrays that rarely change are not copied.
            selection: Weight of each splat, shape (n,); None selects all.
        """
        n = len(cloud)
        ids = np.arange(n, dtype=np.int64) if cloud.ids is None else cloud.ids
        still = np.zeros((n, 3), np.float32) if cloud.velocities is None else cloud.velocities
        return cls(
            positions=cloud.positions.copy(),
            rotations=cloud.rotations.copy(),
            scales=cloud.scales.copy(),
            opacities=cloud.opacities.copy(),
            sh=cloud.sh,
            rest_positions=cloud.positions.copy(),
            rest_rotations=cloud.rotations,
            rest_scales=cloud.scales,
            rest_opacities=cloud.opacities,
            rest_sh=cloud.sh,
            velocities=still.copy(),
            support=np.zeros(n, np.float32),
            uv=np.tile(np.array([1, 0], np.float32), (n, 1)),
            weight=np.ones(n, np.float32) if selection is None else selection.copy(),
            ids=ids,
            parents=np.full(n, -1, np.int64),
            births=np.zeros(n, np.float32),
            flags=np.full(n, ALIVE, np.uint32),
            next_id=int(ids.max(initial=-1)) + 1,
        )

    def __len__(self) -> int:
        return len(self.positions)

    def cloud(self) -> SplatCloud:
        """Return the splats; shares the state's arrays."""
        return SplatCloud(
            positions=self.positions,
            scales=self.scales,
            rotations=self.rotations,
            opacities=self.opacities,
            sh=self.sh,
            ids=self.ids,
            velocities=self.velocities,
        )

    def per_splat(self) -> Iterator[tuple[str, npt.NDArray[Any]]]:
        """Iterate over all arrays with a row for each splat, in a fixed order: fields, then
        `memory:` + key."""
        for name in ARRAYS:
            yield name, getattr(self, name)
        for key in sorted(self.memory):
            yield f"memory:{key}", self.memory[key]

    def replace_rows(self, arrays: dict[str, npt.NDArray[Any]]) -> None:
        """Replace all arrays of `per_splat`, by the same names."""
        for name, array in arrays.items():
            if name.startswith("memory:"):
                self.memory[name.removeprefix("memory:")] = array
            else:
                setattr(self, name, array)

    def digest(self) -> str:
        """Return SHA-256 over every bit of the state."""
        total = hashlib.sha256(f"{self.step} {self.next_id}".encode())
        others = ((f"globals:{key}", self.globals[key]) for key in sorted(self.globals))
        for name, array in (*self.per_splat(), *others):
            total.update(f"{name} {array.dtype} {array.shape}".encode())
            total.update(np.ascontiguousarray(array).view(np.uint8).reshape(-1).data)
        return total.hexdigest()


ARRAYS = (
    "positions", "rotations", "scales", "opacities", "sh",
    "rest_positions", "rest_rotations", "rest_scales", "rest_opacities", "rest_sh",
    "velocities", "support", "uv", "weight", "ids", "parents", "births", "flags",
)  # fmt: skip
"""Fields of `State` with a row for each splat."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Frame:
    """Splats of one frame; nothing changes its arrays afterwards."""

    time: float
    """Time [time code]."""
    cloud: SplatCloud
    """Splats with ids; `velocities` are the solver's."""
    uv: F32
    """Pattern, shape (n, 2)."""
    births: F32
    """Time of birth [s], shape (n,)."""
