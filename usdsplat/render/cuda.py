"""The GPU's rasterizer: the CPU's steps, or a fused path for colour alone in two recorded
launches."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np

from usdsplat.core.cloud import I32, SplatCloud
from usdsplat.kernels.bins import grid_of
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.frame.groups import NO_PARTS, FrameGroup, FrameNodes, FrameView
from usdsplat.kernels.cuda.frame.picture import FramePicture
from usdsplat.kernels.cuda.frame.pool import NodePool
from usdsplat.render.cpu import CpuRasterizer
from usdsplat.render.cuda_nodes import NodeRun, planned
from usdsplat.render.draw_list import DrawList, Group
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
    """Fused path for colour alone, one picture at a time. It keeps its buffers.

    Nodes of splat trees are drawn from a memory of their own, in one launch for all consecutive
    ones that are alike.
    """

    def __init__(self, device: CudaDevice) -> None:
        self._device, self._picture = device, FramePicture(device)
        self._words = _Words()
        self._pools: dict[int, NodePool] = {}
        """Number of coefficients of the harmonics -> nodes."""
        self._plan: tuple[weakref.ref[Any] | None, list[int | NodeRun]] = None, []

    def draw(self, projector: Projector, stats: FrameStats) -> WholeImage | None:
        """Draw all splats of a view. Return None if they touch too many tiles; a band touches
        fewer."""
        layout, window = projector.layout, projector.window
        plan = self._planned(layout, projector.settings.node_bytes)
        heads = [layout.groups[each.head if isinstance(each, NodeRun) else each] for each in plan]
        groups: list[FrameGroup | FrameNodes] = []
        matrices, sights, parts = [], [], []
        for each, head in zip(plan, heads, strict=True):
            degree = projector.degree(head)
            if isinstance(each, NodeRun):
                groups.append(each.frame_nodes(self._pools[each.coefficients].arrays, degree))
                matrices.append(projector.to_camera(each.placements))
                sights.append(projector.sights(each.placements))
                parts.append(each.drawn(layout.weights))
            else:
                groups.append(self._group(head, degree))
                matrices.append(projector.matrices(head))
                sights.append(projector.sights(head.placements))
        numbers = [projector.conversion(head) for head in heads]
        view = FrameView(
            cameras=np.concatenate([projector.record(head) for head in heads]),
            matrices=np.concatenate(matrices),
            sights=np.concatenate(sights),
            conversions=np.array([[*of, converts] for of, converts in numbers], np.float32),
            grid=grid_of(*window),
            parts=np.concatenate(parts) if parts else NO_PARTS,
        )
        image = self._picture.draw(groups, view)
        if image is None:
            return None
        stats.splats, stats.total = layout.splats, layout.total
        stats.visible = self._picture.visible
        stats.pairs += self._picture.pairs
        return WholeImage(image, window[1], layout)

    def _planned(self, layout: DrawList, limit: int) -> list[int | NodeRun]:
        """Return what a picture draws, see `planned`; its nodes are then on the device.

        The samples of a picture share the plan. It holds no splats of the host, which may drop them
        between pictures.
        """
        reference, plan = self._plan
        if reference is None or reference() is not layout.placed:
            self._plan = None, []  # its nodes may leave

            def pages_of(coefficients: int, clouds: Sequence[SplatCloud]) -> list[I32]:
                # a pool that fails, for lack of memory, is dropped
                pool = self._pools.pop(coefficients, None)
                if pool is None:
                    pool = NodePool(self._device, coefficients, self._picture.release)
                pages = pool.pages_of(clouds, limit)
                self._pools[coefficients] = pool
                return pages

            before = [each for each in plan if isinstance(each, NodeRun)]
            plan = planned(layout, pages_of, before)
            self._plan = weakref.ref(layout.placed), plan
        return plan

    def _group(self, group: Group, degree: int) -> FrameGroup:
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
            instances=group.instances,
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
