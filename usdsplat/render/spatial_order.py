"""Reorder the splats of a large field along the Z-order curve, so that whole blocks can be culled.

A block of BLOCK splats then covers a small part of space with tight bounds. Only the arrays that
projection reads are copied. Other arrays are read by each visible splat's row in the field.

A field is reordered when the same splats are projected for the second time. The copy does not pay
for a single picture or for moving splats. Pictures do not depend on the order: splats of equal
depth are drawn in the order of their rows in the field, see `sort.settle`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, SplatCloud
from usdsplat.kernels import blocks, sort
from usdsplat.kernels.device import Device
from usdsplat.kernels.points.curve_order import curve_order
from usdsplat.kernels.project import BLOCK
from usdsplat.render.splat_budget import KEPT

LEAST = 16 * BLOCK
"""Number of splats of the smallest field that is reordered."""

PER_SPLAT = 4 * (3 + 4 + 3 + 1 + 1)
"""Bytes per splat in spatial order."""
MAKING = 4 * 4
"""Further bytes per splat while the order is computed."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class OrderedSplats:
    """Arrays of a field that projection reads, in the order of memory."""

    rows: I32
    """Row of each splat in the cloud, shape (n,); empty if the order is the cloud's own."""
    positions: F32
    rotations: F32
    scales: F32
    opacities: F32
    boxes: F32
    """Bounds of each block, shape (blocks, blocks.BOX); empty if blocks are not culled."""


def as_it_is(cloud: SplatCloud) -> OrderedSplats:
    """Return the cloud's own arrays, without bounds."""
    return OrderedSplats(
        rows=np.empty(0, np.int32),
        positions=cloud.positions,
        rotations=cloud.rotations,
        scales=cloud.scales,
        opacities=cloud.opacities,
        boxes=np.empty((0, blocks.BOX), np.float32),
    )


def laid_out(device: Device, cloud: SplatCloud) -> OrderedSplats:
    """Return the cloud in Z-order, with bounds of its blocks. The cloud is not empty."""
    rows = curve_order(device, cloud.positions)
    positions, rotations, scales = (
        _taken(device, rows, array) for array in (cloud.positions, cloud.rotations, cloud.scales)
    )
    opacities = _taken(device, rows, cloud.opacities[:, None])[:, 0]
    boxes = np.empty((-(-len(rows) // BLOCK), blocks.BOX), np.float32)
    device.run(blocks.boxes, positions, scales, opacities, boxes)
    return OrderedSplats(
        rows=rows,
        positions=positions,
        rotations=rotations,
        scales=scales,
        opacities=opacities,
        boxes=boxes,
    )


@dataclass(slots=True, eq=False)
class _Known:
    """Splats that were projected, and their order once it is computed."""

    positions: F32
    layout: OrderedSplats | None = None


class SpatialOrder:
    """Cache of one field's spatial order, computed when it pays.

    It keeps three orders, of the last splats, those before, and the most: a viewport draws all
    splats of a field at rest, and those of two budgets while it moves.
    """

    def __init__(self) -> None:
        self._known: list[_Known] = []
        """The last splats first."""

    @property
    def is_made(self) -> bool:
        """Whether the last order in memory differs from the order of rows."""
        layout = self._known[0].layout if self._known else None
        return layout is not None and layout.rows.size > 0

    def forget(self) -> None:
        """Drop the orders; the splats have changed."""
        self._known = []

    def of(self, device: Device, cloud: SplatCloud) -> OrderedSplats:
        """Return the splats of `cloud` in the order to use for the next projection."""
        others = [each for each in self._known if each.positions is not cloud.positions]
        found = next((each for each in self._known if each not in others), None)
        most = max(others, key=lambda each: len(each.positions), default=None)
        last = found or _Known(cloud.positions)
        before = [each for each in others if each is not most][: KEPT - 1]
        self._known = [last, *before, *([] if most is None else [most])]
        if found is None:
            return as_it_is(cloud)
        if last.layout is None:
            last.layout = laid_out(device, cloud) if len(cloud) >= LEAST else as_it_is(cloud)
        return last.layout


class StorageOrder(SpatialOrder):
    """The order of rows, for splats that are culled as a whole."""

    def __init__(self) -> None:
        super().__init__()
        self._layout: OrderedSplats | None = None

    def forget(self) -> None:
        """Drop the arrays; the splats have changed."""
        self._layout = None

    def of(self, device: Device, cloud: SplatCloud) -> OrderedSplats:
        """Return the splats of `cloud` as they are."""
        if self._layout is None:
            self._layout = as_it_is(cloud)
        return self._layout


# --- private -------------------------------------------------------------------------------


def _taken(device: Device, rows: I32, array: F32) -> npt.NDArray[np.float32]:
    out = np.empty(array.shape, np.float32)
    device.run(sort.gather, rows, device.upload(array), out)
    return out
