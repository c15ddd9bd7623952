"""Decide what of a picture depends on lights and shadows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from usdsplat.images.aovs import is_light
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import FieldSpec, View


@dataclass(frozen=True, slots=True, kw_only=True)
class LightRequest:
    """AOVs of light of a picture."""

    shadow: bool = False
    irradiance: bool = False
    parts: tuple[str, ...] = ()
    """AOVs of light groups."""

    @classmethod
    def of(cls, aovs: Iterable[str]) -> LightRequest:
        """Return those among all AOVs of a picture."""
        names = tuple(aovs)
        return cls(
            shadow="shadow" in names,
            irradiance="irradiance" in names,
            parts=tuple(filter(is_light, names)),
        )

    @property
    def everything(self) -> bool:
        """Whether light on all splats is needed, also on those that keep their own."""
        return self.shadow or self.irradiance

    @property
    def any(self) -> bool:
        """Whether there is any."""
        return self.everything or bool(self.parts)


NO_LIGHT = LightRequest()


def receives(spec: FieldSpec, settings: RenderSettings) -> bool:
    """Return whether light changes the splats of a field in the picture."""
    return mode_of(spec, settings) != "captured"


def mode_of(spec: FieldSpec, settings: RenderSettings) -> str:
    """Return the light of the splats of a field in a picture."""
    return settings.lighting if spec.lighting == "auto" else spec.lighting


def is_needed(scene: RenderScene, settings: RenderSettings, aovs: Iterable[str]) -> bool:
    """Return whether anything of a picture depends on lights that `kernels.shade` does not know, or
    on shadows."""
    lights = scene.named_lights.values()
    if not lights:
        return False
    if settings.lighting != "captured" or LightRequest.of(aovs).any:
        return True
    shadowed = any(receives(field.spec, settings) for field in scene.visible_fields())
    return shadowed or not all(light.is_plain for light in lights)


def with_catchers(scene: RenderScene, view: View) -> View:
    """Return a view in which all shadow catchers, of the view and of the scene, are mattes."""
    rules = (*view.catchers, *((path, True) for path in scene.catchers()))
    if not rules:
        return view
    return replace(view, matte=(*view.matte, *rules), catchers=rules)
