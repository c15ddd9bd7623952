"""Display modes: draw dots, ellipses or normals instead of the splats.

Splats are replaced before any pixel is drawn. AOVs, surfaces and holdouts treat the replacements
like splats.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from usdsplat.core.cloud import I32
from usdsplat.kernels import display, feature, sort
from usdsplat.kernels.device import Device
from usdsplat.render.buffers import Memory
from usdsplat.render.frame_buffers import DisplayBuffers
from usdsplat.render.projected_splats import ProjectedSplats

RADIUS, SMALLEST = 1.5, 0.7
"""Radius of a dot [pixel]: in the full picture, and the minimum in a coarse preview."""


def displayed(
    device: Device, buffers: DisplayBuffers, seen: ProjectedSplats, mode: str, pixel_scale: float
) -> ProjectedSplats:
    """Return the splats that a display mode draws instead of the visible ones.

    Args:
        seen: The visible splats; for "normals" with features. Their arrays may be changed.
        mode: One of `RenderSettings.display_mode`.
        pixel_scale: See `Framing.pixel_scale`.
    """
    if seen.order.shape[0] == 0:
        return seen
    if mode == "points":
        radius = np.float32(max(RADIUS / pixel_scale, SMALLEST))
        device.run(display.dots, seen.records, seen.ray_hits, radius)
    elif mode == "normals":
        device.run(display.directions, seen.records, seen.features, feature.AXIS)
    elif mode == "ellipses":
        opaque = buffers.opaque(seen.order.shape[0])
        device.run(display.opaque, seen.records, opaque)
        ranks = np.flatnonzero(device.fetch(opaque)).astype(np.int32)
        seen = _taken(device, buffers, seen, np.repeat(ranks, 2))
        device.run(display.rings, seen.records)
    return seen


def _taken(
    device: Device, buffers: DisplayBuffers, seen: ProjectedSplats, ranks: I32
) -> ProjectedSplats:
    """Return the splats of these ranks, in this order."""

    places = device.keep(ranks)

    def rows(buffer: Memory, array: Any) -> Any:
        if array.shape[0] == 0:
            return array
        out = buffer(len(ranks))
        if array.ndim == 1:
            array, table = array.reshape((array.shape[0], 1)), out.reshape((len(ranks), 1))
        else:
            table = out
        device.run(sort.gather, places, array, table)
        return out

    return replace(
        seen,
        records=rows(buffers.records, seen.records),
        order=rows(buffers.order, seen.order),
        ray_hits=rows(buffers.ray_hits, seen.ray_hits),
        features=rows(buffers.features, seen.features),
        keeps=rows(buffers.keeps, seen.keeps),
        labels=rows(buffers.labels, seen.labels),
    )
