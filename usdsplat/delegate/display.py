"""What is drawn of each splat when it is not the splat itself.

The dots, ellipses and colours take the place of the splats before any pixel is touched, so all
AOVs, surfaces and holdouts see them as they would see splats.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import I32
from usdsplat.delegate.scratch import Scratch
from usdsplat.delegate.visible import Visible
from usdsplat.kernels import display, feature, project, sort
from usdsplat.kernels.device import Device

RADIUS, SMALLEST = 1.5, 0.7
"""[pixel] of a dot: in the full picture, and the least in a coarse one."""


def displayed(
    device: Device, scratch: Scratch, seen: Visible, mode: str, pixel_scale: float
) -> Visible:
    """Return what a display mode draws in place of the splats.

    Args:
        seen: The splats; for "normals" with features. Its arrays may be changed.
        mode: One of `RenderSettings.display_mode`.
        pixel_scale: As `Framing` has it.
    """
    if len(seen.order) == 0:
        return seen
    if mode == "points":
        radius = np.float32(max(RADIUS / pixel_scale, SMALLEST))
        device.run(display.dots, seen.records, seen.peaks, radius)
    elif mode == "normals":
        device.run(display.directions, seen.records, seen.features, feature.NORMAL)
    elif mode == "ellipses":
        opaque = seen.records[:, project.LOG_OPACITY] > np.log(display.FAINTEST)
        seen = _taken(device, scratch, seen, np.repeat(np.flatnonzero(opaque).astype(np.int32), 2))
        device.run(display.rings, seen.records)
    return seen


def _taken(device: Device, scratch: Scratch, seen: Visible, ranks: I32) -> Visible:
    """These of the splats, in this order."""

    def rows(name: str, array: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        if len(array) == 0:
            return array
        out = scratch.get(name, (len(ranks), array.shape[1]), np.float32)
        device.run(sort.gather, ranks, array, out)
        return out

    return replace(
        seen,
        records=rows("shown", seen.records),
        order=seen.order[ranks],
        peaks=rows("shown peaks", seen.peaks),
        features=rows("shown features", seen.features),
        keeps=seen.keeps[ranks] if seen.keeps.size else seen.keeps,
        labels=seen.labels[ranks] if seen.labels.size else seen.labels,
    )
