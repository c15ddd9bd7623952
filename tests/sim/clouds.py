"""Points on surfaces with known normals and spacing."""

from __future__ import annotations

import numpy as np

from usdsplat.kernels.points.nearest import nearest


def sphere(n, seed=0):
    """White noise on the unit sphere, shape (n, 3)."""
    points = np.random.default_rng(seed).normal(size=(n, 3))
    return (points / np.linalg.norm(points, axis=1)[:, None]).astype(np.float32)


def even_sphere(n):
    """A spiral of even spacing on the unit sphere (Fibonacci's), shape (n, 3)."""
    i = np.arange(n) + 0.5
    polar, turn = np.arccos(1 - 2 * i / n), np.pi * (1 + 5**0.5) * i
    ring = np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar)], axis=1)
    return np.concatenate([ring, np.cos(polar)[:, None]], axis=1).astype(np.float32)


def unevenness(device, points):
    """Deviation over mean of the distance to the nearest other point."""
    distance = nearest(device, points, points, 2)[1][:, 1]
    return distance.std() / distance.mean()
