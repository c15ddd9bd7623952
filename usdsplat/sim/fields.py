"""Signed distance fields of meshes, baked on demand and cached while they are used."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32, F64
from usdsplat.core.errors import UsageError
from usdsplat.core.progress import phase, steps
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim.distance_field import spread
from usdsplat.kernels.sim.solids import FIELD_COLUMNS
from usdsplat.sim.closest import Triangles
from usdsplat.sim.specs import Surface

AUTO = 64
"""Voxels along the longest edge of a mesh's box where no size is given."""
BAND = 3
"""Voxels around the triangles in which distances are exact; also the margin around the mesh."""
LARGEST = 64 << 20
"""Largest size of a field [byte]."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Field:
    """Signed distances from a mesh on a grid, negative inside."""

    low: F64
    """Centre of the first voxel [unit], shape (3,)."""
    voxel: float
    """Edge of a voxel [unit]."""
    distances: F32
    """Distances [unit], shape (nz, ny, nx)."""
    box: tuple[F64, F64]
    """Low and high corner of the mesh [unit]."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FieldTable:
    """Fields in the kernels' layout."""

    headers: F64
    """Shape (f, FIELD_COLUMNS)."""
    voxels: F32
    """Voxels of all fields, flat."""


def bake_field(
    device: Device, surface: Surface, voxel: float = -1.0, *, where: str = "mesh"
) -> Field:
    """Compute the signed distance from a mesh at the voxels of a grid.

    Distances are exact within BAND voxels of the triangles; farther away they are too large by a
    small fraction of a voxel. A point is inside where the winding number exceeds one half, so that
    meshes need not be closed.

    Args:
        surface: At least one triangle.
        voxel: Edge of a voxel [unit]; negative is a 64th of the longest edge of the mesh's box.
        where: Name in error messages.

    Raises:
        StageError: If the mesh has no triangle, or a point that is not finite.
        UsageError: If the field would be larger than LARGEST.
    """
    tree = Triangles(device, surface)
    used = surface.points[np.unique(surface.triangles)].astype(np.float64)
    box = used.min(axis=0), used.max(axis=0)
    longest = float((box[1] - box[0]).max())
    size = voxel if voxel > 0.0 else max(longest / AUTO, 1e-9)
    counts = np.ceil((box[1] - box[0]) / size) + (2 * BAND + 1)
    if 4.0 * counts.prod() > LARGEST:
        least = longest / ((LARGEST / 4) ** (1 / 3) - 2 * BAND - 2)
        raise UsageError(
            f"{where} voxelSize", f"{size:g}, a field of {counts.prod():.0f} voxels",
            f"{least:.2g} or more, a field of {LARGEST // 4} voxels at most",
        )  # fmt: skip
    nx, ny, nz = (int(count) for count in counts)
    low = (0.5 * (box[0] + box[1] - size * (counts - 1))).astype(np.float32)
    axes = [low[a] + np.float32(size) * np.arange(m, dtype=np.float32)
            for a, m in enumerate((nx, ny, nz))]  # fmt: skip
    points = np.empty((nz * ny * nx, 3), np.float32)
    squared = np.empty(len(points), np.float32)
    slab = ny * nx
    for k in steps("distance field", nz):
        at = np.empty((ny, nx, 3), np.float32)
        at[..., 0], at[..., 1], at[..., 2] = axes[0], axes[1][:, None], axes[2][k]
        hits = tree.closest(at.reshape(-1, 3), within=BAND * size)
        points[k * slab : (k + 1) * slab] = hits.points
        squared[k * slab : (k + 1) * slab] = hits.squared
    with phase("inside and outside", work=len(points)):
        device.run(spread, low, np.float32(size), (nx, ny, nz), points, squared)
        distances = np.sqrt(squared, out=squared).reshape(nz, ny, nx)
        _sign(tree, axes, size, distances)
    return Field(low=low.astype(np.float64), voxel=size, distances=distances, box=box)


def _sign(tree: Triangles, axes: list[F32], size: float, distances: F32) -> None:
    """Make distances inside negative.

    If the distances of two adjacent voxels of a row add up to more than a voxel, no surface lies
    between them, and the second gets the sign of the first. Winding numbers are computed for all
    other voxels.
    """
    asked = np.ones(distances.shape, bool)
    asked[..., 1:] = distances[..., 1:] + distances[..., :-1] <= 1.001 * size
    z, y, x = np.nonzero(asked)
    points = np.stack((axes[0][x], axes[1][y], axes[2][z]), axis=1)
    inside = np.zeros(distances.shape, bool)
    inside[asked] = tree.winding(points) > 0.5
    latest = np.where(asked, np.arange(distances.shape[2]), 0)
    np.maximum.accumulate(latest, axis=2, out=latest)
    np.negative(distances, out=distances, where=np.take_along_axis(inside, latest, axis=2))


class Fields:
    """The fields of one simulation, cached by the mesh's arrays: equal arrays must be the same
    objects.

    Args:
        device: Runs the kernels.
    """

    def __init__(self, device: Device) -> None:
        self._device = device
        self._kept: dict[tuple[int, int, float], tuple[Surface, Field]] = {}
        self._table: tuple[list[Field], FieldTable] | None = None

    def of(self, surface: Surface, voxel: float, where: str) -> Field:
        """Return the field of a mesh; bake it unless it is cached.

        Raises:
            StageError, UsageError: As `bake_field`.
        """
        key = id(surface.points), id(surface.triangles), voxel
        if key not in self._kept:
            field = bake_field(self._device, surface, voxel, where=where)
            self._kept[key] = (
                surface,
                field,
            )  # keeps the surface alive too: its arrays are identified by id
        return self._kept[key][1]

    def table(self, fields: list[Field]) -> FieldTable:
        """Pack fields in this order, and drop all others."""
        wanted = {id(field) for field in fields}
        self._kept = {key: kept for key, kept in self._kept.items() if id(kept[1]) in wanted}
        if self._table is not None and list(map(id, self._table[0])) == list(map(id, fields)):
            return self._table[1]
        headers = np.zeros((len(fields), FIELD_COLUMNS))
        start = 0
        for row, field in zip(headers, fields, strict=True):
            row[:] = *field.low, field.voxel, *field.distances.shape[::-1], start
            start += field.distances.size
        flat = [field.distances.reshape(-1) for field in fields]
        voxels = np.concatenate(flat) if flat else np.zeros(0, np.float32)
        self._table = list(fields), FieldTable(headers=headers, voxels=voxels)
        return self._table[1]
