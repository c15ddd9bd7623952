"""Model a pavement of glazed tiles: rhombi between the tangents of a circle, with inlays.

Long splats follow the joints row by row, so that joints are straight lines.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64
from usdsplat.interchange.procedural.materials import GLAZE, Color
from usdsplat.interchange.procedural.patch import Patch, noise, unit

INNER, OUTER = 0.31, 0.665
"""Radii of the pavement [m]."""

_LINES, _TOUCH = 24, 0.30  # joints, all tangent to a circle of this radius [m]
_DIRECTIONS = 2 * math.pi * np.arange(_LINES) / _LINES
_NORMALS = np.stack([np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)], axis=1)

_ROWS = np.array([-11, -10, -4, -3, -2, -1, 0, 1, 2, 3, 4, 10, 11])  # beside a joint
_GILT_ROWS = (4, 10, 11)  # lines of gold between border, field and heart of a tile

_CREAM: Color = (0.74, 0.67, 0.53)
_TEAL: Color = (0.01, 0.20, 0.21)
_COBALT: Color = (0.015, 0.05, 0.30)
_SAFFRON: Color = (0.66, 0.32, 0.04)
_CLAY: Color = (0.42, 0.08, 0.045)
_NIGHT: Color = (0.012, 0.025, 0.10)
_GROUT: Color = (0.30, 0.26, 0.21)
_GILDING: Color = (0.50, 0.30, 0.06)
# Colours by ring: the number of joints between a tile and the centre. 4 to 9 occur.
_BORDERS = np.array([_NIGHT] * 5 + [_TEAL, _CREAM, _CLAY, _CREAM, _NIGHT])
_FIELDS = np.array([_SAFFRON] * 5 + [_SAFFRON, _COBALT, _CREAM, _TEAL, _CLAY])
_HEARTS = np.array([_COBALT] * 5 + [_COBALT, _CREAM, _TEAL, _SAFFRON, _CREAM])


@dataclass(frozen=True, slots=True, eq=False)
class _Laid:
    """Splats on the ground before glazing."""

    places: F64
    """(x, z) [m], shape (n, 2)."""
    headings: F64
    """Direction of the long axis, angle from x to z [rad], shape (n,)."""
    sigmas: F64
    """[m], shape (n, 3)."""
    rows: F64
    """Distance to the nearest joint in splat rows, shape (n,)."""


def tiles(spacing: float, seed: int) -> list[Patch]:
    """Model the pavement, splats about `spacing` [m] apart; `seed` varies shade and tilt of
    tiles."""
    step = 0.6 * spacing
    return [_glazed(_along_joints(step), seed), _glazed(_within_tiles(step), seed)]


def _along_joints(step: float) -> _Laid:
    """Place rows of long splats beside every joint, mitred where another joint is nearer."""
    half = math.sqrt(OUTER**2 - _TOUCH**2)
    x = np.arange(-half, half + step, 2.6 * step)
    grids = np.meshgrid(np.arange(_LINES), _ROWS, x, indexing="ij")
    line, row, at = (grid.ravel() for grid in grids)
    outward = _NORMALS[line]
    along = np.stack([-outward[:, 1], outward[:, 0]], axis=1)
    at = at + 1.3 * step * (row % 2)
    places = (_TOUCH + step * row)[:, None] * outward + at[:, None] * along
    gap, _ = _rosette(places)
    near = (gap > step * np.abs(row) - 1e-9) & _paved(places)
    sigmas = np.tile(step * np.array([1.35, 0.52, 0.1]), (near.sum(), 1))
    headings = _DIRECTIONS[line[near]] + math.pi / 2
    return _Laid(places[near], headings, sigmas, np.abs(row[near]).astype(float))


def _within_tiles(step: float) -> _Laid:
    """Place round splats on a lattice outside the rows."""
    size = 2.0 * step
    x = np.arange(-OUTER, OUTER, size)
    grid = np.stack(np.meshgrid(x, np.arange(-OUTER, OUTER, size * math.sqrt(0.75))), axis=-1)
    grid[1::2, :, 0] += size / 2
    places = grid.reshape(-1, 2)
    gap, _ = _rosette(places)
    rows = gap / step
    free = ((rows > 4.5) & (rows < 9.5)) | (rows > 11.5)
    free &= _paved(places)
    sigmas = np.tile(size * np.array([0.62, 0.62, 0.05]), (free.sum(), 1))
    return _Laid(places[free], np.zeros(len(sigmas)), sigmas, rows[free])


def _glazed(laid: _Laid, seed: int) -> Patch:
    """Colour splats by row and ring; every tile has its own shade and tilt."""
    beyond = _rosette(laid.places)[1]
    ring = np.minimum(beyond.sum(axis=1), len(_FIELDS) - 1)
    weights = np.random.default_rng(seed).integers(1, 4096, _LINES)
    tile = np.random.default_rng(seed).random((4096, 3))[beyond @ weights % 4096]
    inlay = np.where((laid.rows > 9.5)[:, None], _HEARTS[ring], _FIELDS[ring])
    albedo = np.where((laid.rows > 4.5)[:, None], inlay, _BORDERS[ring])
    albedo = albedo * (0.80 + 0.40 * tile[:, :1])
    albedo = np.where(np.isin(laid.rows, _GILT_ROWS)[:, None], _GILDING, albedo)
    is_joint = laid.rows == 0
    albedo = np.where(is_joint[:, None], _GROUT, albedo)
    x, z = laid.places.T
    p = np.stack([x, np.where(is_joint, -0.001, 0.0), z], axis=1)
    tilt = 0.12 * (tile[:, 1:] - 0.5) * ~is_joint[:, None]
    n = unit(np.stack([tilt[:, 0], np.ones_like(x), tilt[:, 1]], axis=1))
    u = np.stack([np.cos(laid.headings), np.zeros_like(x), np.sin(laid.headings)], axis=1)
    u = unit(u - n * np.einsum("ni,ni->n", u, n)[:, None])
    return Patch(
        positions=p,
        axes=np.stack([u, np.cross(n, u), n], axis=2),
        sigmas=laid.sigmas,
        albedo=albedo * (1 + 0.08 * noise(p, scale=0.05, seed=seed))[:, None],
        finish=GLAZE,
    )


def _rosette(places: F64) -> tuple[F64, npt.NDArray[np.bool_]]:
    """Return the distance to the nearest joint [m], shape (n,), and which joints are passed on the
    way from the centre."""
    offset = places @ _NORMALS.T - _TOUCH
    return np.abs(offset).min(axis=1), offset > 0


def _paved(places: F64) -> npt.NDArray[np.bool_]:
    """Return which places lie within the pavement."""
    radius = np.hypot(*places.T)
    return (radius > INNER) & (radius < OUTER)
