"""Colour alone, of splats alone: what most pictures are, and what a GPU draws without the host.

Nothing else of a picture is known then: neither who is where nor how deep. All else is `Layer`'s.
"""

from __future__ import annotations

import weakref
from typing import Any

import numpy as np

from usdsplat.core.cloud import I32
from usdsplat.delegate.draw_list import DrawList, Group
from usdsplat.delegate.frame_stats import FrameStats
from usdsplat.delegate.matte import is_matte
from usdsplat.delegate.visible import Look
from usdsplat.kernels.bins import grid_of
from usdsplat.kernels.device import Device

MOST_PIXELS = 1 << 26
"""[pixel] of the largest picture that is drawn whole; beyond it goes band after band."""


def is_plain(look: Look, matte: tuple[tuple[str, bool], ...]) -> bool:
    """Whether the splats of a look are all that decides its colours, and in one order."""
    left, top, right, bottom = look.window
    return (
        look.settings.display_mode == "splats"
        and look.settings.sorting in ("zDepth", "cameraDistance")
        and bool(look.layout.groups)
        and not any(group.field.crops for group in look.layout.groups)
        and not any(is_matte(path, matte) for path in look.layout.prims)
        and 0 < (right - left) * (bottom - top) <= MOST_PIXELS
    )


class PlainSplats:
    """The splats of a view, drawn whole."""

    def __init__(self, image: Any, top: int, layout: DrawList) -> None:
        self._image, self._top = image, top
        self.layout = layout

    def rows(self, y0: int, y1: int) -> Any:
        """Premultiplied RGBA in the blend space of rows y0 to y1 - 1, shape (h, w, 4) of the
        device."""
        return self._image[y0 - self._top : y1 - self._top]


class PlainPicture:
    """Draws on one GPU, whose buffers it keeps; one picture at a time."""

    def __init__(self, device: Device) -> None:
        from usdsplat.kernels.cuda.device import CudaDevice
        from usdsplat.kernels.cuda.frame.picture import FramePicture

        assert isinstance(device, CudaDevice)
        self._device, self._picture = device, FramePicture(device)
        self._words = _Words()

    def draw(self, look: Look, stats: FrameStats) -> PlainSplats | None:
        """Draw all splats of a look; the pixels stay until the next one. None where they touch too
        many tiles for one picture: a band of it has fewer."""
        from usdsplat.kernels.cuda.frame.picture import FrameView

        layout, window = look.layout, look.window
        numbers = [look.conversion(group) for group in layout.groups]
        view = FrameView(
            cameras=np.concatenate([look.record(group) for group in layout.groups]),
            matrices=np.concatenate([look.matrices(group) for group in layout.groups]),
            sights=np.concatenate([look.sights(group) for group in layout.groups]),
            conversions=np.array([[*of, converts] for of, converts in numbers], np.float32),
            grid=grid_of(*window),
        )
        groups = [self._group(group, look.degree(group)) for group in layout.groups]
        image = self._picture.draw(groups, view)
        if image is None:
            return None
        stats.splats, stats.total = layout.splats, layout.total
        stats.visible = self._picture.visible
        stats.pairs += self._picture.pairs
        return PlainSplats(image, window[1], layout)

    def _group(self, group: Group, degree: int) -> Any:
        from usdsplat.kernels.cuda.frame.picture import FrameGroup

        keep, cloud = self._device.keep, group.cloud
        laid = group.field.laying.of(self._device, cloud)
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


class _Words:
    """Packed splats in the order of memory, taken once for each layout."""

    def __init__(self) -> None:
        self._taken: dict[int, tuple[weakref.ref[Any], I32, I32]] = {}
        """Identity of rows -> they, the words that were taken, and what that gave."""

    def of(self, words: I32, rows: I32) -> I32:
        """Rows of `words`, all of them as they are where there are no `rows`."""
        if not len(rows):
            return words
        key, taken = id(rows), self._taken
        found = taken.get(key)
        # colours are in the words too: they may be others while no splat moves
        if found is None or found[0]() is not rows or found[1] is not words:
            gone = weakref.ref(rows, lambda _: taken.pop(key, None))
            found = taken[key] = gone, words, words[rows]
        return found[2]
