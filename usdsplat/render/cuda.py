"""The GPU's rasterizer: the CPU's steps, or a fused path for colour alone in two recorded
launches."""

from __future__ import annotations

import weakref
from typing import Any

import numpy as np

from usdsplat.core.cloud import I32
from usdsplat.kernels.bins import grid_of
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.frame.picture import FrameGroup, FramePicture, FrameView
from usdsplat.render.cpu import CpuRasterizer
from usdsplat.render.draw_list import Group
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.frame_stats import FrameStats
from usdsplat.render.matte import is_matte
from usdsplat.render.projector import Projector
from usdsplat.render.rasterizer import WholeImage

MOST_PIXELS = 1 << 26
"""Largest picture that is drawn at once [pixel]. Larger ones are drawn in bands."""


class CudaRasterizer(CpuRasterizer):
    """Rasterizer that takes the CPU's steps with GPU kernels, or fuses them for colour alone."""

    def __init__(self, device: CudaDevice) -> None:
        super().__init__(device)
        self._cuda = device

    def draw_color(
        self,
        projector: Projector,
        matte: tuple[tuple[str, bool], ...],
        buffers: FrameBuffers,
        stats: FrameStats,
    ) -> WholeImage | None:
        """Return the picture, see `Rasterizer.draw_color`. Its pixels are valid until the next
        picture."""
        if not _is_color_alone(projector, matte):
            return None
        if not isinstance(buffers.fused, ColorPicture):
            buffers.fused = ColorPicture(self._cuda)
        return buffers.fused.draw(projector, stats)


class ColorPicture:
    """Fused path for colour alone, one picture at a time. It keeps its buffers."""

    def __init__(self, device: CudaDevice) -> None:
        self._device, self._picture = device, FramePicture(device)
        self._words = _Words()

    def draw(self, projector: Projector, stats: FrameStats) -> WholeImage | None:
        """Draw all splats of a view. Return None if they touch too many tiles; a band touches
        fewer."""
        layout, window = projector.layout, projector.window
        numbers = [projector.conversion(group) for group in layout.groups]
        view = FrameView(
            cameras=np.concatenate([projector.record(group) for group in layout.groups]),
            matrices=np.concatenate([projector.matrices(group) for group in layout.groups]),
            sights=np.concatenate([projector.sights(group) for group in layout.groups]),
            conversions=np.array([[*of, converts] for of, converts in numbers], np.float32),
            grid=grid_of(*window),
        )
        groups = [self._group(group, projector.degree(group)) for group in layout.groups]
        image = self._picture.draw(groups, view)
        if image is None:
            return None
        stats.splats, stats.total = layout.splats, layout.total
        stats.visible = self._picture.visible
        stats.pairs += self._picture.pairs
        return WholeImage(image, window[1], layout)

    def _group(self, group: Group, degree: int) -> Any:
        keep, cloud = self._device.keep, group.cloud
        laid = group.field.spatial_order.of(self._device, cloud)
        packed = group.field.spec.packed if group.rows is None else None
        arrays: tuple[Any, ...]
        if packed is None:
            arrays = laid.positions, laid.rotations, laid.scales, laid.opacities, cloud.sh
        else:
            words = self._words.of(packed.words, laid.rows)
            arrays = laid.positions, words, packed.harmonics, packed.color_range, packed.steps
        return FrameGroup(
            splats=tuple(keep(array) for array in (*arrays, laid.rows)),
            is_packed=packed is not None,
            boxes=keep(laid.boxes),
            instances=len(group.transforms),
            degree=degree,
        )


def _is_color_alone(projector: Projector, matte: tuple[tuple[str, bool], ...]) -> bool:
    """Return whether the fused path can draw the picture.

    It can if colours depend only on complete splats in one order for all pixels.
    """
    left, top, right, bottom = projector.window
    return (
        projector.settings.display_mode == "splats"
        and projector.settings.sorting in ("zDepth", "cameraDistance")
        and bool(projector.layout.groups)
        and not any(group.field.crops for group in projector.layout.groups)
        and not any(is_matte(path, matte) for path in projector.layout.prims)
        and 0 < (right - left) * (bottom - top) <= MOST_PIXELS
    )


class _Words:
    """Packed splats in spatial order, gathered once for each layout."""

    def __init__(self) -> None:
        self._taken: dict[int, tuple[weakref.ref[Any], I32, I32]] = {}
        """id(rows) -> (reference to the rows, input words, gathered words)."""

    def of(self, words: I32, rows: I32) -> I32:
        """Return the `rows` of `words`, or `words` itself if there are no rows."""
        if not len(rows):
            return words
        key, taken = id(rows), self._taken
        found = taken.get(key)
        # words contain colours too, which may change while no splat moves
        if found is None or found[0]() is not rows or found[1] is not words:
            gone = weakref.ref(rows, lambda _: taken.pop(key, None))
            found = taken[key] = gone, words, words[rows]
        return found[2]
