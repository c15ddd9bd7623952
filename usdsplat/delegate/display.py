"""What is drawn of each splat when it is not the splat itself.

The dots, ellipses and colours take the place of the splats before any pixel is touched, so all
AOVs, surfaces and holdouts see them as they would see splats.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from usdsplat.core.cloud import I32
from usdsplat.delegate.scratch import Scratch
from usdsplat.delegate.visible import Visible
from usdsplat.kernels import display, feature, sort
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
    if seen.order.shape[0] == 0:
        return seen
    if mode == "points":
        radius = np.float32(max(RADIUS / pixel_scale, SMALLEST))
        device.run(display.dots, seen.records, seen.peaks, radius)
    elif mode == "normals":
        device.run(display.directions, seen.records, seen.features, feature.NORMAL)
    elif mode == "ellipses":
        opaque = scratch.get("opaque", (seen.order.shape[0],), np.uint8)
        device.run(display.opaque, seen.records, opaque)
        ranks = np.flatnonzero(device.fetch(opaque)).astype(np.int32)
        seen = _taken(device, scratch, seen, np.repeat(ranks, 2))
        device.run(display.rings, seen.records)
    return seen


def _taken(device: Device, scratch: Scratch, seen: Visible, ranks: I32) -> Visible:
    """These of the splats, in this order."""

    places = device.keep(ranks)

    def rows(name: str, array: Any) -> Any:
        if array.shape[0] == 0:
            return array
        out = scratch.get(name, (len(ranks), array.shape[1]), array.dtype)
        device.run(sort.gather, places, array, out)
        return out

    def numbers(name: str, array: Any) -> Any:
        return rows(name, array.reshape((array.shape[0], 1))).reshape((-1,))

    return replace(
        seen,
        records=rows("shown", seen.records),
        order=numbers("shown order", seen.order),
        peaks=rows("shown peaks", seen.peaks),
        features=rows("shown features", seen.features),
        keeps=numbers("shown keeps", seen.keeps),
        labels=numbers("shown labels", seen.labels),
    )
