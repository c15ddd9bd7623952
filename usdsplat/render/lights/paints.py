"""Paint light on the splats of a sample, for AOVs that blend it as colours are blended."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32, I32
from usdsplat.images.aovs import CAPTURED
from usdsplat.kernels import feature, light_parts, project, receivers
from usdsplat.kernels.device import Device
from usdsplat.render.draw_list import Group
from usdsplat.render.frame_buffers import SplatBuffers
from usdsplat.render.lights.lighting import Lighting
from usdsplat.render.projector import Projector


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LightPaints:
    """Light on the splats of one sample."""

    device: Device
    buffers: SplatBuffers
    projector: Projector
    """The projector of the sample, whose rows are those of this sample until the next one."""
    order: I32
    """Slots of the drawn splats, see `ProjectedSplats`."""
    lighting: Lighting | None
    """Light of the scene; None if there is none."""
    blend_space: str

    def ratios(self) -> F32:
        """Return ratios of light with and without shadows; 1 for what receives none."""
        found = {} if self.lighting is None else self.lighting.ratios
        held = {slot: each.factors for slot, each in found.items()}

        def paint(group: Group, sources: I32, found: I32, _: F32, out: F32) -> None:
            self._spread(held.get(group.slot), np.float32(1), group, sources, found, out)

        return self.projector.painted(self.order, self.buffers.ordered_ratios, paint)

    def arrivals(self) -> F32:
        """Return the light that arrives, in rows that the next call of this or `part`
        overwrites."""
        held = {} if self.lighting is None else self.lighting.arrivals

        def paint(group: Group, sources: I32, found: I32, _: F32, out: F32) -> None:
            self._spread(held.get(group.slot), np.float32(0), group, sources, found, out)

        return self.projector.painted(self.order, self.buffers.ordered_light, paint)

    @property
    def is_divided(self) -> bool:
        """Whether any splats are drawn in another light than that of their photographs."""
        return self.lighting is not None and bool(self.lighting.shares)

    def is_lit(self, part: str) -> bool:
        """Return whether a part of light is in the colours of any splats: of those that keep the
        light of their photographs there is only `CAPTURED`."""
        if part == CAPTURED:
            return True
        return self.lighting is not None and any(
            part in shares for shares in self.lighting.shares.values()
        )

    def part(self, name: str) -> F32:
        """Return colours by a part of the light, the AOV of a light group, in the linear blend
        space, in rows that the next call of this or `arrivals` overwrites."""
        shares = {} if self.lighting is None else self.lighting.shares

        def paint(group: Group, sources: I32, found: I32, records: F32, out: F32) -> None:
            end = records, project.RED, out, feature.ALBEDO
            own = shares.get(group.slot)
            if self.lighting is None or own is None or name not in own:
                factor = np.float32(own is None and name == CAPTURED)
                self.device.run(light_parts.paint_all, factor, group.block, group.slot, found, *end)
                return
            turns = self.lighting.gains[group.slot].turns(self.blend_space)
            self.device.run(
                light_parts.paint, own[name], len(group.field.spec.cloud), len(group.cloud), turns,
                group.block, group.slot, sources, found, *end,
            )  # fmt: skip

        return self.projector.painted(self.order, self.buffers.ordered_light, paint)

    def _spread(
        self, own: F32 | None, otherwise: np.float32, group: Group, sources: I32, found: I32,
        out: F32,
    ) -> None:  # fmt: skip
        """Copy three numbers of each splat of a group to its features."""
        none = np.empty((0, 3), np.float32)
        self.device.run(
            receivers.spread_gains, none if own is None else own, otherwise,
            len(group.field.spec.cloud), len(group.cloud), group.block, group.slot, sources, found,
            out, feature.ALBEDO,
        )  # fmt: skip
