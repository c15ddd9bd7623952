"""Decide what of a picture depends on lights and shadows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from usdsplat.render.lod.tree import TreeSpec
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import FieldSpec, View


def receives(spec: FieldSpec | TreeSpec, settings: RenderSettings) -> bool:
    """Return whether light changes the splats of a field or tree in the picture."""
    return mode_of(spec, settings) != "captured"


def mode_of(spec: FieldSpec | TreeSpec, settings: RenderSettings) -> str:
    """Return the light of the splats of a field or tree in a picture."""
    return settings.lighting if spec.lighting == "auto" else spec.lighting


def is_needed(scene: RenderScene, settings: RenderSettings, aovs: Iterable[str]) -> bool:
    """Return whether anything of a picture depends on lights that `kernels.shade` does not know, or
    on shadows."""
    lights = scene.named_lights.values()
    if not lights:
        return False
    if "shadow" in aovs:
        return True
    return has_shadows(scene, settings) or not all(light.is_plain for light in lights)


def has_shadows(scene: RenderScene, settings: RenderSettings) -> bool:
    """Return whether splats or surfaces are drawn with shadows."""
    drawn: list[FieldSpec | TreeSpec] = [field.spec for field in scene.visible_fields()]
    drawn += [tree.spec for _, tree in scene.drawn_trees()]
    return settings.lighting != "captured" or any(receives(spec, settings) for spec in drawn)


def with_catchers(scene: RenderScene, view: View) -> View:
    """Return a view in which all shadow catchers, of the view and of the scene, are mattes."""
    rules = (*view.catchers, *((path, True) for path in scene.catchers()))
    if not rules:
        return view
    return replace(view, matte=(*view.matte, *rules), catchers=rules)
