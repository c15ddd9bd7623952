"""Occluders of a band's splats: surfaces of the scene, and an external holdout."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I64
from usdsplat.core.errors import UsageError
from usdsplat.kernels import surface
from usdsplat.kernels.device import Device
from usdsplat.render.frame_buffers import PixelBuffers

DeepHoldout = tuple[I64, F32, F32]
"""A holdout that hides in part: nodes of the transmittance along each pixel's ray, which is
log-linear between nodes: offsets of the pixels' nodes, depths and transmittances, see
`kernels.walk`."""
NO_HOLDOUT: DeepHoldout = (
    np.empty(0, np.int64),
    np.empty(0, np.float32),
    np.empty(0, np.float32),
)
for _each in NO_HOLDOUT:
    _each.flags.writeable = (
        False  # like arrays kept by a device, so that kernels are compiled for one type only
    )
NO_DEPTH = np.empty((0, 0), np.float32)
NO_COVER = np.empty((0, 0), np.uint8)

HoldoutRows = F32 | DeepHoldout | tuple[F32, DeepHoldout]
"""Holdout of some rows: planar depths, +inf where nothing is, shape (h, w); or nodes; or both, for
a flat picture some of whose pixels hide only in part."""


ReadHoldout = Callable[[int, int, int, int], HoldoutRows]
"""Read an external holdout in the pixels x0, y0, x1, y1."""


@dataclass(frozen=True, slots=True, eq=False)
class Occluders:
    """Occluders behind or between the splats of a band. Arrays belong to the device."""

    depth: F32 = field(default_factory=lambda: NO_DEPTH)
    """Planar depth of surfaces, +inf where there is none, shape (h, w); empty without surfaces."""
    covered: npt.NDArray[np.uint8] = field(default_factory=lambda: NO_COVER)
    """Kind of surface, see `kernels.surface`, shape (h, w); empty without surfaces."""
    holdout: DeepHoldout = NO_HOLDOUT

    def rows(self, first: int, end: int, width: int) -> Occluders:
        """Return the occluders of rows `first` to `end` - 1 of a band of `width` columns."""
        offsets, depths, through = self.holdout
        held = offsets[first * width : end * width + 1], depths, through
        return Occluders(self.depth[first:end], self.covered[first:end], held)


def with_holdout(
    device: Device,
    buffers: PixelBuffers,
    occluders: Occluders,
    rows: HoldoutRows,
    shape: tuple[int, int],
) -> Occluders:
    """Return the occluders of a band with a holdout added.

    Depths hide everything behind them; nodes hide in part.

    Args:
        shape: Rows and columns of the band.

    Raises:
        UsageError: If the holdout has another shape.
    """
    if isinstance(rows, tuple) and len(rows) == 2:
        for each in rows:
            occluders = with_holdout(device, buffers, occluders, each, shape)
        return occluders
    _check(rows, shape)
    if isinstance(rows, tuple):
        offsets, depths, through = rows
        kept = device.keep(offsets), device.keep(depths), device.keep(through)
        return Occluders(occluders.depth, occluders.covered, kept)
    if occluders.depth.size == 0:
        depth = buffers.holdout_depth(*shape)
        occluders = Occluders(depth, buffers.holdout_covered(*shape), occluders.holdout)
        device.run(surface.clear, occluders.depth, occluders.covered)
    device.run(surface.hold_back, occluders.depth, occluders.covered, device.upload(rows))
    return occluders


def _check(rows: F32 | DeepHoldout, shape: tuple[int, int]) -> None:
    """Raise an error if a holdout has the wrong size, because kernels would read past its end."""
    if not isinstance(rows, tuple):
        if rows.shape != shape:
            raise UsageError("holdout", f"depths of shape {rows.shape}", str(shape))
        return
    offsets, depths, through = rows
    pixels = shape[0] * shape[1]
    if len(offsets) != pixels + 1:
        raise UsageError("holdout", f"{len(offsets)} offsets", f"{pixels + 1}")
    if offsets[0] != 0 or (np.diff(offsets) < 0).any() or offsets[-1] != len(depths):
        raise UsageError(
            "holdout", "offsets that do not match the nodes", f"0 to {len(depths)}, ascending"
        )
    if len(through) != len(depths):
        raise UsageError("holdout", f"{len(through)} transmittances", f"{len(depths)}")


def remembering(read: ReadHoldout) -> ReadHoldout:
    """Return `read` with its last result cached, because all samples of a band read the same
    rows."""
    last: dict[tuple[int, int, int, int], HoldoutRows] = {}

    def rows(x0: int, y0: int, x1: int, y1: int) -> HoldoutRows:
        window = x0, y0, x1, y1
        if window not in last:
            last.clear()
            last[window] = read(*window)
        return last[window]

    return rows
