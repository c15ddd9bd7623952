"""A holdout from elsewhere: what hides splats and surfaces and is not in the picture."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.core.errors import UsageError
from usdsplat.delegate.layer import Behind, Holdout
from usdsplat.delegate.scratch import Scratch
from usdsplat.kernels import surface
from usdsplat.kernels.device import Device

HoldoutRows = F32 | Holdout
"""Of some rows: planar depths, +inf where nothing is, shape (h, w); or deep samples."""


def hold_back(
    device: Device, scratch: Scratch, behind: Behind, rows: HoldoutRows, shape: tuple[int, int]
) -> Behind:
    """Return what is behind the splats once a holdout is there too.

    A flat one hides what is behind it wholly, a deep one as much as its samples cover.

    Args:
        shape: Rows and columns that were asked for.

    Raises:
        UsageError: If the holdout has others.
    """
    _check(rows, shape)
    if isinstance(rows, tuple):
        offsets, depths, through = rows
        kept = device.keep(offsets), device.keep(depths), device.keep(through)
        return Behind(behind.stops, behind.covered, kept)
    if behind.stops.size == 0:
        stops = scratch.get("holdout stops", shape, np.float32)
        behind = Behind(stops, scratch.get("holdout covered", shape, np.uint8))
        device.run(surface.clear, behind.stops, behind.covered)
    device.run(surface.hold_back, behind.stops, behind.covered, device.upload(rows))
    return behind


def _check(rows: HoldoutRows, shape: tuple[int, int]) -> None:
    """Refuse what kernels would read beyond."""
    if not isinstance(rows, tuple):
        if rows.shape != shape:
            raise UsageError("holdout", f"depths of shape {rows.shape}", str(shape))
        return
    offsets, depths, through = rows
    pixels = shape[0] * shape[1]
    if len(offsets) != pixels + 1:
        raise UsageError("holdout", f"{len(offsets)} offsets", f"{pixels + 1}")
    if offsets[0] != 0 or (np.diff(offsets) < 0).any() or offsets[-1] != len(depths):
        raise UsageError("holdout", "offsets of other samples", f"0 to {len(depths)}, ascending")
    if len(through) != len(depths):
        raise UsageError("holdout", f"{len(through)} transmittances", f"{len(depths)}")


def remembering(
    read: Callable[[int, int, int, int], HoldoutRows],
) -> Callable[[int, int, int, int], HoldoutRows]:
    """Return `read`, which all samples of a band ask for the same rows, reading them once."""
    last: dict[tuple[int, int, int, int], HoldoutRows] = {}

    def rows(x0: int, y0: int, x1: int, y1: int) -> HoldoutRows:
        window = x0, y0, x1, y1
        if window not in last:
            last.clear()
            last[window] = read(*window)
        return last[window]

    return rows
