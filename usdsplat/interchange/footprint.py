"""Measure the size of the photographs' pixels at the splats of a capture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from usdsplat.core.cloud import F64
from usdsplat.formats.cameras import Lens


def footprint(views: Sequence[tuple[Lens, F64]], centres: F64) -> float | None:
    """Return the median over all cameras of the size of a pixel at the splats that a camera sees.

    Args:
        views: Lens and pose of each photograph, a rotation and a translation to the space of
            `centres`, shape (4, 4), OpenCV axes.
        centres: Centres of splats, shape (n, 3).

    Returns:
        The size in the unit of `centres`, at the median planar depth of the splats in each
        photograph; None if no photograph shows a splat.
    """
    sizes = [size for lens, pose in views if (size := _size(lens, pose, centres)) is not None]
    return float(np.median(sizes)) if sizes else None


def _size(lens: Lens, pose: F64, centres: F64) -> float | None:
    """Return the size of a pixel at the splats in one photograph; None if it shows none."""
    x, y, z = ((centres - pose[:3, 3]) @ pose[:3, :3]).T
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = lens.fx * x / z + lens.cx, lens.fy * y / z + lens.cy
    seen = (z > 0) & (u >= 0) & (u < lens.width) & (v >= 0) & (v < lens.height)
    if not seen.any():
        return None
    return float(np.median(z[seen]) / np.sqrt(lens.fx * lens.fy))
