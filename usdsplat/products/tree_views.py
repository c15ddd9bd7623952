"""Describe the views of a stage for which its splat trees are read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from pxr import Usd

from usdsplat.core.errors import UsageError
from usdsplat.core.knobs import checked
from usdsplat.delegate.engine import Engine
from usdsplat.interchange import TreeChoice, ViewChoice
from usdsplat.products.planning import NO_PRODUCT, find_camera
from usdsplat.products.request import MOST_PIXELS
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import Framing, View


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewRequest:
    """Which view of a stage is meant; None and missing values are those of its product."""

    camera: str | None = None
    """Path of a camera, or its name if it is unique."""
    resolution: tuple[int, int] | None = None
    """Width and height [pixel]."""
    settings: Mapping[str, Any] | None = None
    """Values of `RenderSettings`."""


def view_of(engine: Engine, request: ViewRequest) -> tuple[View, RenderSettings]:
    """Return the view of a camera at the engine's time, and the settings of its picture.

    They are those of the first product with this camera, or else of the first product. Without
    products, a picture has 1920 x 1080 pixels. Without `camera`, the view frames everything.

    Raises:
        StageError: If there is no such camera, or it cannot be used.
        UsageError: If a value is invalid.
    """
    path = None if request.camera is None else find_camera(engine, request.camera)
    given = request.settings or {}
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
    stage: Usd.Stage, request: ViewRequest, time: float | None
) -> tuple[TreeChoice, float | None]:
    """Return the choice of the nodes that a picture of a camera draws, and the time of the picture.

    Args:
        stage: The stage, which is not changed.
        request: The view.
        time: Time code; None for the first of the stage's range, if it has one.

    Raises:
        StageError: As for `view_of`.
        UsageError: As for `view_of`.
    """
    with Engine(stage, time="first" if time is None else time) as engine:
        view, settings = view_of(engine, request)
        chosen = ViewChoice(view=view, error=settings.lod_error, budget=settings.splat_budget)
        return TreeChoice(view=chosen), engine.time
