"""Draw what a sample of a light sees: lists of splats by tile, and depths of surfaces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, F64, I32
from usdsplat.kernels import bins, lighting, position, project
from usdsplat.render.buffers import Buffer, BufferGroup, Empty
from usdsplat.render.draw_list import DrawList
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.lights.cameras import LightCamera
from usdsplat.render.occluders import Occluders
from usdsplat.render.projector import Projector
from usdsplat.render.rasterizer import Rasterizer
from usdsplat.render.scene import RenderScene
from usdsplat.render.screen import Screen
from usdsplat.render.settings import RenderSettings
from usdsplat.render.surface_cache import SurfaceCache
from usdsplat.render.surfaces import Surfaces

SETTINGS = RenderSettings(sorting="zDepth", rasterize_mode="classic")
"""Settings of the pictures of lights."""
SPACE = "lin_rec709_scene"
NO_RECORDS = (
    np.empty((0, 12), np.float32), np.empty((0, 8), np.float32), np.empty(0, np.int32),
)  # fmt: skip
NO_DEPTHS: F32 = np.empty((0, 0), np.float32)
NO_VIEW = np.ones(1, position.VIEW)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DepthMap:
    """What one camera of a light sees, as arrays of the device."""

    light: npt.NDArray[Any]
    """The LIGHT record."""
    world_to_screen: F64
    views: npt.NDArray[Any]
    """VIEW records of both pictures, shape (2,)."""
    splats: tuple[F32, F32, I32]
    """Records, ray hits and appearances of the splats in order of depth."""
    tiles: tuple[Any, ...]
    """The argument `tiles` of `lighting.illuminate`."""
    depths: F32
    """Depths of the surfaces, shape (h, w); empty if there are none."""

    @property
    def nbytes(self) -> int:
        """Memory that the arrays take [byte]."""
        arrays = (*self.splats, *self.tiles, self.depths)
        return sum(int(np.prod(each.shape)) * each.dtype.itemsize for each in arrays)


class CasterBuffers(BufferGroup):
    """Splats that cast shadows, for their tile lists."""

    enlarged = Buffer(lambda slots: (slots, project.RECORD), np.float32)
    """Records, see `lighting.enlarge`, shape (slots, RECORD)."""
    limits = Buffer(lambda pairs: (pairs,), np.float32)
    """Depths, see `lighting.nearest_ahead`, shape (pairs,)."""


class MapBuffers:
    """Buffers of a depth map, which the next map that has them overwrites.

    Args:
        empty: See `FrameBuffers`.
    """

    def __init__(self, empty: Empty) -> None:
        self.frame, self.casters = FrameBuffers(empty), CasterBuffers(empty)
        self.last = 0
        """Size of the last map [byte]."""


def draw_depth_map(
    rasterizer: Rasterizer,
    camera: LightCamera,
    scene: RenderScene,
    layout: DrawList,
    casts: Callable[[str], bool],
    meshes: SurfaceCache,
    buffers: MapBuffers,
) -> DepthMap:
    """Draw the casters that a camera of a light sees.

    Args:
        layout: The splats.
        casts: Whether the mesh at a path casts shadows.
        meshes: Keeps the layout of the meshes for the next picture.
        buffers: Hold the result.
    """
    device = rasterizer.device
    splats, tiles, depths = NO_RECORDS, _no_tiles(), NO_DEPTHS
    views = np.concatenate([NO_VIEW, NO_VIEW])
    if camera.splats is not None and layout.slots > 0:
        views[0] = camera.splats.view_record()[0]
        splats, tiles = _list_splats(rasterizer, buffers, camera.splats, layout)
    if camera.surfaces is not None:
        views[1] = camera.surfaces.view_record()[0]
        views[0]["is_parallel"] = views[1]["is_parallel"]
        drawn = Surfaces.of(
            device, scene, camera.surfaces, cache=meshes, shows=casts, is_two_sided=True
        )
        if drawn is not None:
            depths = drawn.draw_depths(buffers.frame)
    return DepthMap(
        light=camera.light,
        world_to_screen=camera.world_to_screen,
        views=views,
        splats=splats,
        tiles=tiles,
        depths=depths,
    )


def _list_splats(
    rasterizer: Rasterizer, buffers: MapBuffers, screen: Screen, layout: DrawList
) -> tuple[tuple[F32, F32, I32], tuple[Any, ...]]:
    """Project all splats and list them by tile."""
    device = rasterizer.device
    projector = Projector(device, buffers.frame, layout, screen, SETTINGS, SPACE)
    projector.lay_out()
    projector.project()
    projector.find_ray_hits()
    found = projector.sort((), labels=False)
    records, hits = found.records, found.ray_hits
    numbers = np.arange(len(layout.labels), dtype=np.int32)
    appearances = projector.labelled(found.order, numbers)
    enlarged = buffers.casters.enlarged(records.shape[0])
    device.run(lighting.enlarge, records, hits, enlarged)
    lists = rasterizer.bin(
        replace(found, records=enlarged), screen.window, Occluders(), buffers.frame,
        sort_by_ray_hit=False,
    )  # fmt: skip
    starts, rows, grid = lists.arrays
    limits = buffers.casters.limits(rows.shape[0])
    device.run(lighting.nearest_ahead, starts[1:], starts, rows, hits, limits)
    return (records, hits, appearances), (starts, rows, limits, grid)


def _no_tiles() -> tuple[Any, ...]:
    none = np.empty(0, np.int32)
    return np.zeros(2, np.int64), none, none.astype(np.float32), bins.grid_of(0, 0, 1, 1)
