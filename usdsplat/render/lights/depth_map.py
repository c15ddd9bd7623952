"""Draw what a sample of a light sees: lists of splats by tile, and depths of surfaces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, F64
from usdsplat.kernels import bins, position, project
from usdsplat.kernels.casters import CASTER, enlarge
from usdsplat.render.buffers import Buffer, BufferGroup, Empty, KernelBuffers
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
NO_CASTERS: F32 = np.empty((0, CASTER), np.float32)
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
    casters: F32
    """Splats in the order of `casters.order_casters`, shape (n, CASTER)."""
    tiles: tuple[Any, ...]
    """The argument `tiles` of `lighting.illuminate`."""
    depths: F32
    """Depths of the surfaces, shape (h, w); empty if there are none."""

    @property
    def nbytes(self) -> int:
        """Memory that the arrays take [byte]."""
        arrays = (self.casters, *self.tiles, self.depths)
        return sum(int(np.prod(each.shape)) * each.dtype.itemsize for each in arrays)


class CasterBuffers(BufferGroup):
    """Splats that cast shadows, for their tile lists."""

    casters = Buffer(lambda slots: (slots, CASTER), np.float32)
    """Result of `casters.enlarge`, shape (slots, CASTER)."""
    enlarged = Buffer(lambda slots: (slots, project.RECORD), np.float32)
    """Records, see `casters.enlarge`, shape (slots, RECORD)."""


class MapBuffers:
    """Buffers of a depth map, which the next map that has them overwrites.

    Args:
        empty: See `FrameBuffers`.
    """

    def __init__(self, empty: Empty) -> None:
        self.frame, self.casters = FrameBuffers(empty), CasterBuffers(empty)
        self.receivers = KernelBuffers(empty)
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
    casters, tiles, depths = NO_CASTERS, _no_tiles(), NO_DEPTHS
    views = np.concatenate([NO_VIEW, NO_VIEW])
    if camera.splats is not None and layout.slots > 0:
        views[0] = camera.splats.view_record()[0]
        casters, tiles = _list_splats(rasterizer, buffers, camera.splats, layout)
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
        casters=casters,
        tiles=tiles,
        depths=depths,
    )


def _list_splats(
    rasterizer: Rasterizer, buffers: MapBuffers, screen: Screen, layout: DrawList
) -> tuple[F32, tuple[Any, ...]]:
    """Project all splats and list them by tile."""
    device = rasterizer.device
    projector = Projector(device, buffers.frame, layout, screen, SETTINGS, SPACE)
    projector.lay_out()
    projector.project()
    projector.find_ray_hits()
    projector.order_casters()
    found = projector.sort((), labels=False)
    records, hits = found.records, found.ray_hits
    numbers = np.arange(len(layout.labels), dtype=np.int32)
    appearances = projector.labelled(found.order, numbers)
    made, n = buffers.casters, records.shape[0]
    casters, enlarged = made.casters(n), made.enlarged(n)
    device.run(enlarge, records, hits, appearances, casters, enlarged)
    lists = rasterizer.bin(
        replace(found, records=enlarged), screen.window, Occluders(), buffers.frame,
        sort_by_ray_hit=False,
    )  # fmt: skip
    return casters, lists.arrays


def _no_tiles() -> tuple[Any, ...]:
    none = np.empty(0, np.int32)
    return np.zeros(2, np.int64), none, bins.grid_of(0, 0, 1, 1)
