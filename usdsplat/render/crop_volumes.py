"""Convert garbage mattes to arrays for kernels."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64
from usdsplat.kernels import crop
from usdsplat.render.specs import CropSpec

SHAPES = {
    "sphere": crop.SPHERE,
    "cube": crop.CUBE,
    "cylinder": crop.CYLINDER,
    "cone": crop.CONE,
    "capsule": crop.CAPSULE,
    "plane": crop.PLANE,
}


def volumes(crops: tuple[CropSpec, ...], transforms: F64) -> tuple[npt.NDArray[Any], F64]:
    """Return CROP records and matrices of the volumes of one field.

    The records have shape (k,). The matrices have shape (m, k, 3, 4); for each of m appearances
    they take the field's local space to the space of each volume.

    Args:
        crops: Volumes of one field.
        transforms: Local to world of the field's appearances, shape (m, 4, 4).
    """
    records = np.array([(SHAPES[c.shape], c.keeps, c.length) for c in crops], crop.CROP)
    to_shapes = np.array([c.world_to_shape for c in crops], np.float64).reshape(-1, 4, 4)
    return records, np.ascontiguousarray((to_shapes[None] @ transforms[:, None])[:, :, :3])
