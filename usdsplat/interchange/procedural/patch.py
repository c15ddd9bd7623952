"""Patches: surfaces covered with flat splats and curves strung with long ones, before any light."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from usdsplat.core.cloud import F64

Surface = Callable[[F64, F64], F64]
"""(s, t), each shape (n,), to points (n, 3) [m]; s in [0, 1] runs along, t in [0, 1] goes around."""

_COVER = 0.66  # standard deviation over lattice step: neighbours blend without blurring the pattern
_GOLDEN = 0.6180339887498949


@dataclass(frozen=True, slots=True, kw_only=True)
class Finish:
    """How a material answers the light beyond its own colour."""

    specular: tuple[float, float, float] = (0.04, 0.04, 0.04)
    """Linear reflectance at normal incidence."""
    gloss: float = 0.0
    """Weight of the mirrored surroundings [0..1]."""
    sharpness: float = 8.0
    """Concentration of the sun's highlight; degree 3 resolves about 10."""
    film: float = 0.0
    """Weight of thin-film colours in the reflection [0..1]."""
    translucency: float = 0.0
    """Share of the light that comes through from behind [0..1]."""
    opacity: float = 0.98


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Patch:
    """Splats of one material: geometry and paint.

    Columns of `axes` are the two directions within the surface, then its outward normal; for strands
    the first is the tangent and the normal is any perpendicular.
    """

    positions: F64
    """[m], shape (n, 3)."""
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


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """Points of a swept surface, where they lie on it and how far their neighbours are."""

    s: F64
    t: F64
    positions: F64
    axes: F64
    sigmas: F64

    def paint(self, albedo: F64, finish: Finish, film: F64 | float = 0.0) -> Patch:
        """The patch with this paint and finish."""
        return Patch(
            positions=self.positions,
            axes=self.axes,
            sigmas=self.sigmas,
            albedo=albedo,
            finish=finish,
            film=film,
        )


def sweep(surface: Surface, spacing: float | Callable[[F64], F64]) -> Lattice:
    """Cover a swept surface with a lattice whose steps are about `spacing` [m] both ways.

    Rows follow each other at equal distance along s, each holds as many points as its length asks
    for, and a golden-ratio shift from row to row keeps them from lining up.
    """
    s_table = np.linspace(0.0, 1.0, 513)
    wanted = spacing(s_table) if callable(spacing) else np.full(513, spacing)
    around = np.arange(49) / 48
    grid = surface(np.repeat(s_table, 49), np.tile(around, 513)).reshape(513, 49, 3)
    ring = np.linalg.norm(np.diff(grid, axis=1), axis=2).sum(axis=1)
    advance = np.linalg.norm(np.diff(grid, axis=0), axis=2).mean(axis=1)
    rows_until = np.concatenate([[0.0], np.cumsum(advance / (wanted[1:] + wanted[:-1]) * 2)])
    rows = max(3, round(rows_until[-1]))
    s_row = np.interp((np.arange(rows) + 0.5) / rows * rows_until[-1], rows_until, s_table)
    step_row = np.gradient(s_row)
    per_row = np.maximum(3, np.rint(np.interp(s_row, s_table, ring / wanted))).astype(int)

    row = np.repeat(np.arange(rows), per_row)
    column = np.arange(len(row)) - np.repeat(np.cumsum(per_row) - per_row, per_row)
    s = s_row[row]
    t = (column + (row * _GOLDEN) % 1.0) / per_row[row] % 1.0
    return _framed(surface, s, t, step_row[row], 1.0 / per_row[row])


def _framed(surface: Surface, s: F64, t: F64, s_step: F64, t_step: F64) -> Lattice:
    """Axes and sizes from central differences of the surface over half a lattice step."""
    along = surface(s + s_step / 4, t) - surface(s - s_step / 4, t)
    across = surface(s, t + t_step / 4) - surface(s, t - t_step / 4)
    u = unit(across)
    n = unit(np.cross(across, along))
    axes = np.stack([u, np.cross(n, u), n], axis=2)
    wide = _COVER * 2 * np.linalg.norm(across, axis=1)
    high = _COVER * 2 * np.abs(np.einsum("ni,ni->n", along, axes[:, :, 1]))
    thin = 0.12 * np.minimum(wide, high)
    return Lattice(s, t, surface(s, t), axes, np.stack([wide, high, thin], axis=1))


def string(curves: F64, radius: F64, *, lay: float = 0.42) -> tuple[F64, F64, F64]:
    """String long splats along curves.

    Args:
        curves: Polylines, shape (m, k + 1, 3) [m]; each of the k links becomes a splat.
        radius: Half width of each link, shape (m, k) [m].
        lay: Standard deviation along the link over its length.

    Returns:
        Positions (m k, 3), axes (m k, 3, 3) with the tangent first, sigmas (m k, 3).
    """
    links = np.diff(curves, axis=1)
    middle = (0.5 * (curves[:, 1:] + curves[:, :-1])).reshape(-1, 3)
    length = np.linalg.norm(links, axis=2).reshape(-1)
    tangent = unit(links.reshape(-1, 3))
    side = np.cross(tangent, [0.31, 0.87, 0.38])  # a direction that no link here runs along
    side = unit(side)
    axes = np.stack([tangent, side, np.cross(tangent, side)], axis=2)
    across = 0.5 * radius.reshape(-1)
    return middle, axes, np.stack([lay * length, across, across], axis=1)


def move(patch: Patch, rotation: F64, offset: Sequence[float]) -> Patch:
    """Turn a patch about the origin, then shift it [m]."""
    return replace(
        patch, positions=patch.positions @ rotation.T + np.array(offset), axes=rotation @ patch.axes
    )


def keep(patch: Patch, mask: F64) -> Patch:
    """The splats of a patch that a mask names."""
    film = patch.film[mask] if isinstance(patch.film, np.ndarray) else patch.film
    parts = {name: getattr(patch, name)[mask] for name in ("positions", "axes", "sigmas", "albedo")}
    return replace(patch, film=film, **parts)


def unit(vectors: F64) -> F64:
    """Rows at length 1."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def noise(points: F64, *, scale: float, seed: int, octaves: int = 3) -> F64:
    """Smooth noise around 0, about -1..1: sums of sines in random directions, shape (n,).

    Args:
        scale: Size of the largest feature [m].
    """
    rng = np.random.default_rng(seed)
    total = np.zeros(len(points))
    for octave in range(octaves):
        waves = rng.normal(size=(7, 3)) * (2.2 * 2**octave / scale)
        total += np.sin(points @ waves.T + rng.uniform(0, 2 * np.pi, 7)).sum(axis=1) * 0.5**octave
    return total / 3.5


def mix(a: F64 | Sequence[float], b: F64 | Sequence[float], t: F64) -> F64:
    """Blend colours a to b by t in [0, 1], shape (n, 3)."""
    share = np.clip(t, 0.0, 1.0)[:, None]
    return np.asarray(a) * (1 - share) + np.asarray(b) * share
