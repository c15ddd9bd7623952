"""Compute the light of a picture's receivers: splats, once per scene, and pixels of surfaces.

Light of splats does not depend on the view, which only chooses nodes of trees. Their sums are kept
for each light and field, with everything that they depend on, and computed again only if that has
changed. Depth maps are kept, too, as long as they fit in `light_maps.KEPT_BYTES`: pixels of
surfaces look at them in every band and picture.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32
from usdsplat.kernels import light_parts, lighting, receivers, total
from usdsplat.render.draw_list import DrawList
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.lights.depth_map import MapBuffers
from usdsplat.render.lights.last_light import light_version
from usdsplat.render.lights.light_maps import LightMaps, Receivers, by_pixel
from usdsplat.render.lights.light_steps import counted
from usdsplat.render.lights.light_store import LightStore
from usdsplat.render.lights.needs import NO_LIGHT, LightRequest, has_shadows, is_needed
from usdsplat.render.lights.splat_lighting import ALL_APPEARANCES, SplatLighting
from usdsplat.render.lights.trees import Casters, casters_of
from usdsplat.render.matte import is_matte
from usdsplat.render.patience import ENDLESS, Patience
from usdsplat.render.rasterizer import Rasterizer
from usdsplat.render.scene import RenderScene
from usdsplat.render.screen import Screen
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import View
from usdsplat.render.surfaces import SurfaceBand, SurfaceLight

NO_ROWS: I32 = np.empty(0, np.int32)
NO_RATIOS: F32 = np.empty((0, 3), np.float32)


class Lighting:
    """Light of one sample of a picture.

    Args:
        view: A view with all shadow catchers, see `with_catchers`.
        layout: The splats that are drawn.
        wanted: The AOVs of light.
        patience: Whether the light of this scene is computed, and what ends it. Parts of light, and
            light that arrives, always are.
    """

    def __init__(
        self,
        rasterizer: Rasterizer,
        buffers: FrameBuffers,
        settings: RenderSettings,
        scene: RenderScene,
        view: View,
        layout: DrawList,
        wanted: LightRequest = NO_LIGHT,
        patience: Patience = ENDLESS,
    ) -> None:
        self._rasterizer, self._device = rasterizer, rasterizer.device
        self._buffers = buffers
        if buffers.lights is None:
            buffers.lights = LightStore()
        self._store: LightStore = buffers.lights
        self._settings, self._scene = settings, scene
        self._catchers, self._rules = view.catchers, view.light_rules
        self._layout, self._wanted = layout, wanted
        self._waits = patience.light or bool(wanted.parts) or wanted.irradiance
        self._cancel = patience.token
        self.is_behind = False
        """Whether something is shown without the light of this scene."""
        self._cast = Casters(scene.drawn(), scene.draw_list(settings.splat_budget), {})
        if wanted.everything or has_shadows(scene, view, settings):
            self._cast = casters_of(scene, settings, self._store.trees, reads=self._waits)
        self._casters = self._cast.layout
        self._version = (
            tuple((path, f.shapes, f.crops, each) for path, f, each in self._cast.drawn),
            tuple((path, mesh.spec, each) for path, mesh, each in scene.drawn_meshes()),
            view.catchers,
            (settings.shadow_resolution, settings.light_samples, settings.dome_samples),
            settings.splat_budget,
        )
        if self._version == self._store.version:
            self._version = self._store.version  # one object is compared quickly
        self._store.version = self._version
        catchers = view.catchers
        # a function without self, which would keep all buffers until garbage is collected
        self._maps = LightMaps(
            rasterizer=rasterizer, settings=settings, scene=scene, casters=self._casters,
            catches=lambda path: is_matte(path, catchers), version=self._version,
            kept=self._store.maps, meshes=self._store.meshes,
            buffers=MapBuffers(rasterizer.device.resident), draws=self._waits,
        )  # fmt: skip
        self._is_shadowed = settings.lighting != "captured"
        self._splats = SplatLighting(
            device=self._device, store=self._store, settings=settings, scene=scene, layout=layout,
            cast=self._cast, rules=self._rules, maps=self._maps, wanted=wanted,
            cancel=self._cancel, version=self._version,
        )  # fmt: skip
        last = self._store.last
        version = light_version(scene, view, settings, layout, self._version[:-1], wanted)
        if self._waits:
            self.gains, self.ratios = self._splats.light()
            last.keep(version, layout, self.gains, self.ratios)
        else:
            self.gains, self.ratios, self.is_behind = last.of(version, layout)

    @property
    def steps(self) -> int:
        """Samples of lights that were computed for splats."""
        return self._splats.steps

    @property
    def shares(self) -> Mapping[int, Mapping[str, Any]]:
        """First slot of a lit group -> share of each part of light in its colours."""
        return self._splats.shares

    @property
    def arrivals(self) -> Mapping[int, Any]:
        """First slot of a group -> light that arrives at its splats, if it is needed."""
        return self._splats.arrivals

    @property
    def has_catchers(self) -> bool:
        """Whether there are shadow catchers."""
        return bool(self._catchers)

    @property
    def catch_weights(self) -> F32 | None:
        """1 for each appearance of splats that is a shadow catcher, else 0; None without any."""
        if not self._catchers:
            return None
        prims = np.array([self.catches(path) for path in self._layout.prims], np.float32)
        weights: F32 = prims[self._layout.labels[:, 0]]
        return weights

    @property
    def catching(self) -> npt.NDArray[np.uint8]:
        """Whether each prim of the scene is a shadow catcher, by its number."""
        return np.array([self.catches(path) for path in self._scene.prims()], np.uint8)

    def catches(self, path: str) -> bool:
        """Return whether the prim at a path is a shadow catcher."""
        return is_matte(path, self._catchers)

    # --- surfaces --------------------------------------------------------------------------

    def lit(self, band: SurfaceBand, screen: Screen, x0: int, y0: int) -> SurfaceBand:
        """Return surfaces with the light of all lights, and their ratios if these are needed.

        Args:
            x0, y0: Pixel of the first column and row of the band.
        """
        is_plain = all(light.is_plain for light in self._scene.named_lights.values())
        casts, parts = self._is_shadowed or self._wanted.everything, self._wanted.parts
        if is_plain and not casts and not parts:
            return band
        run, (height, width) = self._device.run, band.depth.shape
        made = self._buffers.lit
        points, normals = made.points(height, width), made.normals(height, width)
        prims, sums = made.prims(height, width), made.sums(height, width)
        to_world = np.ascontiguousarray(np.linalg.inv(screen.world_to_camera)[:3])
        run(
            receivers.place_pixels, screen.view_record(), to_world, band.depth, band.normal,
            band.covered, band.ids, x0, y0, points, normals, prims,
        )  # fmt: skip
        run(total.clear, by_pixel(sums))
        kept = made.parts(len(parts), height, width)
        if parts:
            run(total.clear, kept)
        one = made.one(height, width) if parts else sums
        first = 0 if self._is_shadowed else 3
        names = self._scene.prims()
        lights = [light for _, light in sorted(self._scene.named_lights.items())]
        steps = sum(map(self._maps.steps, lights)) if casts and self._waits else 0
        with counted("lighting surfaces", steps, self._cancel) as step:
            for light in lights:
                linked = np.array([is_matte(name, light.linked) for name in names], np.uint8)
                shadows = casts and (self._waits or self._maps.are_kept(light))
                self.is_behind |= casts and not shadows
                to = Receivers(
                    places=(points, normals, lighting.NO_SHAPES, prims), linked=linked,
                    own=ALL_APPEARANCES, sums=one,
                    seen=made.seen(height, width) if shadows and light.kind == "dome" else None,
                )  # fmt: skip
                if parts:
                    run(total.clear, by_pixel(one))
                self._maps.shine(light, [to], casts=shadows, step=step)
                if parts:
                    part = kept[parts.index(light.group)] if light.group in parts else NO_RATIOS
                    run(light_parts.collect, one, first, sums, part)
        ratio = made.ratios(height, width) if casts else NO_RATIOS
        if casts:
            none = np.zeros(3, np.float32)
            share = np.float32(self._settings.ambient)
            run(receivers.ratios, sums, none, share, NO_ROWS, ratio)
        if not is_plain or self._is_shadowed:
            part = ratio if self._is_shadowed else NO_RATIOS
            run(receivers.light_surfaces, sums, part, band.albedo, band.covered, band.color)
        ambient = self._settings.ambient if self._is_shadowed else 0.0
        found = SurfaceLight(sums, dict(zip(parts, kept, strict=True)), first, ambient)
        return replace(band, received=(ratio, prims) if casts else None, light=found)


def lighting_of(
    rasterizer: Rasterizer,
    buffers: FrameBuffers,
    settings: RenderSettings,
    scene: RenderScene,
    view: View,
    layout: DrawList,
    aovs: Sequence[str],
    patience: Patience = ENDLESS,
) -> Lighting | None:
    """Return the light of a sample, see `Lighting`; None if the picture does not depend on it."""
    if not is_needed(scene, view, settings, aovs):
        return None
    wanted = LightRequest.of(aovs)
    return Lighting(rasterizer, buffers, settings, scene, view, layout, wanted, patience)
