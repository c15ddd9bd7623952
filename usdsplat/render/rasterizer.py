"""Define the protocol of a rasterizer: the steps of a frame that differ between devices.

`frame.py` calls these steps. The projector and the tile lists launch kernels through `Device.run`,
which selects the kernel for the device.
"""

from __future__ import annotations

from typing import Any, Protocol

from usdsplat.core.cancel import CancelToken
from usdsplat.kernels.device import Device
from usdsplat.render.draw_list import DrawList
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.frame_stats import FrameStats
from usdsplat.render.occluders import Occluders
from usdsplat.render.projected_splats import ProjectedSplats
from usdsplat.render.projector import Projector
from usdsplat.render.tile_lists import TileLists


class WholeImage:
    """Picture of all splats of a view, drawn at once.

    Args:
        image: Premultiplied RGBA in the blend space, shape (h, w, 4), on the device.
        top: First row of the image [pixel].
    """

    def __init__(self, image: Any, top: int, layout: DrawList) -> None:
        self._image, self._top = image, top
        self.layout = layout

    def rows(self, y0: int, y1: int) -> Any:
        """Return rows y0 to y1 - 1."""
        return self._image[y0 - self._top : y1 - self._top]


class Rasterizer(Protocol):
    """Rasterizer of splats on one device. Arrays of its results belong to the device."""

    @property
    def device(self) -> Device:
        """The device that draws."""

    def until(self, cancel: CancelToken) -> Rasterizer:
        """Return this rasterizer for a picture that a token cancels, also within long stages."""

    def draw_color(
        self,
        projector: Projector,
        matte: tuple[tuple[str, bool], ...],
        buffers: FrameBuffers,
        stats: FrameStats,
    ) -> WholeImage | None:
        """Draw colour alone with all steps fused, if the device can.

        It is called for a picture of splats without surfaces, holdout and further AOVs.

        Returns:
            The picture; None if the steps must be taken one by one.
        """

    def bin(
        self,
        splats: ProjectedSplats,
        window: tuple[int, int, int, int],
        occluders: Occluders,
        buffers: FrameBuffers,
        *,
        sort_by_ray_hit: bool,
    ) -> TileLists:
        """List the splats that touch each tile of a band.

        Args:
            window: Pixels x0, y0, x1, y1 of the band, end exclusive.
            sort_by_ray_hit: Whether the splats of each pixel are sorted by their ray hits.

        Raises:
            UsageError: If splats touch 2**31 tiles or more.
        """
