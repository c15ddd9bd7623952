"""The sides of a picture of a viewport: what is drawn of each, and what came of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from usdsplat.delegate.render_buffer import Pixels
from usdsplat.preview.display import needed, settings_of
from usdsplat.preview.pacing import Quality
from usdsplat.preview.scenes import Scene
from usdsplat.preview.values import Look, Picture, ViewState
from usdsplat.render.framing import conform
from usdsplat.render.renderer import depends_on_time
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import Framing, View


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Side:
    """Inputs and results of drawing one side of a picture."""

    scene: Scene
    view: View
    """View that the engine drew."""
    arrays: Mapping[str, Pixels]
    """Hydra's name of an AOV -> its pixels, read-only."""

    @property
    def look(self) -> Look:
        """Look of this side."""
        return self.scene.look


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Shown:
    """The last picture, and what it was made from."""

    picture: Picture
    quality: Quality
    sides: tuple[Side, ...]
    """One side, or the left and the right one of a comparison."""

    def side_at(self, x: float) -> Side:
        """Return the side that is visible at a column of the viewport [pixel]."""
        state = self.picture.state
        return self.sides[-1 if x >= cut_of(state) else 0]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Job:
    """One side to draw."""

    scene: Scene
    view: View
    settings: RenderSettings
    aovs: tuple[str, ...]
    waits_for_light: bool = True
    """Whether light is computed; else the last one is shown."""

    @property
    def key(self) -> tuple[Any, ...]:
        """Cache key, equal for sides that differ only in their AOVs."""
        return self.scene.place, self.view, self.settings

    @property
    def reads_stage(self) -> bool:
        """Whether drawing reads the stage at other times than the current one."""
        return depends_on_time(self.settings, self.view.camera, self.aovs)


def cut_of(state: ViewState) -> int:
    """Return the first column of the viewport that shows the right side of a comparison [pixel]."""
    width = state.size[0]
    return width if state.other is None else round(min(max(state.wipe, 0.0), 1.0) * width)


def view_of(scene: Scene, size: tuple[int, int], scale: float) -> View:
    """Return the view to draw for a viewport.

    Every scale shows exactly the same part of the aperture.
    """
    full = Framing(resolution=size)
    if scale == 1.0:
        return View(camera=scene.camera, framing=full)
    window, _ = conform(scene.camera.window, full)
    width, height = (max(1, math.ceil(length / scale)) for length in size)
    framing = Framing(
        resolution=(width, height), conform="adjustPixelAspectRatio", pixel_scale=scale
    )
    return View(camera=replace(scene.camera, window=window), framing=framing)


def job_of(
    state: ViewState, scene: Scene, quality: Quality, *, waits: bool, waits_for_light: bool = True
) -> Job:
    """Return what to draw of a scene.

    Args:
        waits: Whether to wait until the nodes of splat trees are read.
        waits_for_light: Whether to compute light that is not kept.
    """
    settings = settings_of(scene.look)
    if scene.has_trees:
        settings = replace(settings, node_wait=waits)
    if not quality.averages:
        settings = replace(settings, samples=1, lod_samples=1)
    if quality.splats is not None:
        settings = replace(settings, splat_budget=quality.splats)
    view = view_of(scene, state.size, quality.scale)
    return Job(
        scene=scene,
        view=view,
        settings=settings,
        aovs=needed(scene.look),
        waits_for_light=waits_for_light,
    )
