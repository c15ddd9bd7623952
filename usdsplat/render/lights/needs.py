"""Decide what of a picture depends on lights and shadows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from usdsplat.images.aovs import is_light
from usdsplat.render.fields import Field
from usdsplat.render.lod.tree import Tree
from usdsplat.render.matte import is_matte
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import LightRules, View


@dataclass(frozen=True, slots=True, kw_only=True)
class LightRequest:
    """AOVs of light of a picture."""

    shadow: bool = False
    irradiance: bool = False
    parts: tuple[str, ...] = ()
    """AOVs of light groups."""

    @classmethod
    def of(cls, aovs: Iterable[str]) -> LightRequest:
        """Return the AOVs of light among the AOVs of a picture."""
        names = tuple(aovs)
        return cls(
            shadow="shadow" in names,
            irradiance="irradiance" in names,
            parts=tuple(filter(is_light, names)),
        )

    @property
    def everything(self) -> bool:
        """Whether the light on all splats is needed, also on splats that are drawn as captured."""
        return self.shadow or self.irradiance

    @property
    def any(self) -> bool:
        """Whether any AOV of light is requested."""
        return self.everything or bool(self.parts)


NO_LIGHT = LightRequest()


def receives(thing: Field | Tree, settings: RenderSettings, rules: LightRules) -> bool:
    """Return whether light changes the splats of a field or tree in the picture."""
    return mode_of(thing, settings, rules) != "captured"


def mode_of(thing: Field | Tree, settings: RenderSettings, rules: LightRules) -> str:
    """Return the light of the splats of a field or tree in a picture: its own, else that of the
    first rules that contain its first instance, else that of the settings.

    Args:
        thing: What has instances, all of which are lit alike.
        settings: Settings of the picture.
        rules: See `View.light_rules`.
    """
    return _mode_at(thing.instances[0].path, thing, settings, rules)


def modes_asked(thing: Field | Tree, settings: RenderSettings, rules: LightRules) -> set[str]:
    """Return the light that a picture asks for any instance of a field or tree, see `mode_of`."""
    paths = {each.path for each in thing.instances} if rules else {thing.instances[0].path}
    return {_mode_at(path, thing, settings, rules) for path in paths}


def _mode_at(path: str, thing: Field | Tree, settings: RenderSettings, rules: LightRules) -> str:
    if thing.spec.lighting != "auto":
        return thing.spec.lighting
    return next((mode for mode, each in rules if is_matte(path, each)), settings.lighting)


def drawn_things(scene: RenderScene) -> dict[str, Field | Tree]:
    """Return the fields and trees that are drawn at least once, by path."""
    fields: dict[str, Field | Tree] = {path: field for path, field, _ in scene.drawn()}
    return fields | dict(scene.drawn_trees())


def is_needed(
    scene: RenderScene, view: View, settings: RenderSettings, aovs: Iterable[str]
) -> bool:
    """Return whether anything of a picture depends on lights that `kernels.shade` does not know, or
    on shadows. Of the AOVs, colour does, and those of light; deep pictures, which have none, do."""
    names = tuple(aovs)
    lights, wanted = scene.named_lights.values(), LightRequest.of(names)
    if not lights or (names and "color" not in names and not wanted.any):
        return False
    if wanted.any or has_shadows(scene, view, settings):
        return True
    return not all(light.is_plain for light in lights)


def has_shadows(scene: RenderScene, view: View, settings: RenderSettings) -> bool:
    """Return whether splats or surfaces are drawn with shadows."""
    if settings.lighting != "captured":
        return True
    things = drawn_things(scene).values()
    return any(receives(each, settings, view.light_rules) for each in things)


def with_catchers(scene: RenderScene, view: View) -> View:
    """Return a view in which all shadow catchers, of the view and of the scene, are mattes."""
    rules = (*view.catchers, *((path, True) for path in scene.catchers()))
    if not rules:
        return view
    return replace(view, matte=(*view.matte, *rules), catchers=rules)
