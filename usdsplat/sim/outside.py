"""Which side of a capture's surface is the outer one.

Captures have splats inside, gaps and openings, so that signs of normals that spread from neighbour
to neighbour are often wrong. Instead, light is let in from all around, most from above: it spreads
through the free cells of a grid, and what is occupied absorbs it. The outer side is the brighter
one.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, I64
from usdsplat.core.progress import phase

Bools = npt.NDArray[np.bool_]

CELLS = 64
"""Largest number of cells along the capture."""
CELL = 2.0
"""Least edge of a cell, in distances of points."""
INSIDE = (0.5, 99.5)
"""Percentiles of the coordinates between which the grid lies: strays are left out."""
PADDING = 0.3
"""Free space around it, relative to its longest edge: as far from all sides."""
COARSEST, FINE_STEPS = 24, 48
"""Edge of the coarsest grid, in cells, and steps of diffusion on each finer one."""
LOOK = 1.5
"""Distance from the surface at which light is compared, in cells."""
ROUNDS = 12
"""Rounds in which points agree with their neighbours."""
DIM = 0.02
"""Light, relative to the median, that points on the outside have at least."""
SURE = 0.2
"""Difference of light, relative to its sum, that weighs as much as all neighbours."""
GROUND = 0.1
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
        light = Light(points, max(CELL * spacing, 1e-12), up)
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


class Light:
    """Light around points, on a grid.

    Args:
        points: What absorbs light [unit], shape (n, 3).
        cell: Least edge of a cell [unit]: no longer than the gaps between points.
        up: Unit vector to the sky; None if it is as bright from everywhere.
    """

    def __init__(self, points: F32, cell: float, up: tuple[float, float, float] | None) -> None:
        low, high = np.percentile(points.astype(np.float64), INSIDE, axis=0)
        longest = float((high - low).max())
        self.cell = max(cell, longest / CELLS)
        """Edge of a cell [unit]."""
        padding = 3 + int(PADDING * longest / self.cell)
        self._low = low - padding * self.cell
        shape = np.ceil((high - low) / self.cell).astype(int) + 2 * padding
        at, inside = self._cells(points, shape)
        free: Bools = np.ones(shape, np.bool_)
        free[tuple(at[inside].T)] = False
        self._grid = _spread(free, up)

    def at(self, places: F32) -> F32:
        """Return the light at places, 0 to 1; 1 beyond the grid."""
        at, inside = self._cells(places, np.array(self._grid.shape))
        found: F32 = np.ones(len(places), np.float32)
        found[inside] = self._grid[tuple(at[inside].T)]
        return found

    def _cells(self, places: F32, shape: I64) -> tuple[I64, Bools]:
        at = np.floor((places - self._low) / self.cell).astype(np.int64)
        return at, ((at >= 0) & (at < shape)).all(axis=1)


def _spread(free: Bools, up: tuple[float, float, float] | None) -> F32:
    """Return light that comes from the sides of a grid and diffuses through free cells, shape
    (x, y, z): on coarser grids first, from which it goes on."""
    shape = free.shape
    light = _sky(shape, up)
    inner = np.s_[1:-1, 1:-1, 1:-1]
    light[inner] = 0
    steps = FINE_STEPS
    if max(shape) > COARSEST:
        even = np.pad(free, [(0, edge % 2) for edge in shape], constant_values=True)
        x, y, z = (edge // 2 for edge in even.shape)
        halved = even.reshape(x, 2, y, 2, z, 2).all(axis=(1, 3, 5))
        coarse = _spread(np.asarray(halved, np.bool_), up)
        for axis in range(3):
            coarse = coarse.repeat(2, axis=axis)
        light[inner] = coarse[: shape[0], : shape[1], : shape[2]] * free
    else:
        steps = COARSEST**2
    part = free.astype(np.float32) / np.float32(6)
    for _ in range(steps):
        total = light[:-2, 1:-1, 1:-1] + light[2:, 1:-1, 1:-1]
        total += light[1:-1, :-2, 1:-1]
        total += light[1:-1, 2:, 1:-1]
        total += light[1:-1, 1:-1, :-2]
        total += light[1:-1, 1:-1, 2:]
        total *= part
        light[inner] = total
    return np.ascontiguousarray(light[inner])


def _sky(shape: tuple[int, ...], up: tuple[float, float, float] | None) -> F32:
    """Return the light around a grid of this shape, with a margin of one cell."""
    around = tuple(edge + 2 for edge in shape)
    if up is None:
        return np.ones(around, np.float32)
    axes = [np.linspace(-1, 1, edge) * edge / 2 for edge in around]
    offsets = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    slope = offsets @ np.asarray(up) / np.maximum(np.linalg.norm(offsets, axis=-1), 1e-9)
    return (GROUND + (1 - GROUND) * (0.5 + 0.5 * slope)).astype(np.float32)
