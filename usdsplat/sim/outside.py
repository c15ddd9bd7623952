"""Which side of a capture's surface is the outer one.

Captures have splats inside, gaps and openings, so that signs of normals that spread from neighbour
to neighbour are often wrong. Instead, light is let in from all around, most from above: it spreads through
the free cells of a grid, and what is occupied absorbs it. The outer side is the brighter one.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, I64
from usdsplat.core.progress import phase

Bools = npt.NDArray[np.bool_]

CELLS = 88
"""Largest number of cells along an edge of the grid."""
CELL = 2.0
"""Least edge of a cell, in distances of points."""
INSIDE = (0.5, 99.5)
"""Percentiles of the coordinates between which the grid lies: strays are left out."""
PADDING = 3
"""Free cells around it."""
LOOK = 1.5
"""Distance from the surface at which light is compared, in cells."""
ROUNDS = 12
"""Rounds in which points agree with their neighbours."""
DIM = 0.05
"""Light, relative to the median, that points on the outside have at least."""
SURE = 0.2
"""Difference of light, relative to its sum, that weighs as much as all neighbours."""
GROUND = 0.25
"""Light from below, relative to that from above."""


def outer_side(
    points: F32,
    normals: F32,
    rows: I64,
    neighbours: I32,
    spacing: float,
    up: tuple[float, float, float] | None = None,
) -> tuple[F32, Bools]:
    """Return normals with the signs of the outer side, shape (c, 3), and which points light
    reaches on that side, shape (c,): others are inside.

    Args:
        points: Points on the surface [unit], shape (c, 3).
        normals: Unit normals with any sign, shape (c, 3).
        rows, neighbours: Neighbours of each point, (c + 1,) i64 and (m,) i32.
        spacing: Distance of points [unit].
        up: Unit vector to the sky; None if it is as bright from everywhere.
    """
    if not len(points):
        return normals, np.empty(0, np.bool_)
    with phase("outer side", work=len(points)):
        light = _Light(points, spacing, up)
        ahead = light.at(points + LOOK * light.cell * normals)
        behind = light.at(points - LOOK * light.cell * normals)
    difference = (ahead - behind) / np.maximum(SURE * (ahead + behind), 1e-6)
    own = np.repeat(np.arange(len(points)), np.diff(rows))
    alike = np.einsum("ij,ij->i", normals[own], normals[neighbours])
    count = np.maximum(np.diff(rows), 1)
    sign = np.where(difference < 0, -1.0, 1.0)
    for _ in range(ROUNDS):
        votes = np.bincount(own, weights=alike * sign[neighbours], minlength=len(points)) / count
        sign = np.where(votes + difference < 0, -1.0, 1.0)
    lit = np.where(sign > 0, ahead, behind)
    reached = lit > DIM * np.median(lit[lit > 0]) if (lit > 0).any() else np.ones(len(lit), bool)
    return np.ascontiguousarray(normals * sign[:, None], np.float32), reached


class _Light:
    """Light around points, on a grid."""

    def __init__(
        self, points: F32, spacing: float, up: tuple[float, float, float] | None
    ) -> None:
        low, high = np.percentile(points.astype(np.float64), INSIDE, axis=0)
        self.cell = max(CELL * spacing, float((high - low).max()) / CELLS, 1e-12)
        self._low = low - PADDING * self.cell
        shape = np.ceil((high - low) / self.cell).astype(int) + 2 * PADDING
        at, inside = self._cells(points, shape)
        occupied = np.zeros(shape, np.bool_)
        occupied[tuple(at[inside].T)] = True
        sky = np.ones(shape + 2, np.float32)
        if up is not None:
            from_middle = [np.linspace(-1, 1, edge + 2) * (edge + 1) / 2 for edge in shape]
            offsets = np.stack(np.meshgrid(*from_middle, indexing="ij"), axis=-1)
            slope = offsets @ np.asarray(up) / np.maximum(np.linalg.norm(offsets, axis=-1), 1e-9)
            sky[:] = GROUND + (1 - GROUND) * (0.5 + 0.5 * slope)
        self._grid = _spread(~occupied, sky)

    def at(self, places: F32) -> F32:
        """Return the light at places, 0 to 1; 1 beyond the grid."""
        at, inside = self._cells(places, np.array(self._grid.shape))
        found: F32 = np.ones(len(places), np.float32)
        found[inside] = self._grid[tuple(at[inside].T)]
        return found

    def _cells(self, places: F32, shape: np.ndarray) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[type-arg]
        at = np.floor((places - self._low) / self.cell).astype(np.int64)
        return at, ((at >= 0) & (at < shape)).all(axis=1)


def _spread(free: Bools, light: F32) -> F32:
    """Return light that comes from the sides of a grid and diffuses through free cells.

    Args:
        free: Cells that let light pass, shape (x, y, z).
        light: Light at the sides, shape (x + 2, y + 2, z + 2); changed.
    """
    inner = np.s_[1:-1, 1:-1, 1:-1]
    light[inner] = 0
    open_cells = free.astype(np.float32) / np.float32(6)
    for _ in range(2 * max(free.shape)):
        total = light[:-2, 1:-1, 1:-1] + light[2:, 1:-1, 1:-1]
        total += light[1:-1, :-2, 1:-1]
        total += light[1:-1, 2:, 1:-1]
        total += light[1:-1, 1:-1, :-2]
        total += light[1:-1, 1:-1, 2:]
        total *= open_cells
        light[inner] = total
    return np.ascontiguousarray(light[inner])
