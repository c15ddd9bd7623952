"""Find the views of a stage for which splat trees are read, and what they read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from pxr import Usd

from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.findings import Findings
from usdsplat.core.knobs import checked
from usdsplat.delegate.engine import Engine
from usdsplat.interchange import TreeChoice, ViewChoice
from usdsplat.products.planning import NO_PRODUCT, find_camera
from usdsplat.products.remarks import small_budget
from usdsplat.products.request import MOST_PIXELS
from usdsplat.render.lod.memory import view_load
from usdsplat.render.lod.nodes import view_cut
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import Framing, View

MOST_VIEWS = 20
"""Largest number of cameras for which it is described what their views load."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewRequest:
    """Which view of a stage is meant; None and missing values are those of its product."""

    camera: str | None = None
    """Path of a camera, or its name if it is unique."""
    resolution: tuple[int, int] | None = None
    """Width and height [pixel]."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Values of `RenderSettings`."""


EVERY_VIEW = ViewRequest()
"""The views of all cameras."""


def view_of(engine: Engine, request: ViewRequest) -> tuple[View, RenderSettings]:
    """Return the view of a camera at the engine's time, and the settings of its picture.

    They are those of the first product with this camera, or else of the first product. Without
    products, a picture has 1920 x 1080 pixels. Without `camera`, the view frames everything.

    Raises:
        StageError: If there is no such camera, or it cannot be used.
        UsageError: If a value is invalid.
    """
    path = None if request.camera is None else find_camera(engine, request.camera)
    given = request.settings
    for side in request.resolution or ():
        if side > MOST_PIXELS:
            raise UsageError("--resolution", str(side), f"at most {MOST_PIXELS} pixels on a side")
    products = engine.products(resolution=request.resolution, overrides=given)
    for product in sorted(products, key=lambda each: each.camera != path):
        return engine.view(path, framing=product.framing), product.settings
    settings = checked(NO_PRODUCT, RenderSettings, given)
    framing = replace(Framing(), resolution=request.resolution or Framing().resolution)
    return engine.view(path, framing=framing), settings


def choice_of(
    stage: Usd.Stage,
    request: ViewRequest,
    time: float | None,
    *,
    findings: Findings | None = None,
) -> tuple[TreeChoice, float | None]:
    """Return the choice of the nodes that a picture of a camera draws, and the time of the picture.

    Args:
        stage: The stage, which is not changed.
        request: The view.
        time: Time code; None for the first of the stage's range, if it has one.
        findings: Receives what the request asks for and does not get.

    Raises:
        StageError: As for `view_of`.
        UsageError: As for `view_of`.
    """
    with Engine(stage, time="first" if time is None else time) as engine:
        findings = Findings() if findings is None else findings
        return _chosen(engine, request, findings), engine.time


def choices_of(
    stage: Usd.Stage,
    request: ViewRequest,
    frames: Sequence[float],
    *,
    findings: Findings | None = None,
) -> dict[float, TreeChoice]:
    """Return the choice of the nodes that the picture of a camera draws at each of some frames.

    Args and errors are those of `choice_of`.
    """
    findings = Findings() if findings is None else findings
    found: dict[float, TreeChoice] = {}
    with Engine(stage, time=next(iter(frames), None)) as engine:
        for frame in frames:
            engine.set_time(frame)
            since = None if frame == frames[0] else frame
            found[frame] = _chosen(engine, request, findings, since)
    return found


def _chosen(
    engine: Engine, request: ViewRequest, findings: Findings, since: float | None = None
) -> TreeChoice:
    """Return the choice of a view at the engine's time; `since` is that of the findings."""
    view, settings = view_of(engine, request)
    if settings.splat_budget:
        found = view_cut(engine.render_scene, view, settings).splats
        wrong = small_budget(engine, view, settings, found, keeps_fields=True)
        findings.extend(wrong, time=since)
    chosen = ViewChoice(view=view, error=settings.lod_error, budget=settings.splat_budget)
    return TreeChoice(view=chosen)


def of_views(engine: Engine, request: ViewRequest, findings: Findings) -> dict[str, Any]:
    """Describe what a picture of each camera would load of the splat trees, without reading it.

    Numbers are those of a picture without blur, at the engine's time. Without cameras, the view
    frames everything.

    Args:
        engine: The engine.
        request: The view; without a camera all cameras are described, at most MOST_VIEWS.
        findings: Receives what the views ask for and do not get.

    Returns:
        `views`, a list, and `views_left_out`, the number of cameras without an entry if there are
        any, in values that JSON can hold; nothing without a visible tree.

    Raises:
        StageError: As for `view_of`, if the request names a camera.
        UsageError: As for `view_of`, or if it is not empty and there is no visible tree.
    """
    if not engine.render_scene.drawn_trees():
        if request != EVERY_VIEW:
            raise UsageError("level of detail", "a stage without splat trees", "one with a tree")
        return {}
    if request.camera is not None:
        return {"views": [_of_view(engine, request, findings)], "views_left_out": None}
    cameras = engine.cameras()
    views = []
    described: list[str | None] = [*cameras[:MOST_VIEWS]]
    for camera in described or [None]:
        try:
            views.append(_of_view(engine, replace(request, camera=camera), findings))
        except StageError as error:
            views.append({"camera": camera, "problem": str(error)})
    return {"views": views, "views_left_out": max(0, len(cameras) - MOST_VIEWS) or None}


def _of_view(engine: Engine, request: ViewRequest, findings: Findings) -> dict[str, Any]:
    """Describe what a picture of one camera would load."""
    view, settings = view_of(engine, request)
    load = view_load(engine.render_scene, view, settings)
    findings.extend(small_budget(engine, view, settings, load.splats))
    return {
        "camera": view.camera.path or None,
        "frames_everything": request.camera is None,
        "frame": engine.time,
        "resolution": list(view.framing.resolution),
        "lod_error": settings.lod_error,
        "splat_budget": settings.splat_budget or None,
        "nodes": load.nodes,
        "splats": load.splats,
        "bytes": load.bytes,
    }
