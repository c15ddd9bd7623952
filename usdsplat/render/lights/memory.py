"""Estimate the memory that lighting adds to a picture."""

from __future__ import annotations

from collections.abc import Set as AbstractSet

from usdsplat.kernels import lighting
from usdsplat.render.fields import Field
from usdsplat.render.lights.light_maps import KEPT_BYTES
from usdsplat.render.lights.needs import (
    LightRequest,
    has_shadows,
    is_needed,
    mode_of,
    receives,
    with_catchers,
)
from usdsplat.render.lights.specs import LightSpec
from usdsplat.render.lights.trees import cut_size
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import View
from usdsplat.render.splat_normals import working_bytes

RECEIVER = 8 * 3 + 4 * (4 + 6 + 3)
"""Bytes of a splat as a receiver: place, normal, shape, gains."""
CASTER = 300
"""Bytes of a splat in the picture of a light: records by slot and in order, ray hits, lists."""
ESTIMATE = 8 * (9 + 9 + 3 * 5)
"""Bytes of a splat while the light of its photographs is estimated: harmonics, colours."""
NORMAL = 20
"""Bytes of the normal, confidence and occlusion of a splat of a node."""
DEPTH = 8
"""Bytes of a pixel of the picture of meshes."""

Use = tuple[bool, str, str]
"""Whether buffers are used, their group, and their names, separated by spaces."""


def lighting_uses(
    scene: RenderScene, view: View, settings: RenderSettings, aovs: AbstractSet[str]
) -> list[Use]:
    """Return the buffers of a frame that lighting uses, see `memory.buffers_of`."""
    is_lit, wanted = is_needed(scene, view, settings, aovs), LightRequest.of(aovs)
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
    scene: RenderScene, view: View, settings: RenderSettings, aovs: AbstractSet[str]
) -> tuple[int, int]:
    """Return the bytes of receivers, but nodes of trees, and those of depth maps, which are kept up
    to a limit."""
    if not is_needed(scene, view, settings, aovs):
        return 0, 0
    wanted = LightRequest.of(aovs)
    wants = wanted.everything
    fields = [f for f in scene.visible_fields() if wants or receives(f, settings, view.light_rules)]
    receivers = sum(len(field.instances) * len(field.spec.cloud) for field in fields)
    rules = view.light_rules
    relit = [field for field in fields if mode_of(field, settings, rules) == "relit"]
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
    if wants or has_shadows(scene, view, settings):
        more, kept = _of_cuts(scene)
        casters, own = casters + more, own + kept
    pixels = settings.shadow_resolution**2 if scene.drawn_meshes() else 0
    one = CASTER * casters + DEPTH * pixels
    shining = list(scene.named_lights.values())
    if settings.self_shadows:
        shining += [light for lights in photographed for light in lights]
    maps = one * sum(_samples(light, settings) for light in shining)
    each = RECEIVER + _sums(scene) + _shares(scene, wanted)
    return receivers * each + own, min(maps, KEPT_BYTES) + one


def node_bytes(
    scene: RenderScene, view: View, settings: RenderSettings, aovs: AbstractSet[str], splats: int
) -> int:
    """Return the bytes of so many splats of nodes of trees as receivers."""
    if not is_needed(scene, view, settings, aovs):
        return 0
    rules = view.light_rules
    modes = {mode_of(tree, settings, rules) for _, tree in scene.drawn_trees()}
    wanted = LightRequest.of(aovs)
    if not wanted.everything and modes == {"captured"}:
        return 0
    sums = _sums(scene) * (1 + ("relit" in modes)) + _shares(scene, wanted)
    return splats * (RECEIVER + NORMAL + sums)


def _of_cuts(scene: RenderScene) -> tuple[int, int]:
    """Return the number of splats of the cuts of trees, each instance counted, and the bytes of the
    cuts."""
    casters, kept, sizes = 0, 0, []
    for _, tree in scene.drawn_trees():
        size, count = min(cut_size(scene), tree.spec.captured), len(tree.instances)
        casters += size * count
        kept += size * (tree.spec.splat_bytes + _sums(scene) * count)
        sizes.append(size)
    return casters, kept + working_bytes(sizes)


def _shares(scene: RenderScene, wanted: LightRequest) -> int:
    """Return the bytes of what AOVs of light keep of a splat: shares of each group and of the rest,
    with sums of each, and the light that arrives."""
    groups = len({light.group for light in scene.named_lights.values()}) if wanted.parts else -1
    return 4 * ((3 + lighting.SUMS) * (groups + 1) + 3 * wanted.irradiance)


def _sums(scene: RenderScene) -> int:
    """Return the bytes of the light of a splat: of each light, and of all of them."""
    count = len(scene.named_lights)
    return 4 * lighting.SUMS * (count + 1 + bool(_domes(scene)))


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
