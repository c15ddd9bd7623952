"""A holdout from elsewhere: what hides splats and surfaces and is not in the picture."""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.delegate.layer import Behind, Holdout
from usdsplat.kernels import surface
from usdsplat.kernels.device import CpuDevice

HoldoutRows = F32 | Holdout
"""Of some rows: planar depths, +inf where nothing is, shape (h, w); or deep samples."""


def hold_back(device: CpuDevice, behind: Behind, rows: HoldoutRows) -> Behind:
    """Return what is behind the splats once a holdout is there too.

    A flat one hides what is behind it wholly, a deep one as much as its samples cover.
    """
    if isinstance(rows, tuple):
        return Behind(behind.stops, behind.covered, rows)
    if behind.stops.size == 0:
        stops = np.full(rows.shape, np.inf, np.float32)
        behind = Behind(stops, np.zeros(rows.shape, np.uint8))
    device.run(surface.hold_back, behind.stops, behind.covered, rows)
    return behind
