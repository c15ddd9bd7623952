"""Patches: surfaces covered with flat splats, and curves with long ones, before lighting."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64
from usdsplat.interchange.procedural.materials import Color, Finish

Mask = npt.NDArray[np.bool_]
Surface = Callable[[F64, F64], F64]
"""(s, t), each (n,), to points (n, 3) [m]; s in [0, 1] runs along, t in [0, 1) closes a ring."""

_COVER = 0.70  # standard deviation over lattice step: neighbours blend without blurring the pattern
_GOLDEN = 0.6180339887498949


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Patch:
    """Splats of one material: geometry and paint.

    Columns of `axes` are two directions within the surface, then its outward normal; for strands
    the first is the tangent and the others are arbitrary perpendiculars.
    """

    positions: F64
    """Positions [m], shape (n, 3)."""
    axes: F64
    """Rotation matrices, shape (n, 3, 3)."""
    sigmas: F64
    """Standard deviations along the axes [m], shape (n, 3)."""
    albedo: F64
    """Linear Rec.709, shape (n, 3)."""
    finish: Finish
    film: F64 | float = 0.0
    """Optical thickness of the thin film [nm], a number or shape (n,)."""
    is_strand: bool = False

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def normals(self) -> F64:
        """Outward unit normals, shape (n, 3)."""
        return self.axes[:, :, 2]

    def where(self, mask: Mask) -> Patch:
        """Return the splats selected by a mask."""
        parts = {name: getattr(self, name)[mask] for name in _ROWS}
        film = self.film[mask] if isinstance(self.film, np.ndarray) else self.film
        return replace(self, film=film, **parts)

    def moved(self, rotation: F64, offset: Sequence[float]) -> Patch:
        """Return the patch rotated about the origin, then translated [m]."""
        positions = self.positions @ rotation.T + np.array(offset)
        return replace(self, positions=positions, axes=rotation @ self.axes)


_ROWS = ("positions", "axes", "sigmas", "albedo")


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """Points of a swept surface: surface parameters, and axes and sizes as in `Patch`."""

    s: F64
    t: F64
    positions: F64
    axes: F64
    sigmas: F64

    def paint(self, albedo: F64 | Color, finish: Finish, film: F64 | float = 0.0) -> Patch:
        """Return a patch with this colour, one for all or shape (n, 3), and finish."""
        return Patch(
            positions=self.positions,
            axes=self.axes,
            sigmas=self.sigmas,
            albedo=np.broadcast_to(albedo, self.positions.shape),
            finish=finish,
            film=film,
        )


def sweep(surface: Surface, spacing: float | Callable[[F64], F64]) -> Lattice:
    """Cover a swept surface with a lattice whose steps are about `spacing` [m] both ways.

    Rows have equal distance along s, and each has as many points as its length requires. A
    golden-ratio shift from row to row keeps the points from lining up. Normals are the cross
    product of the directions of t and of s.
    """
    s_table, around = np.linspace(0.0, 1.0, 513), np.arange(49) / 48
    wanted = spacing(s_table) if callable(spacing) else np.full(513, spacing)
    grid = surface(np.repeat(s_table, 49), np.tile(around, 513)).reshape(513, 49, 3)
    ring = np.linalg.norm(np.diff(grid, axis=1), axis=2).sum(axis=1)
    advance = np.linalg.norm(np.diff(grid, axis=0), axis=2).mean(axis=1)
    rows_until = np.concatenate([[0.0], np.cumsum(advance / (wanted[1:] + wanted[:-1]) * 2)])
    rows = max(3, round(rows_until[-1]))
    s_row = np.interp((np.arange(rows) + 0.5) / rows * rows_until[-1], rows_until, s_table)
    per_row = np.maximum(3, np.rint(np.interp(s_row, s_table, ring / wanted))).astype(int)
    row = np.repeat(np.arange(rows), per_row)
    column = np.arange(len(row)) - np.repeat(np.cumsum(per_row) - per_row, per_row)
    t = (column + (row * _GOLDEN) % 1.0) / per_row[row] % 1.0
    return _framed(surface, s_row[row], t, np.gradient(s_row)[row], 1.0 / per_row[row])


def turned(
    profile: F64, ripple: Callable[[F64, F64, F64], F64] | None = None, *, base: float = 0.0
) -> Surface:
    """Return a surface of revolution about y.

    Args:
        profile: Polyline of (radius, height) [m], shape (k, 2); upward gives outward normals.
        ripple: Function of radius, height and angle [rad], each (n,), that returns a new radius.
        base: Offset of all heights [m].
    """
    reach = length_until(profile)

    def surface(s: F64, t: F64) -> F64:
        at, angle = s * reach[-1], 2 * math.pi * t
        radius, y = np.interp(at, reach, profile[:, 0]), np.interp(at, reach, profile[:, 1])
        radius = ripple(radius, y, angle) if ripple else radius
        return np.stack([radius * np.cos(angle), base + y, -radius * np.sin(angle)], axis=1)

    return surface


def strands(
    curves: F64, radius: Any, albedo: F64 | Color, finish: Finish, *, lay: float = 0.42
) -> Patch:
    """Place long splats along curves.

    Args:
        curves: Polylines, shape (m, k + 1, 3) [m]; each of the k links becomes a splat.
        radius: Half width of the links, broadcast to (m, k) [m].
        albedo: One colour, or shape (m k, 3).
        lay: Standard deviation along the link over its length.
    """
    links = np.diff(curves, axis=1)
    middle = (0.5 * (curves[:, 1:] + curves[:, :-1])).reshape(-1, 3)
    length = np.linalg.norm(links, axis=2)
    tangent = unit(links.reshape(-1, 3))
    side = unit(np.cross(tangent, [0.31, 0.87, 0.38]))  # no link here runs along this direction
    across = 0.5 * np.broadcast_to(radius, length.shape).ravel()
    return Patch(
        positions=middle,
        axes=np.stack([tangent, side, np.cross(tangent, side)], axis=2),
        sigmas=np.stack([lay * length.ravel(), across, across], axis=1),
        albedo=np.broadcast_to(albedo, middle.shape),
        finish=finish,
        is_strand=True,
    )


def unit(vectors: F64) -> F64:
    """Return rows normalised to length 1."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def length_until(polyline: F64) -> F64:
    """Return the length of a polyline up to each of its points."""
    steps = np.linalg.norm(np.diff(polyline, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def noise(points: F64, *, scale: float, seed: int, octaves: int = 3) -> F64:
    """Return smooth noise of about -1..1: sums of sines in random directions, shape (n,).

    Args:
        scale: Size of the largest feature [m].
    """
    rng = np.random.default_rng(seed)
    total = np.zeros(len(points))
    for octave in range(octaves):
        waves = rng.normal(size=(7, 3)) * (2.2 * 2**octave / scale)
        total += np.sin(points @ waves.T + rng.uniform(0, 2 * np.pi, 7)).sum(axis=1) * 0.5**octave
    return total / 3.5


def mix(a: F64 | Color, b: F64 | Color, t: F64) -> F64:
    """Blend colours a to b by t, clamped to [0, 1], shape (n, 3)."""
    share = np.clip(t, 0.0, 1.0)[:, None]
    return np.asarray(a) * (1 - share) + np.asarray(b) * share


def _framed(surface: Surface, s: F64, t: F64, s_step: F64, t_step: F64) -> Lattice:
    """Compute axes and sizes from central differences over half a lattice step."""
    along = surface(s + s_step / 4, t) - surface(s - s_step / 4, t)
    across = surface(s, t + t_step / 4) - surface(s, t - t_step / 4)
    u, n = unit(across), unit(np.cross(across, along))
    axes = np.stack([u, np.cross(n, u), n], axis=2)
    wide = _COVER * 2 * np.linalg.norm(across, axis=1)
    high = _COVER * 2 * np.abs(np.einsum("ni,ni->n", along, axes[:, :, 1]))
    thin = 0.12 * np.minimum(wide, high)
    return Lattice(s, t, surface(s, t), axes, np.stack([wide, high, thin], axis=1))
