"""Shine lights on receivers, with depth maps that are kept between pictures."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.kernels import domes, light_lanes, lighting, total
from usdsplat.render.draw_list import DrawList
from usdsplat.render.lights.cameras import LightCamera, bounds_of, cameras_of
from usdsplat.render.lights.depth_map import DepthMap, MapBuffers, draw_depth_map
from usdsplat.render.lights.dome import peak_lights, smooth_light
from usdsplat.render.lights.light_steps import unnoticed
from usdsplat.render.lights.sampling import samples_of
from usdsplat.render.lights.specs import LightSpec, Rules
from usdsplat.render.matte import is_matte
from usdsplat.render.rasterizer import Rasterizer
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.surface_cache import SurfaceCache

KEPT_BYTES = 512 << 20
"""Maximum size of the depth maps that are kept [byte]."""
DOME_RESOLUTION = 512
"""Maximum size of the pictures that a direction of a dome takes of meshes [pixel]. It stands for a
part of the sky, whose shadows have no sharp edges."""
NO_SUMS: F32 = np.empty((0, lighting.SUMS), np.float32)

Seen = tuple[tuple[Any, ...], int, Rules]
"""What a light sees: place or direction, kind, shadows and face of its camera; the resolution; and
its casters. Colours are no part of it."""
Maps = OrderedDict[Seen, tuple[Any, DepthMap]]
"""What a light sees -> what the map depends on besides, and the map; last used last."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Receivers:
    """Places that receive light, and their sums."""

    places: tuple[Any, ...]
    """(points, normals, shapes, prims), see `lighting.illuminate`."""
    linked: Any
    """Whether the light is linked to each prim, shape (prims,) u8."""
    own: int
    """Appearance that does not shadow them, or ALL_APPEARANCES."""
    sums: Any
    """Receives the light, shape (n, SUMS) f32."""
    seen: Any = None
    """Buffer of the same shape for the visible part of domes; None to allocate it."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LightMaps:
    """What the lights of a scene see, and the light that they send."""

    rasterizer: Rasterizer
    settings: RenderSettings
    scene: RenderScene
    casters: DrawList
    """Splats that cast shadows."""
    catches: Callable[[str], bool]
    """Whether the prim at a path is a shadow catcher."""
    version: Any
    """What maps depend on besides lights; the splat budget of the casters is last."""
    kept: Maps
    meshes: SurfaceCache
    buffers: MapBuffers
    """Buffers of maps that are not kept."""
    draws: bool = True
    """Whether maps that are drawn are kept, and those of another splat budget are not good
    enough."""

    def shine(
        self,
        light: LightSpec,
        receivers: Sequence[Receivers],
        *,
        casts: bool,
        step: Callable[[], None] = unnoticed,
    ) -> None:
        """Add a light to the sums of receivers.

        Args:
            casts: Whether there are shadows.
            step: Called after each camera of the light.
        """
        if light.kind != "dome":
            for each in self._maps(light, self.settings.light_samples, casts=casts):
                for one in receivers:
                    self._illuminate(each, light, one, one.sums)
                step()
            return
        self._shine_sky(light, receivers, casts=casts and light.shadow.enable, step=step)
        for peak in peak_lights(light):
            self.shine(peak, receivers, casts=casts, step=step)

    def steps(self, light: LightSpec) -> int:
        """Return the number of cameras of a light, without those of a dome's peaks."""
        how = self.settings
        samples = how.dome_samples if light.kind == "dome" else how.light_samples
        return sum(1 for _ in self._cameras(light, samples, casts=True))

    def are_kept(self, light: LightSpec) -> bool:
        """Return whether the light shines on surfaces without maps to draw. A dome has too many for
        a movement, even where they are kept."""
        return light.kind != "dome" and all(
            self._kept(camera, light, resolution) is not None
            for camera, resolution, _ in self._cameras(
                light, self.settings.light_samples, casts=True
            )
        )

    def _shine_sky(
        self,
        light: LightSpec,
        receivers: Sequence[Receivers],
        *,
        casts: bool,
        step: Callable[[], None],
    ) -> None:
        """Add the light of a dome without its peaks."""
        device = self.rasterizer.device
        seen = [NO_SUMS for _ in receivers]
        if casts:
            seen = [
                device.resident(one.sums.shape, np.float32) if one.seen is None else one.seen
                for one in receivers
            ]
            for sums in seen:
                device.run(total.clear, by_pixel(sums))
            for each in self._maps(light, self.settings.dome_samples, casts=True):
                for one, sums in zip(receivers, seen, strict=True):
                    self._illuminate(each, light, one, sums)
                step()
        mean, ratios = smooth_light(light)
        for one, sums in zip(receivers, seen, strict=True):
            _, normals, _, prims = one.places
            device.run(domes.add_dome, mean, ratios, normals, prims, one.linked, sums, one.sums)

    def _maps(self, light: LightSpec, samples: int, *, casts: bool) -> Iterator[DepthMap]:
        """Yield the depth map of each camera of a light."""
        for camera, resolution, count in self._cameras(light, samples, casts=casts):
            yield self._map(camera, light, resolution, count)

    def _cameras(
        self, light: LightSpec, samples: int, *, casts: bool
    ) -> Iterator[tuple[LightCamera, int, int]]:
        """Yield each camera of a light, its resolution, and the number of the light's samples."""
        bounds, resolution = bounds_of(self.scene), self.settings.shadow_resolution
        if light.kind == "dome":
            resolution = min(resolution, DOME_RESOLUTION)
        records = samples_of(light, samples)
        for record in records:
            if light.kind == "dome" and not _shines(record):
                continue
            one = record[None].copy()
            one["casts"] &= casts
            for camera in cameras_of(one, bounds, resolution):
                yield camera, resolution, len(records)

    def _map(
        self, camera: LightCamera, light: LightSpec, resolution: int, samples: int
    ) -> DepthMap:
        """Return the depth map of a camera, drawn if it is not kept. Maps of a light are not kept
        if not all of them can be: the first ones would be gone when they are needed again. Nor
        are those of a picture that does not wait, which keeps the maps of others."""
        maps, key = self.kept, _key(camera, light, resolution)
        held = self._kept(camera, light, resolution)
        if held is not None:
            maps.move_to_end(key)
            return replace(held, light=camera.light)

        def casts(path: str) -> bool:
            return self._casts(path, light)

        if self.draws:
            for other in [name for name, (before, _) in maps.items() if before != self.version]:
                del maps[other]
        keeps = self.draws and samples * self.buffers.last <= KEPT_BYTES
        buffers = MapBuffers(self.rasterizer.device.resident) if keeps else self.buffers
        made = draw_depth_map(
            self.rasterizer, camera, self.scene, self.casters, casts, self.meshes, buffers
        )
        self.buffers.last = made.nbytes
        if not keeps:
            return made
        maps[key] = self.version, made
        while sum(each.nbytes for _, each in maps.values()) > KEPT_BYTES and len(maps) > 1:
            maps.popitem(last=False)
        return made

    def _kept(self, camera: LightCamera, light: LightSpec, resolution: int) -> DepthMap | None:
        """Return the depth map of a camera; None if it must be drawn."""
        found = self.kept.get(_key(camera, light, resolution))
        if found is None:
            return None
        version, held = found
        if self.draws:
            return held if version == self.version else None
        return held if version[:-1] == self.version[:-1] else None

    def _casts(self, path: str, light: LightSpec) -> bool:
        """Return whether the prim at a path casts shadows of a light. Shadow catchers stand for
        what a plate shows already, so they do not."""
        return is_matte(path, light.casters) and not self.catches(path)

    def _illuminate(self, each: DepthMap, light: LightSpec, to: Receivers, sums: Any) -> None:
        """Add the light of one camera to sums of receivers."""
        points, normals, shapes, prims = to.places
        names = self.casters.prims
        numbers = self.casters.labels[:, 0].tolist()
        casts = np.array([self._casts(names[number], light) for number in numbers], np.uint8)
        self.rasterizer.device.run(
            light_lanes.shine, each.light, points, normals, shapes, prims, to.linked, to.own,
            each.world_to_screen, each.views, (each.casters, casts), each.tiles, each.depths,
            self.buffers.receivers.get, sums,
        )  # fmt: skip


def _key(camera: LightCamera, light: LightSpec, resolution: int) -> Seen:
    """Return what a camera of a light sees."""
    return _geometry(camera.light), resolution, light.casters


def _geometry(light: Any) -> tuple[Any, ...]:
    """Return what the camera of a LIGHT record, shape (1,), depends on."""
    record = light[0]
    is_distant = bool(record["kind"] == lighting.DISTANT)
    place = tuple(record[name].tobytes() for name in "xyz")
    return (*place, is_distant, bool(record["casts"]), int(record["face"]))


def _shines(record: Any) -> bool:
    """Return whether a LIGHT record has any light."""
    return any(record[name] > 0 for name in ("red", "green", "blue"))


def by_pixel(sums: Any) -> Any:
    """Return sums of n receivers in the shape of a picture with a column, (n, 1, SUMS)."""
    return sums.reshape((sums.shape[0], 1, lighting.SUMS))
