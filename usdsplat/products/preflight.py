"""Find what a picture asks for and does not get, before it is drawn."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from usdsplat.core.errors import UsdSplatError
from usdsplat.core.findings import Finding, from_error
from usdsplat.delegate.engine import Engine
from usdsplat.products import remarks
from usdsplat.products.request import PicturePlan
from usdsplat.render.frame_stats import FrameStats
from usdsplat.render.framing import conform
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CameraSpec, View

OPAQUE_ENOUGH = 0.1
"""Opacity from which a splat with its centre in view is visible for certain."""


def go_to(
    engine: Engine, plan: PicturePlan, frame: float, camera: CameraSpec | None = None
) -> View:
    """Set the engine to a frame, and return the view of the picture there.

    Args:
        engine: Engine of the stage; its time, purposes and refinement are changed.
        plan: The picture.
        frame: Time code.
        camera: Camera for all frames; None for that of the plan.

    Raises:
        StageError: If the camera cannot be used.
    """
    engine.set_refinement(plan.settings.refinement)
    engine.set_time(frame)
    engine.set_purposes(plan.purposes)
    if camera is None:
        view = engine.view(plan.camera, framing=plan.framing)
    else:
        view = View(camera=camera, framing=plan.framing)
    rules = plan.light_rules
    return replace(view, matte=plan.matte, catchers=plan.catchers, light_rules=rules)


def of_picture(engine: Engine, plan: PicturePlan, camera: CameraSpec) -> Iterator[Finding]:
    """Yield the findings at the engine's time that concern a picture.

    Those on cameras of other pictures do not.
    """
    others = set(engine.cameras()) - {plan.camera}
    yield from (found for found in engine.findings if found.path not in others)
    for found in (remarks.no_blur(plan, camera), remarks.wide_lens(plan, camera)):
        if found is not None:
            yield found
    yield from remarks.repeated_ids(engine, plan)
    yield from remarks.shadows(engine, plan)


def findings_of(
    engine: Engine, plan: PicturePlan, frame: float, camera: CameraSpec | None = None
) -> Iterator[Finding]:
    """Yield everything that drawing a picture at a frame would report, without writing a file.

    Args are those of `go_to`.
    """
    try:
        view = go_to(engine, plan, frame, camera)
    except UsdSplatError as error:
        yield from_error("bad-camera", error)
        return
    yield from of_picture(engine, plan, view.camera)
    scene = engine.render_scene
    has_trees = bool(scene.drawn_trees())
    if not has_trees and (scene.drawn_meshes() or _sees(scene, view)):
        return
    stats = FrameStats()
    if has_trees or scene.drawn():
        stats = _stats_of(engine, plan, view)
    yield from of_drawn(engine, view, plan.settings, stats)


def of_drawn(
    engine: Engine, view: View, settings: RenderSettings, stats: FrameStats
) -> Iterator[Finding]:
    """Yield what a picture, the last one of the engine, asked for and did not get: chunks, nodes
    and the budget of splat trees, and anything to draw."""
    yield from (found for found in engine.findings if found.code == "broken-chunk")
    yield from remarks.small_budget(engine, view, settings, stats.of_trees)
    for found in (
        remarks.unread_nodes(view, stats.missing),
        remarks.nothing_drawn(engine, view, stats),
    ):
        if found is not None:
            yield found


def lens_findings(engine: Engine, plan: PicturePlan) -> Iterator[Finding]:
    """Yield a finding if the lens of a picture is wide, even if one sample does not show it."""
    blurred = replace(plan, settings=replace(plan.settings, samples=2))
    try:
        camera = engine.view(plan.camera, framing=plan.framing).camera
    except UsdSplatError:
        return  # `findings_of` reports it
    if found := remarks.wide_lens(blurred, camera):
        yield found


def _stats_of(engine: Engine, plan: PicturePlan, view: View) -> FrameStats:
    """Return the statistics of a picture; no more is drawn than it takes to see a splat."""
    columns, _ = plan.framing.resolution
    next(engine.render(view, plan.settings, band_pixels=columns))
    if not engine.stats.visible:  # with several samples, the splats of a band are counted
        for _ in engine.render(view, plan.settings):
            if engine.stats.visible:
                break
    return engine.stats


def _sees(scene: RenderScene, view: View) -> bool:
    """Return whether a splat is in view for certain; False if only drawing can tell."""
    if view.framing.data_window is not None:
        return False
    camera = view.camera
    near, far = camera.clipping_range
    window, _ = conform(camera.window, view.framing)
    to_camera = np.array(camera.world_to_camera).reshape(4, 4)
    for _, field, instance in scene.drawn():
        cloud = field.spec.cloud
        if field.crops:
            continue
        place = to_camera @ np.array(instance.transform).reshape(4, 4)
        with np.errstate(all="ignore"):
            at = cloud.positions @ place[:3, :3].T + place[:3, 3]
            depth = -at[:, 2]
            across = at[:, :2] if camera.orthographic else at[:, :2] / depth[:, None]
            seen = (near < depth) & (depth < far) & (cloud.opacities > OPAQUE_ENOUGH)
            seen &= np.isfinite(cloud.scales).all(axis=1) & (cloud.scales > 0).all(axis=1)
            seen &= ((across > window[:2]) & (across < window[2:])).all(axis=1)
        if seen.any():
            return True
    return False
