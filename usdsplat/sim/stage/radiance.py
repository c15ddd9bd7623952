"""Decide when harmonics need a sample: linear interpolation suffices while splats hardly rotate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I64, SplatCloud
from usdsplat.core.sh import C0

TURN = math.radians(5.0)
"""Largest rotation between samples. Linear interpolation errs by l² θ² / 8: 0.9 % at degree 3."""
STEP = 1 / 255 / C0
"""Largest change of colour between samples, in coefficients of degree 0."""


@dataclass(frozen=True, slots=True, eq=False)
class Key:
    """Rotations and colours of splats when their harmonics were last written."""

    ids: I64
    rotations: F32
    colors: F32
    """Coefficients of degree 0 and the norm of each higher degree, which rotation does not change.
    Shape (n, degree + 1, 3)."""

    @classmethod
    def of(cls, cloud: SplatCloud) -> Key:
        """Return the key of a cloud with ids."""
        assert cloud.ids is not None
        return cls(cloud.ids, cloud.rotations, _colors(cloud.sh))

    def is_left(self, cloud: SplatCloud, rows: npt.NDArray[np.int64] | None) -> bool:
        """Return whether any splat has rotated or changed colour since.

        Args:
            cloud: The splats now.
            rows: Their rows in the cloud, -1 for those that died; None if rows are the same.
        """
        kept = slice(None) if rows is None else rows >= 0
        now = slice(None) if rows is None else rows[rows >= 0]
        turns = np.einsum("ni,ni->n", self.rotations[kept], cloud.rotations[now])
        if np.min(np.abs(turns), initial=1.0) < math.cos(TURN / 2):
            return True
        change = _colors(cloud.sh)[now] - self.colors[kept]
        return bool(max(change.max(initial=0), -change.min(initial=0)) > STEP)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return all arrays by name."""
        return {"key_ids": self.ids, "key_rotations": self.rotations, "key_colors": self.colors}

    @classmethod
    def restored(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> Key | None:
        """Return the key that `arrays` gave, or None if it is missing."""
        if "key_ids" not in arrays:
            return None
        return cls(arrays["key_ids"], arrays["key_rotations"], arrays["key_colors"])


def _colors(sh: F32) -> F32:
    degree = math.isqrt(sh.shape[1]) - 1
    out = np.empty((len(sh), degree + 1, 3), np.float32)
    out[:, 0] = sh[:, 0]
    for band in range(1, degree + 1):
        part = sh[:, band**2 : (band + 1) ** 2]
        out[:, band] = np.sqrt(np.einsum("nkc,nkc->nc", part, part))
    return out
