"""Random rotations, mirrors and linear maps for property tests."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

SEEDS = st.integers(0, 2**32 - 1)


def quaternions(seed: int, count: int) -> np.ndarray:
    """Unit quaternions spread evenly over all rotations, float64, shape (count, 4)."""
    raw = np.random.default_rng(seed).normal(size=(count, 4))
    return raw / np.linalg.norm(raw, axis=1, keepdims=True)


def orthogonal(seed: int, determinant: int = 1) -> np.ndarray:
    """A random rotation, or a random mirroring for determinant -1, shape (3, 3)."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q if np.linalg.det(q) * determinant > 0 else -q


def directions(seed: int, count: int) -> np.ndarray:
    """Unit vectors, float64, shape (count, 3)."""
    raw = np.random.default_rng(seed).normal(size=(count, 3))
    return raw / np.linalg.norm(raw, axis=1, keepdims=True)
