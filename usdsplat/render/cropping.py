"""Test in float64 which points a garbage matte keeps. Tests compare the kernels with it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64
from usdsplat.render.specs import CropShape, CropSpec

Mask = npt.NDArray[np.bool_]


def inside(crops: Iterable[CropSpec], points: npt.NDArray[np.floating]) -> Mask:
    """Return which points the volumes keep in the picture.

    Args:
        crops: Volumes of one field. The surface of a volume belongs to it.
        points: World positions [scene unit], shape (n, 3).

    Returns:
        Shape (n,). A kept point is inside at least one including volume, if there is any, and
        inside no excluding volume. A point that is not finite is inside no volume.
    """
    crops = tuple(crops)
    kept = np.full(len(points), not any(crop.keeps for crop in crops))
    for crop in crops:
        if crop.keeps:
            kept |= _holds(crop, points)
    for crop in crops:
        if not crop.keeps:
            kept &= ~_holds(crop, points)
    return kept


def _holds(crop: CropSpec, points: npt.NDArray[np.floating]) -> Mask:
    matrix = np.reshape(crop.world_to_shape, (4, 4))
    with np.errstate(invalid="ignore", over="ignore"):
        local = points.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
        return _is_within(crop.shape, local, crop.length)


def _is_within(shape: CropShape, local: F64, length: float) -> Mask:
    """Return which points are inside a canonical shape, see `CropSpec`."""
    x, y, z = local.T
    from_axis = x * x + y * y
    if shape == "sphere":
        return from_axis + z * z <= 1
    if shape == "cube":
        return np.abs(local).max(axis=1) <= 1
    if shape == "cylinder":
        return (from_axis <= 1) & (np.abs(z) <= 1)
    if shape == "cone":
        return (4 * from_axis <= (1 - z) ** 2) & (np.abs(z) <= 1)
    if shape == "capsule":
        return from_axis + np.maximum(np.abs(z) - length, 0) ** 2 <= 1
    return z <= 0
