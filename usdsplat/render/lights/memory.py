"""Estimate the memory that lighting adds to a picture."""

from __future__ import annotations

from collections.abc import Set as AbstractSet

from usdsplat.kernels import lighting
from usdsplat.render.fields import Field
from usdsplat.render.lights.light_maps import KEPT_BYTES
from usdsplat.render.lights.needs import LightRequest, is_needed, mode_of, receives, with_catchers
from usdsplat.render.lights.specs import LightSpec
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import View

RECEIVER = 8 * 3 + 4 * (4 + 6 + 3)
"""Bytes of a splat as a receiver: place, normal, shape, gains."""
CASTER = 300
"""Bytes of a splat in the picture of a light: records by slot and in order, ray hits, lists."""
ESTIMATE = 8 * (9 + 9 + 3 * 5)
"""Bytes of a splat while the light of its photographs is estimated: harmonics, colours."""
DEPTH = 8
"""Bytes of a pixel of the picture of meshes."""

Use = tuple[bool, str, str]
"""Whether buffers are used, their group, and their names, separated by spaces."""


def lighting_uses(
    scene: RenderScene, view: View, settings: RenderSettings, aovs: AbstractSet[str]
) -> list[Use]:
    """Return the buffers of a frame that lighting uses, see `memory.buffers_of`."""
    is_lit, wanted = is_needed(scene, settings, aovs), LightRequest.of(aovs)
    ratios, parts, sampled = is_lit and wanted.shadow, bool(wanted.parts), settings.samples > 1
    casts = (is_lit and wanted.everything) or settings.lighting != "captured"
    meshes = is_lit and bool(scene.drawn_meshes())
    shades = not all(light.is_plain for light in scene.named_lights.values())
    caught = bool(with_catchers(scene, view).catchers)
    return [
        (ratios, "splats", "features ordered_ratios"),
        (ratios and caught, "splats", "catches"),
        (is_lit and (parts or wanted.irradiance), "splats", "features ordered_light"),
        (is_lit and wanted.any, "shadows", "image"),
        (parts, "pixels", "lights"),
        (parts and bool(scene.drawn_meshes()), "lit", "colors"),
        (meshes and (casts or shades or parts), "lit", "points normals prims sums"),
        (meshes and parts, "lit", "one parts"),
        (meshes and casts, "lit", "ratios"),
        (meshes and casts and bool(_domes(scene)), "lit", "seen"),
        (sampled and wanted.shadow, "sums", "shadow"),
        (sampled and wanted.irradiance, "sums", "irradiance"),
        (sampled and parts, "sums", "lights"),
    ]


def lighting_bytes(
    scene: RenderScene, settings: RenderSettings, aovs: AbstractSet[str]
) -> tuple[int, int]:
    """Return the bytes of receivers, and those of depth maps, which are kept up to a limit."""
    if not is_needed(scene, settings, aovs):
        return 0, 0
    wanted, count = LightRequest.of(aovs), len(scene.named_lights)
    fields = [f for f in scene.visible_fields() if wanted.everything or receives(f.spec, settings)]
    receivers = sum(len(field.instances) * len(field.spec.cloud) for field in fields)
    relit = [field for field in fields if mode_of(field.spec, settings) == "relit"]
    photographed = [_captured(scene, field) for field in relit]
    own, guessed = 0, 0
    for field, lights in zip(relit, photographed, strict=True):
        # sums of each light and of all of them, or of the estimate, and visible parts of domes
        kept = max(1, len(lights) + (len(lights) > 1))
        hides = settings.self_shadows and any(light.kind == "dome" for light in lights)
        splats = len(field.spec.cloud)
        own += 4 * lighting.SUMS * (kept + hides) * len(field.instances) * splats
        guessed = max(guessed, 0 if lights else splats)
    own += ESTIMATE * guessed
    casters = scene.draw_list(settings.splat_budget).slots
    pixels = settings.shadow_resolution**2 if scene.drawn_meshes() else 0
    one = CASTER * casters + DEPTH * pixels
    shining = list(scene.named_lights.values())
    if settings.self_shadows:
        shining += [light for lights in photographed for light in lights]
    maps = one * sum(_samples(light, settings) for light in shining)
    domes = _domes(scene)
    sums = 4 * lighting.SUMS * (count + 1 + bool(domes))
    if wanted.parts:  # shares of each group and of the rest, from sums of each
        groups = len({light.group for light in scene.named_lights.values()})
        sums += 4 * (3 * (groups + 1) + lighting.SUMS * (groups + 1))
    sums += 4 * 3 * wanted.irradiance
    return receivers * (RECEIVER + sums) + own, min(maps, KEPT_BYTES) + one


def _captured(scene: RenderScene, field: Field) -> list[LightSpec]:
    """Return the lights in which a field was photographed; empty if they are estimated."""
    found = (scene.light(path) for path in field.spec.captured_lights)
    return [light for light in found if light is not None]


def _samples(light: LightSpec, settings: RenderSettings) -> int:
    """Return the number of directions or points of a light that have depth maps."""
    if light.kind != "dome":
        return max(1, settings.light_samples)
    peaks = len(light.sky.peaks) if light.sky else 0
    return settings.dome_samples + peaks * max(1, settings.light_samples)


def _domes(scene: RenderScene) -> list[str]:
    """Return the paths of the dome lights."""
    return [path for path, light in scene.named_lights.items() if light.kind == "dome"]
