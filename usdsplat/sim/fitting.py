"""Fit the surface that a capture lies around to the neighbours of each splat."""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import F32, F64, I32

ROWS = 1 << 16
"""Splats that are fitted at once."""
ENOUGH = 6
"""Least number of neighbours for a fit."""


def heights(positions: F32, neighbors: I32) -> tuple[F32, F32]:
    """Return the height of each splat over the surface of its neighbours.

    The surface is a paraboloid of revolution along the normal of their plane, fitted by least
    squares. With a plane, all splats of a round capture
    would lie on the outer side.

    Args:
        positions: [unit], shape (n, 3).
        neighbors: Rows of the nearest others, -1 for none, shape (n, k).

    Returns:
        Heights along the normals [unit], shape (n,), and unit normals of any sign, shape (n, 3);
        zeros where there are fewer than 6 neighbours.
    """
    n = len(positions)
    out, normals = np.zeros(n, np.float32), np.zeros((n, 3), np.float32)
    for first in range(0, n, ROWS):
        rows = slice(first, first + ROWS)
        found, up = _fit(positions, positions[rows], neighbors[rows])
        out[rows], normals[rows] = found, up
    return out, normals


def _fit(positions: F32, own: F32, neighbors: I32) -> tuple[F64, F64]:
    there = neighbors >= 0
    apart = positions[neighbors].astype(np.float64) - own[:, None]
    apart[~there] = 0
    count = there.sum(axis=1)
    usable = (count >= ENOUGH) & np.isfinite(apart).all(axis=(1, 2))
    apart[~usable] = 0
    mean = apart.sum(axis=1) / np.maximum(count, 1)[:, None]
    about = np.where(there[..., None], apart - mean[:, None], 0)
    _, axes = np.linalg.eigh(about.swapaxes(1, 2) @ about)
    local = apart @ axes
    square = local[..., 1] ** 2 + local[..., 2] ** 2
    size = np.sqrt(square.sum(axis=1) / np.maximum(count, 1))
    usable &= size > 0
    size[~usable] = 1
    scaled = local / size[:, None, None]
    terms = np.stack(
        [there, scaled[..., 1], scaled[..., 2], square / (size * size)[:, None]], axis=-1
    )
    normal = terms.swapaxes(1, 2) @ terms + 1e-9 * np.eye(4)
    right = terms.swapaxes(1, 2) @ scaled[..., :1]
    foot = np.linalg.solve(normal, right)[:, 0, 0] * size
    return np.where(usable, -foot, 0), np.where(usable[:, None], axes[:, :, 0], 0)


def growth(before: F32, after: F32, neighbors: I32, limit: float) -> F32:
    """Return the factor by which the distance of each splat to its neighbours grew, shape (n,).

    Args:
        before, after: [unit], shape (n, 3).
        neighbors: Rows of `before`, -1 for none, shape (n, k).
        limit: Results are clamped to [1 / limit, limit]; 1 where there is no neighbour.
    """
    n = len(before)
    out = np.ones(n, np.float32)
    for first in range(0, n, ROWS):
        rows = slice(first, first + ROWS)
        there = neighbors[rows] >= 0
        lengths = []
        for points in (before, after):
            apart = points[neighbors[rows]].astype(np.float64) - points[rows, None]
            far = np.sqrt(np.einsum("nki,nki->nk", apart, apart))
            lengths.append(np.where(there, far, 0).sum(axis=1))
        old, new = lengths
        usable = np.isfinite(old) & np.isfinite(new) & (old > 0)
        ratio = np.divide(new, old, out=np.ones_like(old), where=usable)
        out[rows] = np.clip(ratio, 1 / limit, limit)
    return out
