"""Compute the light of a picture's receivers: splats, once per scene, and pixels of surfaces.

Light of splats does not depend on the view, which only chooses nodes of trees. Their sums are kept
for each light and field, with everything that they depend on, and computed again only if that has
changed. Depth maps are kept, too, as long as they fit in `light_maps.KEPT_BYTES`: pixels of
surfaces look at them in every band and picture.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32
from usdsplat.kernels import light_parts, lighting, receivers, total
from usdsplat.kernels.points.curve_order import curve_order
from usdsplat.render.draw_list import DrawList, Group
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.group_gains import Gains, GroupGains
from usdsplat.render.lights.captured import estimate
from usdsplat.render.lights.depth_map import MapBuffers
from usdsplat.render.lights.gains import (
    arrivals_of,
    part_of_mean,
    relit_gains,
    shadow_gains,
    shares_of,
    summed,
)
from usdsplat.render.lights.last_light import light_version
from usdsplat.render.lights.light_maps import LightMaps, Receivers, by_pixel
from usdsplat.render.lights.light_steps import counted, unnoticed
from usdsplat.render.lights.light_store import LightStore
from usdsplat.render.lights.needs import NO_LIGHT, LightRequest, has_shadows, is_needed, mode_of
from usdsplat.render.lights.specs import LightSpec
from usdsplat.render.lights.targets import Key, Target, targets_of
from usdsplat.render.lights.trees import Casters, casters_of
from usdsplat.render.matte import is_matte
from usdsplat.render.patience import ENDLESS, Patience
from usdsplat.render.rasterizer import Rasterizer
from usdsplat.render.scene import RenderScene
from usdsplat.render.screen import Screen
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import View
from usdsplat.render.surfaces import SurfaceBand, SurfaceLight

ALL_APPEARANCES = -1
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
        self.steps = 0
        """Samples of lights that were computed for splats."""
        self._cast = Casters(scene.drawn(), scene.draw_list(settings.splat_budget), {})
        if wanted.everything or has_shadows(scene, view, settings):
            self._cast = casters_of(scene, settings, self._store.trees)
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
        self.shares: dict[int, dict[str, Any]] = {}
        """First slot of a lit group -> share of each part of light in its colours."""
        self.arrivals: dict[int, Any] = {}
        """First slot of a group -> light that arrives at its splats, if it is needed."""
        last = self._store.last
        version = light_version(scene, view, settings, layout, self._version[:-1], wanted)
        if self._waits:
            self.gains, self.ratios = self._of_splats()
            last.keep(version, layout, self.gains, self.ratios)
        else:
            self.gains, self.ratios, self.is_behind = last.of(version, layout)

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

    # --- splats ----------------------------------------------------------------------------

    def _of_splats(self) -> tuple[Gains, Gains]:
        """Return the gains of lit groups, and the ratios of all groups if they are needed."""
        lights, store = self._scene.named_lights, self._store
        drawn, own = self._layout.groups, self._settings.self_shadows
        modes = {group.slot: self._mode(group) for group in drawn}
        groups = [g for g in drawn if modes[g.slot] != "captured" or self._wanted.everything]
        targets: list[Target] = []
        if lights:
            targets = targets_of(self._cast, self._layout, groups, self_shadows=own)
        wholes = list({each.whole.key: each.whole for each in targets if each.whole}.values())
        self._live: set[tuple[Key, str]] = set()
        named = sorted(lights.items())
        todo = [(path, light, self._stale(path, light, targets)) for path, light in named]
        self.steps = sum(self._maps.steps(light) for _, light, stale in todo if stale)
        with counted("lighting", self.steps, self._cancel) as step:
            for path, light, stale in todo:
                self._receive(path, light, stale, casts=True, step=step)
                self._receive(path, light, self._stale(path, light, wholes), casts=False)
        lit, ratios = {}, {}
        for target in targets:
            slot = target.group.slot
            if self._wanted.shadow or modes[slot] == "shadowed":
                ratios[slot] = self._gain(target, "shadowed")
            if modes[slot] != "captured":
                lit[slot] = self._gain(target, "relit") if modes[slot] == "relit" else ratios[slot]
                if self._wanted.parts:
                    self.shares[slot] = self._share(target)
            if self._wanted.irradiance:
                self.arrivals[slot] = self._arriving(target)
        store.sums = {key: each for key, each in store.sums.items() if key in self._live}
        store.drop_others({target.key for target in (*targets, *wholes)})
        return lit, ratios

    def _mode(self, group: Group) -> str:
        """Return the light of the splats of a group; of nodes, that of their tree."""
        tree = self._scene.tree(group.field.tree) if group.field.is_node else None
        return mode_of(tree or group.field, self._settings, self._rules)

    def _stale(
        self, path: str, light: LightSpec, targets: Sequence[Target]
    ) -> list[tuple[Target, Any]]:
        """Return the targets for which the sums of a light are not kept, and their versions."""
        stale = []
        self._live.update((target.key, path) for target in targets)
        for target in targets:
            version = light, self._version, target.version
            held = self._store.sums.get((target.key, path))
            if held is None or held[0] != version:
                stale.append((target, version))
        return stale

    def _receive(
        self,
        path: str,
        light: LightSpec,
        stale: Sequence[tuple[Target, Any]],
        *,
        casts: bool,
        step: Callable[[], None] = unnoticed,
    ) -> None:
        """Compute the sums of one light, and keep them with the versions of the targets."""
        if not stale:
            return
        placed = [(target, self._placed(target)) for target, _ in stale]
        room = [
            self._device.resident((sum(row[0].shape[0] for row in rows), lighting.SUMS), np.float32)
            for _, rows in placed
        ]
        for sums in room:
            self._device.run(total.clear, by_pixel(sums))
        found = []
        for (target, rows), sums in zip(placed, room, strict=True):
            count = len(target.group.field.spec.cloud)
            for k, (appearance, places) in enumerate(zip(target.appearances, rows, strict=True)):
                name = self._casters.prims[self._casters.labels[appearance, 0]]
                if not is_matte(name, light.linked):
                    continue
                own = ALL_APPEARANCES if self._settings.self_shadows else appearance
                part = sums[k * count : (k + 1) * count]
                found.append(Receivers(places=places, linked=lighting.ONE_PRIM, own=own, sums=part))
        self._maps.shine(light, found, casts=casts, step=step)
        for (target, version), sums in zip(stale, room, strict=True):
            self._store.sums[target.key, path] = version, sums

    def _placed(self, target: Target) -> list[tuple[Any, ...]]:
        """Return the receivers of each instance of a group."""
        group, surface = target.group, target.surface
        cloud, count = group.field.spec.cloud, len(group.field.spec.cloud)
        keep, resident = self._device.keep, self._device.resident
        found = []
        for transform in group.placements.transforms:
            points, shapes = resident((count, 3), np.float64), resident((count, 6), np.float32)
            normals = resident((count, 4), np.float32)
            linear = transform[:3, :3]
            turn = np.cross(linear[[1, 2, 0]], linear[[2, 0, 1]])
            turn *= np.sign(np.linalg.det(linear)) or 1.0
            place = np.ascontiguousarray(transform[:3])
            self._device.run(
                receivers.place_splats, self._rows(target), place, turn,
                keep(cloud.positions), keep(cloud.rotations), keep(cloud.scales),
                keep(surface.normals), keep(surface.facts), points, normals, shapes,
            )  # fmt: skip
            found.append((points, normals, shapes, lighting.NO_PRIMS))
        return found

    def _rows(self, target: Target) -> I32:
        """Return the rows of a field along the Z-order curve: receivers near each other look at the
        same casters."""
        positions = target.group.field.spec.cloud.positions
        held = self._store.rows.get(target.key)
        if held is None or held[0] is not positions:
            held = positions, curve_order(self._device, positions)
            self._store.rows[target.key] = held
        return held[1]

    def _gain(self, target: Target, mode: str) -> GroupGains:
        """Return the gains of a group in a mode, "shadowed" or "relit"."""
        device, share = self._device, self._settings.ambient
        parts = self._shone(target)
        before = self._captured(target) if mode == "relit" else []
        version = share, *(each[0] for each in parts), *(each[0] for each in before)
        held = self._store.gains.get((target.key, mode))
        if held is not None and held[0] == version:
            return held[1]
        rows, sums = self._rows(target), summed(device, [each[1] for each in parts])
        ambient = self._ambient(target, sums)
        if before:
            captured = whole = summed(device, [each[1] for each in before])
            if target.whole:
                whole = summed(device, [each[1] for each in self._captured(target.whole)])
            dim = part_of_mean(device, whole, share)
            factors = relit_gains(device, sums, captured, ambient, dim, rows)
        else:
            factors = shadow_gains(device, sums, ambient, rows)
        gains = GroupGains(token=object(), factors=factors, is_light=mode == "relit")
        self._store.gains[target.key, mode] = version, gains
        return gains

    def _ambient(self, target: Target, sums: Any) -> F32:
        """Return the light that no light explains, given that of all lights on a group."""
        if target.whole:
            sums = summed(self._device, [each[1] for each in self._shone(target.whole)])
        return part_of_mean(self._device, sums, self._settings.ambient)

    def _share(self, target: Target) -> dict[str, Any]:
        """Return the share of each part of light in the colours of a lit group."""
        lights = sorted(self._scene.named_lights.items())
        shone, names = self._shone(target), [light.group for _, light in lights]
        version = self._settings.ambient, *names, *(each[0] for each in shone)
        held = self._store.shares.get(target.key)
        if held is None or held[0] != version:
            parts: dict[str, list[Any]] = {name: [] for name in names}
            for name, each in zip(names, shone, strict=True):
                parts[name].append(each[1])
            sums = summed(self._device, [each[1] for each in shone])
            ambient, rows = self._ambient(target, sums), self._rows(target)
            held = version, shares_of(self._device, sums, parts, ambient, rows)
            self._store.shares[target.key] = held
        return held[1]

    def _arriving(self, target: Target) -> Any:
        """Return the light that arrives at the splats of a group."""
        shone = self._shone(target)
        version = tuple(each[0] for each in shone)
        held = self._store.arrivals.get(target.key)
        if held is None or held[0] != version:
            parts, rows = [each[1] for each in shone], self._rows(target)
            held = version, arrivals_of(self._device, parts, rows)
            self._store.arrivals[target.key] = held
        return held[1]

    def _shone(self, target: Target) -> list[tuple[Any, Any]]:
        """Return what the sums of each light depend on, and the sums."""
        named = sorted(self._scene.named_lights)
        return [self._store.sums[target.key, path] for path in named]

    # --- light of photographs ----------------------------------------------------------------

    def _captured(self, target: Target) -> list[tuple[Any, Any]]:
        """Return what the light in which a group was photographed depends on, and its sums: those
        of the lights that are named, else an estimate."""
        found = []
        prims, labels = self._casters.prims, self._casters.labels
        own = tuple((prims[labels[each, 0]], True) for each in target.capture.appearances)
        for path in target.group.field.spec.captured_lights:
            light = self._scene.light(path)
            if light is not None:
                # only the capture itself stood in this light
                alone = replace(light, casters=own)
                key = f"captured {path}"
                casts = self._settings.self_shadows and not target.is_cut
                self._receive(key, alone, self._stale(key, alone, [target]), casts=casts)
                found.append(self._store.sums[target.key, key])
        return found or [self._estimated(target)]

    def _estimated(self, target: Target) -> tuple[Any, Any]:
        """Return the estimated light of photographs in the form of sums."""
        whole, kept = target.capture, self._store
        colors = whole.group.field.radiance, whole.version
        found = kept.captured.get(whole.key)
        if found is None or found[0] != colors:
            spec = whole.group.field.spec
            found = colors, estimate(spec.cloud, spec.color_space, whole.surface)
            kept.captured[whole.key] = found
        version = colors, target.version
        held = kept.estimates.get(target.key)
        if held is None or held[0] != version:
            light = found[1].on(target.surface)
            rows = self._device.fetch(self._rows(target))
            sums = np.tile(light[rows], (target.group.instances, 2))
            held = version, self._device.keep(np.ascontiguousarray(sums))
            kept.estimates[target.key] = held
        return held


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
