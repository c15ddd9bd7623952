"""Display modes: dots, ellipses or normals in place of the splats.

They replace the splats before any pixel is drawn, so that AOVs, surfaces and holdouts treat them
like splats.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from usdsplat.core.cloud import I32
from usdsplat.kernels import display, feature, sort
from usdsplat.kernels.device import Device
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.projector import ProjectedSplats

RADIUS, SMALLEST = 1.5, 0.7
"""[pixel] of a dot: in the full picture, and the least in a coarse one."""


def displayed(
    device: Device, buffers: FrameBuffers, seen: ProjectedSplats, mode: str, pixel_scale: float
) -> ProjectedSplats:
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
        device.run(display.dots, seen.records, seen.ray_hits, radius)
    elif mode == "normals":
        device.run(display.directions, seen.records, seen.features, feature.NORMAL)
    elif mode == "ellipses":
        opaque = buffers.get("opaque", (seen.order.shape[0],), np.uint8)
        device.run(display.opaque, seen.records, opaque)
        ranks = np.flatnonzero(device.fetch(opaque)).astype(np.int32)
        seen = _taken(device, buffers, seen, np.repeat(ranks, 2))
        device.run(display.rings, seen.records)
    return seen


def _taken(
    device: Device, buffers: FrameBuffers, seen: ProjectedSplats, ranks: I32
) -> ProjectedSplats:
    """These of the splats, in this order."""

    places = device.keep(ranks)

    def rows(name: str, array: Any) -> Any:
        if array.shape[0] == 0:
            return array
        out = buffers.get(name, (len(ranks), array.shape[1]), array.dtype)
        device.run(sort.gather, places, array, out)
        return out

    def numbers(name: str, array: Any) -> Any:
        return rows(name, array.reshape((array.shape[0], 1))).reshape((-1,))

    return replace(
        seen,
        records=rows("shown", seen.records),
        order=numbers("shown order", seen.order),
        ray_hits=rows("shown ray hits", seen.ray_hits),
        features=rows("shown features", seen.features),
        keeps=numbers("shown keeps", seen.keeps),
        labels=numbers("shown labels", seen.labels),
    )
