"""What a fused picture draws: fields, nodes of splat trees, and the values of a view."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.kernels.cuda.frame import project
from usdsplat.kernels.project import BLOCK


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FrameGroup:
    """Consecutive instances of one field in drawing order."""

    splats: tuple[Any, ...]
    """Arrays of the device, see `load`: positions first, rows last."""
    is_packed: bool
    boxes: Any
    """Bounds of the field's blocks, shape (blocks, 8) f32; empty if blocks are not culled."""
    instances: int
    degree: int
    """Degree of the harmonics that are evaluated."""

    @property
    def count(self) -> int:
        """Splats of an instance."""
        return int(self.splats[0].shape[0])

    @property
    def blocks(self) -> int:
        """Blocks of an instance."""
        return -(-self.count // BLOCK)

    @property
    def parts(self) -> int:
        """CUDA blocks of an instance."""
        return -(-self.count // project.PART)

    @property
    def all_blocks(self) -> int:
        """Blocks of all instances."""
        return self.instances * self.blocks

    @property
    def all_parts(self) -> int:
        """CUDA blocks of all instances."""
        return self.instances * self.parts

    @property
    def key(self) -> tuple[Any, ...]:
        """What recorded launches depend on."""
        arrays = tuple(id(array) for array in self.splats)
        return arrays, id(self.boxes), self.instances, self.degree


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FrameNodes:
    """Consecutive nodes of splat trees in drawing order. `FrameView.parts` has their parts, so that
    other nodes need no new launches."""

    splats: tuple[Any, ...]
    """Arrays of a `NodePool`."""
    instances: int
    """Number of matrices; unused ones may follow."""
    all_parts: int
    """Number of rows of `FrameView.parts`; those without splats may follow."""
    degree: int
    """Degree of the harmonics that are evaluated."""
    all_blocks = 0
    """Nodes have no bounds of blocks."""

    @property
    def key(self) -> tuple[Any, ...]:
        """What recorded launches depend on."""
        return (
            tuple(id(array) for array in self.splats),
            self.all_parts,
            self.instances,
            self.degree,
        )


NO_PARTS = np.zeros((1, 4), np.int32)
"""`FrameView.parts` of a picture without nodes."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FrameView:
    """Values that change from picture to picture; arrays of the host."""

    cameras: npt.NDArray[Any]
    """A CAMERA for each group."""
    matrices: npt.NDArray[np.float64]
    """Local to camera for each instance, shape (m, 3, 4)."""
    sights: npt.NDArray[np.float64]
    """Affine maps to view directions, see `radiance`, shape (m, 3, 4)."""
    conversions: npt.NDArray[np.float32]
    """Colour conversion of each group, shape (groups, 14); the last number says whether colours are
    converted."""
    grid: npt.NDArray[Any]
    """The GRID record of the data window."""
    parts: npt.NDArray[np.int32] = field(default_factory=lambda: NO_PARTS)
    """Parts of the nodes of all `FrameNodes`, one after another, shape (k, 4): first splat in
    memory, number of splats, instance within the `FrameNodes`, weight in 1 / `fading.WHOLE`."""

    @property
    def arrays(self) -> tuple[npt.NDArray[Any], ...]:
        """Return all arrays, in a fixed order."""
        return self.cameras, self.matrices, self.sights, self.conversions, self.grid, self.parts
