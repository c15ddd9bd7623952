"""Level sets of OpenVDB files, on a grid of all voxels.

A file holds distances near the surface only. They are read into a grid, in which other voxels get
the largest distance with the sign of their side; `filled` replaces these by the distance to the
surface, which is found as points where the distance is 0.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, F64
from usdsplat.core.errors import BackendError, FormatError, UsageError
from usdsplat.core.readable import readable
from usdsplat.kernels.device import Device
from usdsplat.kernels.points.nearest import nearest
from usdsplat.sim.specs import LevelSet

LARGEST = 64 << 20
"""Largest size of a grid [byte]."""
MARGIN = 2
"""Voxels around those of the file."""
UNIFORM = 1e-4
"""Relative spread of the edges of a voxel up to which it is a cube."""


def read_level_set(path: Path | str, grid: str = "") -> LevelSet:
    """Read a level set.

    Args:
        path: A .vdb file.
        grid: Name of a grid of float numbers; "" is the file's only level set.

    Raises:
        BackendError: If the library that reads the files is not installed.
        FormatError: If the file cannot be read, has no such grid, or another kind of grid.
        UsageError: If the grid is larger than LARGEST.
    """
    try:
        import tinyvdb
    except ImportError as error:
        found = "no library that reads OpenVDB files"
        raise BackendError(str(path), found, "tinyvdb: pip install 'usdsplat[vdb]'") from error
    try:
        with tinyvdb.open(readable(str(path))) as file:
            file.read_grids()
            found_grid = _grid(str(path), file, grid)
            return _dense(str(path), found_grid)
    except (tinyvdb.VDBError, OSError) as error:
        raise FormatError(str(path), str(error) or "an error", "an OpenVDB file") from error


def filled(device: Device, level_set: LevelSet) -> LevelSet:
    """Return a level set with the distance to the surface at every voxel.

    Args:
        device: Runs the kernels.
        level_set: As `read_level_set` returns it.
    """
    voxels = level_set.voxels.copy()
    surface = _surface(voxels)
    far = np.abs(voxels) >= level_set.band
    if not len(surface) or not far.any():
        return replace(level_set, voxels=voxels)
    z, y, x = np.nonzero(far)
    points = np.stack((x, y, z), axis=1).astype(np.float32)
    distances = nearest(device, surface, points, 1)[1][:, 0]
    voxels[far] = np.copysign(np.maximum(distances, level_set.band), voxels[far])
    return replace(level_set, voxels=voxels)


def _grid(path: str, file: Any, name: str) -> Any:
    """Return the grid of a name, or the only level set."""
    grids = [file.grid(number) for number in range(file.grid_count)]
    wanted = [
        each
        for each in grids
        if (each.name == name if name else each.metadata.get("class") == "level set")
    ]
    names = ", ".join(each.name for each in grids) or "no grid"
    if len(wanted) != 1:
        found = f"{names} and no {name}" if name else f"{len(wanted)} level sets ({names})"
        raise FormatError(path, found, "the name of one of them")
    if not wanted[0].type_name.startswith("Tree_float"):
        raise FormatError(path, f"{wanted[0].name} of type {wanted[0].type_name}", "float numbers")
    return wanted[0]


def _dense(path: str, grid: Any) -> LevelSet:
    """Return a grid of all voxels around those that the file holds."""
    sparse = grid.to_sparse()
    at = np.frombuffer(sparse["coords"], np.int32).reshape(-1, 3).astype(np.int64)
    values = np.frombuffer(sparse["values"], np.float32)
    if not len(at) or not np.isfinite(values).all():
        raise FormatError(path, "a grid without finite voxels", "a level set")
    to_world = _to_world(path, grid.transform)
    edges = np.linalg.norm(to_world[:3, :3], axis=0)
    if edges.max() - edges.min() > UNIFORM * edges.max():
        raise FormatError(path, f"voxels of {edges} units", "cubes")
    low, high = at.min(axis=0) - MARGIN, at.max(axis=0) + MARGIN
    shape = (high - low + 1)[::-1]
    if 4.0 * float(np.prod(shape.astype(np.float64))) > LARGEST:
        found = " x ".join(str(each) for each in shape[::-1]) + " voxels"
        raise UsageError(path, found, f"at most {LARGEST // 4}, a coarser level set")
    size = float(edges.mean())
    band = float(np.abs(values).max()) / size
    voxels = np.full(shape, band, np.float32)
    known = np.zeros(shape, np.bool_)
    x, y, z = (at - low).T
    voxels[z, y, x], known[z, y, x] = values / np.float32(size), True
    _sign(voxels, known)
    shift = np.eye(4)
    shift[:3, 3] = low
    to_grid = np.asarray(np.linalg.inv(to_world @ shift), np.float64)
    return LevelSet(voxels=voxels, band=band, to_grid=to_grid)


def _sign(voxels: F32, known: npt.NDArray[np.bool_]) -> None:
    """Give voxels that a file lacks the sign of the last one before them in their row: rows begin
    outside, and cross the surface where the file has voxels."""
    latest = np.where(known, np.arange(voxels.shape[2]), 0)
    np.maximum.accumulate(latest, axis=2, out=latest)
    inside = np.take_along_axis(voxels, latest, axis=2) < 0
    np.negative(voxels, out=voxels, where=inside & ~known)


def _surface(voxels: F32) -> F32:
    """Return points of the surface in voxels, one near each voxel that is at most one away."""
    z_slope, y_slope, x_slope = np.gradient(voxels)
    slopes = np.stack((x_slope, y_slope, z_slope), axis=-1)
    near = np.abs(voxels) <= 1
    z, y, x = np.nonzero(near)
    slope = slopes[near]
    square = np.maximum(np.einsum("ni,ni->n", slope, slope), np.float32(1e-6))
    away = voxels[near] / square
    return (np.stack((x, y, z), axis=1) - away[:, None] * slope).astype(np.float32)


def _to_world(path: str, transform: dict[str, Any]) -> F64:
    """Return the matrix from voxels to the file's space, for column vectors."""
    matrix = np.array(transform["matrix"], np.float64).T
    if transform["type"] == "affine":
        return matrix
    if "scale" not in transform["type"] and transform["type"] != "translation":
        raise FormatError(path, f"a transform {transform['type']}", "an affine one")
    made = np.diag([*transform["scale"], 1.0])
    made[:3, 3] = transform["translation"]
    return made
