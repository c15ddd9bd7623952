"""Make findings and sentences about pictures, on problems that are not visible in them."""

from __future__ import annotations

import math
import posixpath
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path, PurePosixPath

from usdsplat.core.findings import Finding, Severity, finding
from usdsplat.core.wording import counted, said_bytes
from usdsplat.delegate.engine import Engine
from usdsplat.products.deep import DeepReport
from usdsplat.products.request import PicturePlan
from usdsplat.render.draw_list import ELEMENT_IDS
from usdsplat.render.fields import Field
from usdsplat.render.frame_stats import FrameStats
from usdsplat.render.lights.needs import LightRequest, drawn_things, mode_of, modes_asked
from usdsplat.render.lod.tree import Tree
from usdsplat.render.sampling import has_lens
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings, usd_names
from usdsplat.render.specs import CameraSpec, View

FLAT_ONLY = (
    "inverse_max", "ocio_config", "ocio_display", "ocio_view", "ocio_look",
    "multipart", "tile_size", "empty_depth", "crypto_rank",
)  # fmt: skip
"""Knobs that have no effect on deep pictures, which are linear, have one scanline part, no depth in
empty pixels and one rank of Cryptomatte."""
DEEP_ONLY = ("deep_error", "deep_color")
"""Knobs that have no effect on flat pictures."""
COARSE = math.radians(5)
"""Angle between samples of a light from which on a penumbra has visible steps [rad]."""
WIDEST = 0.1
"""Width of a lens, as a part of its focus distance, above which it is probably a mistake."""


def nothing_drawn(engine: Engine, view: View, stats: FrameStats) -> Finding | None:
    """Return a finding on an empty picture at the engine's time; None if it may not be empty."""
    if stats.visible or engine.render_scene.drawn_meshes():
        return None
    if not (engine.fields() or engine.render_scene.has_trees):
        found = "a stage without splats, points or surfaces"
    elif not stats.splats:
        found = "only splats that are hidden, of other purposes, or cannot be drawn"
    else:
        found = "no splats in view"
    where = view.camera.path or "/"
    return finding("nothing-to-draw", where, found, "splats, points or surfaces in view")


def no_blur(plan: PicturePlan, camera: CameraSpec) -> Finding | None:
    """Return a finding if a picture is sharp although its camera has blur; otherwise None."""
    settings = plan.settings
    blurs = []
    if settings.motion_blur and camera.shutter[0] != camera.shutter[1]:
        blurs.append("shutter")
    if settings.depth_of_field and has_lens(camera):
        blurs.append("lens")
    if not blurs or settings.samples > 1:
        return None
    found = f"one sample, which does not show the blur of the {' and '.join(blurs)}"
    return finding("no-blur", camera.path, found, "several, for example --samples 64")


def wide_lens(plan: PicturePlan, camera: CameraSpec) -> Finding | None:
    """Return a finding if the lens that blurs a picture is wide for its focus distance."""
    settings, width = plan.settings, 2 * camera.lens_radius
    is_used = settings.samples > 1 and settings.depth_of_field
    if not (is_used and has_lens(camera) and width > WIDEST * camera.focus_distance):
        return None
    found = f"a lens {width:.3g} wide, focused at {camera.focus_distance:.3g}"
    return finding("wide-lens", camera.path, found, "a lens of at most a tenth of that distance")


def small_budget(
    engine: Engine,
    view: View,
    settings: RenderSettings,
    of_trees: int,
    *,
    keeps_fields: bool = False,
) -> Iterator[Finding]:
    """Yield a finding if the coarsest splats of a view exceed its splat budget.

    Args:
        of_trees: Number of splats of the cut of splat trees in the view.
        keeps_fields: Whether the budget does not reduce fields; otherwise one splat of them is left
            at least.
    """
    fields = engine.render_scene.draw_list().splats
    budget, needed = settings.splat_budget, of_trees + (fields if keeps_fields else min(1, fields))
    if budget and of_trees and needed > budget:
        found = f"a splat budget of {budget}"
        beside = " and the fields beside them" if fields else ""
        expected = f"at least {needed}, for the coarsest levels of the splat trees in view{beside}"
        yield finding("small-budget", view.camera.path or "/", found, expected)


def unread_nodes(view: View, missing: int) -> Finding | None:
    """Return a finding if a picture has coarser nodes of splat trees in place of `missing` ones."""
    if not missing:
        return None
    # the number is not part of what was found, which is said once for all frames
    found, where = "a picture that does not wait for nodes", view.camera.path or "/"
    return finding("unread-nodes", where, found, f"{counted(missing, 'more node')}, not read yet")


def repeated_ids(engine: Engine, plan: PicturePlan) -> Iterator[Finding]:
    """Yield a finding on each drawn splat tree whose splats and proxies are more than the element
    ids of a picture that has them."""
    if "elementId" not in plan.aovs:
        return
    for path, tree in engine.render_scene.drawn_trees():
        table = tree.spec.table
        count = int(table.proxies.sum() + table.residents.sum())
        if count > ELEMENT_IDS:
            expected = f"at most {ELEMENT_IDS}"
            yield finding("repeated-element-ids", path, counted(count, "splat"), expected)


NOTE: Severity = "note"


def shadows(engine: Engine, plan: PicturePlan) -> Iterator[Finding]:
    """Yield a finding if a picture with shadows has no lights, on lights with few samples, on each
    relit field or tree with an estimated light, and if shadow catchers of the request are in no
    AOV; no lights are a note where only the AOV is asked for, as among all AOVs."""
    if plan.catchers and "shadow" not in plan.aovs:
        found = "a shadow catcher in a picture without its shadow"
        yield finding("unused-catcher", plan.catchers[0][0], found, "the AOV shadow")
    is_lit, scene = plan.settings.lighting != "captured", engine.render_scene
    modes = {
        path: (mode_of(each, plan.settings, plan.light_rules), each)
        for path, each in sorted(drawn_things(scene).items())
    }
    relit = {path: each for path, (mode, each) in modes.items() if mode == "relit"}
    yield from _split_lighting(scene, plan)
    if not is_lit and not LightRequest.of(plan.aovs).any and not relit:
        return
    if not scene.lights:
        where, expected = plan.product or "lighting", "one or more lights"
        severity = None if is_lit else NOTE
        yield finding("no-lights", where, "no lights", expected, severity=severity)
        return
    yield from few_light_samples(scene, plan.settings)
    for path, each in relit.items():
        if not any(scene.light(light) for light in each.spec.captured_lights):
            yield estimated_light(path)
        yield from _instanced_lights(path, each)


def few_light_samples(scene: RenderScene, settings: RenderSettings) -> Iterator[Finding]:
    """Yield a finding on each distant light whose samples are far apart, unless it is dark.

    Those of other lights are as far apart as their distance says, which no number tells.
    """
    for path, light in sorted(scene.named_lights.items()):
        angle = min(light.angle, math.pi)
        least = math.ceil((angle / COARSE) ** 2)
        if light.kind != "distant" or not light.shadow.enable or not any(light.irradiance):
            continue
        if settings.light_samples < least:
            # the angle is not part of what was found, which is said once for all frames
            found = counted(settings.light_samples, "sample")
            expected = f"{least} or more for {math.degrees(angle):g} degrees"
            yield finding("few-light-samples", path, found, expected)


def _split_lighting(scene: RenderScene, plan: PicturePlan) -> Iterator[Finding]:
    """Yield a finding on each field or tree with instances of which the picture asks different
    light."""
    for path, each in sorted(drawn_things(scene).items()):
        asked = modes_asked(each, plan.settings, plan.light_rules)
        if len(asked) > 1:
            found = f"instances that are {' and '.join(sorted(asked))}"
            yield finding("split-lighting", path, found, "one light for all")


def _instanced_lights(path: str, field: Field | Tree) -> Iterator[Finding]:
    """Yield a finding on each light of the photographs of a field or tree that is inside one of its
    native instances: below what their paths have in common, and along only one of them."""
    seen = sorted({each.path for each in field.instances})
    shared = len(PurePosixPath(posixpath.commonpath(seen)).parts)
    roots = {PurePosixPath(*PurePosixPath(each).parts[: shared + 1]) for each in seen}
    for light in field.spec.captured_lights if len(seen) > 1 else ():
        if any(PurePosixPath(light).is_relative_to(root) for root in roots):
            expected = "a light outside of them"
            found = f"the light {light} inside one of {counted(len(seen), 'instance')}"
            yield finding("instanced-light", path, found, expected)


def estimated_light(path: str) -> Finding:
    """Return the finding on a field that is relit out of an estimated light."""
    expected = "a light in splat:lighting:captured"
    return finding("estimated-light", path, "no light of the photographs", expected)


def what_is_forced(plan: PicturePlan) -> str:
    """Return a remark on settings that differ between a deep and a flat picture."""
    scaled = ""
    if plan.settings.deep_color == "beauty":
        scaled = ", scaled to flatten to the flat picture (--deep-color beauty)"
    return (
        f"{plan.output}: deep samples are linear, in {plan.settings.working_space}, and are "
        f"blended in that space (--blend-space linear){scaled}"
    )


def what_lights_force(plan: PicturePlan) -> str:
    """Return a remark on settings of a picture with AOVs of light groups."""
    return (
        f"{plan.output}: splats are blended in {plan.settings.working_space} (--blend-space "
        "linear), so that the AOVs of light groups add up to color"
    )


def without_effect(where: str, settings: RenderSettings) -> Iterator[Finding]:
    """Yield a finding if settings of a deep picture have no effect."""
    default = RenderSettings()
    names = [
        *(("color_mode",) if settings.color_mode not in ("auto", "scene") else ()),
        *(name for name in FLAT_ONLY if getattr(settings, name) != getattr(default, name)),
    ]
    if names:
        yield finding("deep-settings", where, _said(settings, names), "none of these")


def only_for_deep(
    where: str, settings: RenderSettings, chosen: Collection[str]
) -> Iterator[Finding]:
    """Yield a finding if settings of a flat picture have no effect.

    Args:
        chosen: Knobs that were set for this picture. Others may be meant for a deep picture of the
            same RenderSettings.
    """
    default = RenderSettings()
    names = [
        name
        for name in DEEP_ONLY
        if name in chosen and getattr(settings, name) != getattr(default, name)
    ]
    if names:
        yield finding("flat-settings", where, _said(settings, names), "none of these")


def _said(settings: RenderSettings, names: Iterable[str]) -> str:
    """Return the schema's names of knobs, with their values."""
    properties = {knob: name for name, knob in usd_names().items()}
    values = {name: getattr(settings, name) for name in names}
    return ", ".join(
        f"{properties[name]} {f'{value:g}' if isinstance(value, float) else value}"
        for name, value in values.items()
    )


def what_fails(path: Path, stats: FrameStats) -> str:
    """Return the share of an `inverseView` picture whose captured colours the view cannot
    produce."""
    part = stats.failed / stats.asked if stats.asked else 0.0
    amount = f"{100 * part:.2g} %" if stats.failed else "none"
    cause = "; it cannot produce their colours, or --inverse-max is too low" if part else ""
    return f"{path.name}: pixels of splats that the view cannot reproduce: {amount}{cause}"


def what_is_deep(path: Path, report: DeepReport, seconds: float) -> str:
    """Return the size of a deep picture, and its difference from the flat one."""
    mean = report.samples / max(1, report.pixels)
    held = (
        f"{path.name}: {report.samples:,} samples, {mean:.1f} a pixel, "
        f"{said_bytes(report.bytes)}, {seconds:.1f} s"
    )
    if not report.compared:
        return held
    away = ""
    if report.worst > 0:
        away = f" {report.decibels:.1f} dB (at most {report.worst:.2g}) from"
    space = "linearly" if report.blend_space == "linear" else "in the captures' training space"
    return f"{held}; flattened it is{away} the picture blended {space}"
