"""`SplatCloud`, the in-memory form of every capture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]

SH_DEGREES = {1: 0, 4: 1, 9: 2, 16: 3, 25: 4}
"""Coefficients per channel -> degree of the spherical harmonics."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SplatCloud:
    """Gaussian splats as parallel arrays; row i of every array is splat i.

    Values are physical, never encoded: readers undo logits, logarithms and quantisation, so other
    code does not depend on the file format. Shapes and dtypes are checked here; values are the
    responsibility of the reader.

    Raises:
        ValueError: If an array has another shape or dtype than declared.
    """

    positions: F32
    """Centres [scene unit], shape (n, 3)."""
    scales: F32
    """Standard deviations along the local axes [scene unit], shape (n, 3), >= 0."""
    rotations: F32
    """Unit quaternions, local axes to object, order (w, x, y, z), shape (n, 4)."""
    opacities: F32
    """Peak opacity [0..1], shape (n,)."""
    sh: F32
    """Radiance coefficients in 3DGS's basis and signs, shape (n, (degree + 1)**2, 3)."""
    ids: I64 | None = None
    """Ids that survive reordering, shape (n,); None if the id of a splat is its row."""
    velocities: F32 | None = None
    """Velocities [scene unit / s], shape (n, 3); None if the cloud does not move."""

    def __post_init__(self) -> None:
        n = len(self.positions)
        bands = self.sh.shape[1] if self.sh.ndim == 3 else -1
        if bands not in SH_DEGREES:
            raise ValueError(
                f"SplatCloud.sh: found shape {self.sh.shape}, "
                "expected (n, k, 3) with k one of 1, 4, 9, 16, 25"
            )
        wanted = {
            "positions": ((n, 3), np.float32),
            "scales": ((n, 3), np.float32),
            "rotations": ((n, 4), np.float32),
            "opacities": ((n,), np.float32),
            "sh": ((n, bands, 3), np.float32),
            "ids": ((n,), np.int64),
            "velocities": ((n, 3), np.float32),
        }
        for name, (shape, dtype) in wanted.items():
            array = getattr(self, name)
            if array is None and name in ("ids", "velocities"):
                continue
            if array.shape != shape or array.dtype != dtype:
                raise ValueError(
                    f"SplatCloud.{name}: found {array.dtype}{array.shape}, "
                    f"expected {np.dtype(dtype)}{shape}"
                )

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def sh_degree(self) -> int:
        """Degree of the harmonics, 0 to 4."""
        return SH_DEGREES[self.sh.shape[1]]
