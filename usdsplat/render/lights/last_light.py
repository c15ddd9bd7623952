"""The last light of splats, which a picture shows that does not wait for its own."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Any

from usdsplat.render.draw_list import DrawList, Group
from usdsplat.render.fields import Field
from usdsplat.render.group_gains import Gains, GroupGains
from usdsplat.render.lights.needs import LightRequest
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import View

LOOKS = 4
"""Number of kept lights, one for each combination of light settings: two for the sides of a
comparison, and two for what was shown before."""


def light_version(
    scene: RenderScene,
    view: View,
    settings: RenderSettings,
    layout: DrawList,
    casters: Any,
    wanted: LightRequest,
) -> tuple[Any, Any]:
    """Return which settings the light of splats belongs to, and what else it depends on.

    Args:
        casters: What shadows depend on besides lights and settings.
        wanted: The AOVs of light.
    """
    how = settings.lighting, settings.self_shadows, settings.ambient
    look = *how, view.light_rules, wanted.shadow
    groups = tuple(
        (
            group.field.shapes,
            group.field.radiance,
            group.field.spec.lighting,
            group.field.spec.captured_lights,
            group.field.spec.color_space,
            group.field.spec.surface,
            group.placements.transforms.tobytes(),
        )
        for group in layout.groups
    )
    return look, (tuple(sorted(scene.named_lights.items())), casters, groups)


@dataclass(frozen=True, slots=True, eq=False)
class _Lit:
    """The gains of one group, whatever its slots were."""

    field: Field
    instances: int
    splats: int
    gains: GroupGains | None
    ratios: GroupGains | None

    def fits(self, group: Group) -> bool:
        """Return whether the gains are of the splats of a group."""
        count = len(group.field.spec.cloud)
        same = self.field is group.field and self.instances == group.instances
        return same and self.splats == count


@dataclass(slots=True, eq=False)
class LastLights:
    """The gains of the last pictures that waited for their light, by settings of light."""

    _kept: OrderedDict[Any, tuple[Any, list[_Lit]]] = field(default_factory=OrderedDict)

    def keep(self, version: tuple[Any, Any], layout: DrawList, gains: Gains, ratios: Gains) -> None:
        """Keep the light of a picture."""
        look, depends_on = version
        lit = [
            _Lit(
                group.field,
                group.instances,
                len(group.field.spec.cloud),
                gains.get(group.slot),
                ratios.get(group.slot),
            )
            for group in layout.groups
            if group.slot in gains or group.slot in ratios
        ]
        self._kept[look] = depends_on, lit
        self._kept.move_to_end(look)
        while len(self._kept) > LOOKS:
            self._kept.popitem(last=False)

    def of(self, version: tuple[Any, Any], layout: DrawList) -> tuple[Gains, Gains, bool]:
        """Return the last gains and ratios that fit a picture's groups, by their slots, and whether
        the picture's own light may be another one."""
        look, depends_on = version
        before, lit = self._kept.get(look, (None, []))
        waiting = list(lit)
        gains: dict[int, GroupGains] = {}
        ratios: dict[int, GroupGains] = {}
        for group in layout.groups:
            found = next((each for each in waiting if each.fits(group)), None)
            if found is None:
                continue
            waiting.remove(found)
            if found.gains is not None:
                gains[group.slot] = found.gains
            if found.ratios is not None:
                ratios[group.slot] = found.ratios
        return gains, ratios, before != depends_on
