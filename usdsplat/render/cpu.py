"""The CPU's rasterizer, which takes each step separately for each band."""

from __future__ import annotations

from usdsplat.core.cancel import CancelToken
from usdsplat.kernels.cancellable import CancellableCpu
from usdsplat.kernels.device import CpuDevice, Device
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.frame_stats import FrameStats
from usdsplat.render.occluders import Occluders
from usdsplat.render.projected_splats import ProjectedSplats
from usdsplat.render.projector import Projector
from usdsplat.render.rasterizer import WholeImage
from usdsplat.render.tile_lists import TileLists


class CpuRasterizer:
    """Rasterizer that takes the steps of a frame one by one."""

    def __init__(self, device: Device) -> None:
        self.device = device

    def until(self, cancel: CancelToken) -> CpuRasterizer:
        """Return a rasterizer that launches long kernels in parts, see `Rasterizer.until`; itself
        for a GPU, where no launch takes long."""
        if not isinstance(self.device, CpuDevice):
            return self
        return CpuRasterizer(CancellableCpu(self.device, cancel))

    def draw_color(
        self,
        projector: Projector,
        matte: tuple[tuple[str, bool], ...],
        buffers: FrameBuffers,
        stats: FrameStats,
    ) -> WholeImage | None:
        """Return None: the steps are not fused."""
        return None

    def bin(
        self,
        splats: ProjectedSplats,
        window: tuple[int, int, int, int],
        occluders: Occluders,
        buffers: FrameBuffers,
        *,
        sort_by_ray_hit: bool,
    ) -> TileLists:
        """Return the tile lists of a band, see `Rasterizer.bin`."""
        return TileLists(
            self.device, buffers, splats, window, occluders, sort_by_ray_hit=sort_by_ray_hit
        )
