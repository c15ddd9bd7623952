"""Compute the light of splats, and the gains that it gives their colours."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from usdsplat.core.cancel import CancelToken
from usdsplat.core.cloud import F32, I32
from usdsplat.kernels import lighting, receivers, total
from usdsplat.kernels.device import Device
from usdsplat.kernels.points.curve_order import curve_order
from usdsplat.render.draw_list import DrawList, Group
from usdsplat.render.group_gains import Gains, GroupGains
from usdsplat.render.lights.captured import estimate
from usdsplat.render.lights.gains import (
    arrivals_of,
    part_of_mean,
    relit_gains,
    shadow_gains,
    shares_of,
    summed,
)
from usdsplat.render.lights.light_maps import LightMaps, Receivers, by_pixel
from usdsplat.render.lights.light_steps import counted, unnoticed
from usdsplat.render.lights.light_store import LightStore
from usdsplat.render.lights.needs import LightRequest, mode_of
from usdsplat.render.lights.specs import LightSpec
from usdsplat.render.lights.targets import Key, Target, targets_of
from usdsplat.render.lights.trees import Casters
from usdsplat.render.matte import is_matte
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import LightRules

ALL_APPEARANCES = -1


@dataclass(slots=True, eq=False, kw_only=True)
class SplatLighting:
    """Light of the splats of a picture."""

    device: Device
    store: LightStore
    settings: RenderSettings
    scene: RenderScene
    layout: DrawList
    """The splats that are drawn."""
    cast: Casters
    """The splats that cast shadows."""
    rules: LightRules
    maps: LightMaps
    wanted: LightRequest
    """The AOVs of light."""
    cancel: CancelToken
    version: Any
    """What light depends on besides lights and receivers."""
    shares: dict[int, dict[str, Any]] = field(default_factory=dict, init=False)
    """First slot of a lit group -> share of each part of light in its colours."""
    arrivals: dict[int, Any] = field(default_factory=dict, init=False)
    """First slot of a group -> light that arrives at its splats, if it is needed."""
    steps: int = field(default=0, init=False)
    """Samples of lights that were computed."""
    _live: set[tuple[Key, str]] = field(default_factory=set, init=False)

    def light(self) -> tuple[Gains, Gains]:
        """Return the gains of lit groups, and the ratios of all groups if they are needed."""
        lights, store = self.scene.named_lights, self.store
        drawn, own = self.layout.groups, self.settings.self_shadows
        modes = {group.slot: self._mode(group) for group in drawn}
        groups = [g for g in drawn if modes[g.slot] != "captured" or self.wanted.everything]
        targets: list[Target] = []
        if lights:
            targets = targets_of(self.cast, self.layout, groups, self_shadows=own)
        wholes = list({each.whole.key: each.whole for each in targets if each.whole}.values())
        self._live = set()
        named = sorted(lights.items())
        todo = [(path, light, self._stale(path, light, targets)) for path, light in named]
        self.steps = sum(self.maps.steps(light) for _, light, stale in todo if stale)
        with counted("lighting", self.steps, self.cancel) as step:
            for path, light, stale in todo:
                self._receive(path, light, stale, casts=True, step=step)
                self._receive(path, light, self._stale(path, light, wholes), casts=False)
        lit, ratios = {}, {}
        for target in targets:
            slot = target.group.slot
            if self.wanted.shadow or modes[slot] == "shadowed":
                ratios[slot] = self._gain(target, "shadowed")
            if modes[slot] != "captured":
                lit[slot] = self._gain(target, "relit") if modes[slot] == "relit" else ratios[slot]
                if self.wanted.parts:
                    self.shares[slot] = self._share(target)
            if self.wanted.irradiance:
                self.arrivals[slot] = self._arriving(target)
        store.sums = {key: each for key, each in store.sums.items() if key in self._live}
        store.drop_others({target.key for target in (*targets, *wholes)})
        return lit, ratios

    def _mode(self, group: Group) -> str:
        """Return the light of the splats of a group; of nodes, that of their tree."""
        tree = self.scene.tree(group.field.tree) if group.field.is_node else None
        return mode_of(tree or group.field, self.settings, self.rules)

    def _stale(
        self, path: str, light: LightSpec, targets: Sequence[Target]
    ) -> list[tuple[Target, Any]]:
        """Return the targets for which the sums of a light are not kept, and their versions."""
        stale = []
        self._live.update((target.key, path) for target in targets)
        for target in targets:
            version = light, self.version, target.version
            held = self.store.sums.get((target.key, path))
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
            self.device.resident((sum(row[0].shape[0] for row in rows), lighting.SUMS), np.float32)
            for _, rows in placed
        ]
        for sums in room:
            self.device.run(total.clear, by_pixel(sums))
        found = []
        for (target, rows), sums in zip(placed, room, strict=True):
            count = len(target.group.field.spec.cloud)
            for k, (appearance, places) in enumerate(zip(target.appearances, rows, strict=True)):
                name = self.cast.layout.prims[self.cast.layout.labels[appearance, 0]]
                if not is_matte(name, light.linked):
                    continue
                own = ALL_APPEARANCES if self.settings.self_shadows else appearance
                part = sums[k * count : (k + 1) * count]
                found.append(Receivers(places=places, linked=lighting.ONE_PRIM, own=own, sums=part))
        self.maps.shine(light, found, casts=casts, step=step)
        for (target, version), sums in zip(stale, room, strict=True):
            self.store.sums[target.key, path] = version, sums

    def _placed(self, target: Target) -> list[tuple[Any, ...]]:
        """Return the receivers of each instance of a group."""
        group, surface = target.group, target.surface
        cloud, count = group.field.spec.cloud, len(group.field.spec.cloud)
        keep, resident = self.device.keep, self.device.resident
        found = []
        for transform in group.placements.transforms:
            points, shapes = resident((count, 3), np.float64), resident((count, 6), np.float32)
            normals = resident((count, 4), np.float32)
            linear = transform[:3, :3]
            turn = np.cross(linear[[1, 2, 0]], linear[[2, 0, 1]])
            turn *= np.sign(np.linalg.det(linear)) or 1.0
            place = np.ascontiguousarray(transform[:3])
            self.device.run(
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
        held = self.store.rows.get(target.key)
        if held is None or held[0] is not positions:
            held = positions, curve_order(self.device, positions)
            self.store.rows[target.key] = held
        return held[1]

    def _gain(self, target: Target, mode: str) -> GroupGains:
        """Return the gains of a group in a mode, "shadowed" or "relit"."""
        device, share = self.device, self.settings.ambient
        parts = self._shone(target)
        before = self._captured(target) if mode == "relit" else []
        version = share, *(each[0] for each in parts), *(each[0] for each in before)
        held = self.store.gains.get((target.key, mode))
        if held is not None and held[0] == version:
            return held[1]
        rows, sums = self._rows(target), summed(device, [each[1] for each in parts])
        ambient = self._ambient(target)
        if before:
            captured = summed(device, [each[1] for each in before])
            if target.whole:
                before = self._captured(target.whole)
            dim = self._part(target.capture, "captured", before)
            factors = relit_gains(device, sums, captured, ambient, dim, rows)
        else:
            factors = shadow_gains(device, sums, ambient, rows)
        gains = GroupGains(token=object(), factors=factors, is_light=mode == "relit")
        self.store.gains[target.key, mode] = version, gains
        return gains

    def _ambient(self, target: Target) -> F32:
        """Return A of a group, the light that no light of the stage explains, shape (3,)."""
        return self._part(target.capture, "present", self._shone(target.capture))

    def _part(self, target: Target, when: str, shone: Sequence[tuple[Any, Any]]) -> F32:
        """Return a part of the mean light on a capture. All nodes of a tree share it.

        Args:
            when: "present" or "captured".
            shone: See `_shone`.
        """
        share = self.settings.ambient
        version = share, *(each[0] for each in shone)
        held = self.store.means.get((target.key, when))
        if held is None or held[0] != version:
            sums = summed(self.device, [each[1] for each in shone])
            held = version, part_of_mean(self.device, sums, share)
            self.store.means[target.key, when] = held
        return held[1]

    def _share(self, target: Target) -> dict[str, Any]:
        """Return the share of each part of light in the colours of a lit group."""
        lights = sorted(self.scene.named_lights.items())
        shone, names = self._shone(target), [light.group for _, light in lights]
        version = self.settings.ambient, *names, *(each[0] for each in shone)
        held = self.store.shares.get(target.key)
        if held is None or held[0] != version:
            parts: dict[str, list[Any]] = {name: [] for name in names}
            for name, each in zip(names, shone, strict=True):
                parts[name].append(each[1])
            sums = summed(self.device, [each[1] for each in shone])
            ambient, rows = self._ambient(target), self._rows(target)
            held = version, shares_of(self.device, sums, parts, ambient, rows)
            self.store.shares[target.key] = held
        return held[1]

    def _arriving(self, target: Target) -> Any:
        """Return the light that arrives at the splats of a group."""
        shone = self._shone(target)
        version = tuple(each[0] for each in shone)
        held = self.store.arrivals.get(target.key)
        if held is None or held[0] != version:
            parts, rows = [each[1] for each in shone], self._rows(target)
            held = version, arrivals_of(self.device, parts, rows)
            self.store.arrivals[target.key] = held
        return held[1]

    def _shone(self, target: Target) -> list[tuple[Any, Any]]:
        """Return what the sums of each light depend on, and the sums."""
        named = sorted(self.scene.named_lights)
        return [self.store.sums[target.key, path] for path in named]

    # --- light of photographs ----------------------------------------------------------------

    def _captured(self, target: Target) -> list[tuple[Any, Any]]:
        """Return what the light in which a group was photographed depends on, and its sums: those
        of the lights that are named, else an estimate."""
        found = []
        prims, labels = self.cast.layout.prims, self.cast.layout.labels
        own = tuple((prims[labels[each, 0]], True) for each in target.capture.appearances)
        for path in target.group.field.spec.captured_lights:
            light = self.scene.light(path)
            if light is not None:
                # only the capture itself stood in this light
                alone = replace(light, casters=own)
                key = f"captured {path}"
                casts = self.settings.self_shadows and not target.is_cut
                self._receive(key, alone, self._stale(key, alone, [target]), casts=casts)
                found.append(self.store.sums[target.key, key])
        return found or [self._estimated(target)]

    def _estimated(self, target: Target) -> tuple[Any, Any]:
        """Return the estimated light of photographs in the form of sums."""
        whole, kept = target.capture, self.store
        spec = whole.group.field.spec
        colors = whole.group.field.radiance, spec.color_space, whole.version
        found = kept.captured.get(whole.key)
        if found is None or found[0] != colors:
            found = colors, estimate(spec.cloud, spec.color_space, whole.surface)
            kept.captured[whole.key] = found
        version = colors, target.version
        held = kept.estimates.get(target.key)
        if held is None or held[0] != version:
            light = found[1].on(target.surface)
            rows = self.device.fetch(self._rows(target))
            sums = np.tile(light[rows], (target.group.instances, 2))
            held = version, self.device.keep(np.ascontiguousarray(sums))
            kept.estimates[target.key] = held
        return held
