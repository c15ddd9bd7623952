"""Draw the pictures of a viewport from its state.

1. With the lock: set time and purposes, sync the engine, read cameras, boxes and everything else
that comes from scene or stage.
2. Without the lock: the engine draws. Pictures that need other times than the current one keep the
lock.
3. Images for display are made of the AOVs. The two sides of a comparison are joined.

A picture that is cancelled ends after its current stage; on the CPU, within long stages too.

Light that takes long is computed while the view rests. Pictures before that one, and those of
movements, show the last light.

Pictures of a viewport do not wait until the nodes of splat trees are read: coarser ones are drawn
in their place, and the picture is drawn again when some were read. Stills wait, and no budget
limits them.

AOVs are cached, so that a change of exposure, wipe or channel needs no new drawing.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from usdsplat.core.cancel import Cancelled, CancelToken
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.render_buffer import Pixels
from usdsplat.kernels.compiling import compile_time
from usdsplat.preview.display import Display, needed
from usdsplat.preview.light_times import LightTimes
from usdsplat.preview.overlays import Overlays
from usdsplat.preview.pacing import FULL, Load, Pacer, Quality
from usdsplat.preview.scenes import Scene, Scenes
from usdsplat.preview.sides import Job, Shown, Side, cut_of, job_of, view_of
from usdsplat.preview.told import told
from usdsplat.preview.tree_levels import Levels
from usdsplat.preview.values import Image, Picture, ViewState
from usdsplat.render.frame_stats import FrameStats
from usdsplat.render.memory import resident
from usdsplat.render.patience import Patience

FIXED = ("project", "shade", "find ray hits", "find features", "sort")
"""Stages of the renderer whose time does not depend on the resolution."""
ONCE = ("lay out", "light splats")
"""Stages that only the first picture with certain splats or lights has. Estimates of the cost of a
picture leave them out."""

FindOverlays = Callable[[Engine, ViewState], Overlays]


@dataclass(frozen=True, slots=True, eq=False)
class _Drawn:
    arrays: Mapping[str, Pixels]
    stats: FrameStats


class Drawing:
    """Drawing of all pictures of one viewport of one stage.

    Args:
        scenes: The engines of the viewport.
        display: Makes images for display.
        changes: Function that returns the number of changes of the stage so far, at any time code.
    """

    def __init__(self, scenes: Scenes, display: Display, changes: Callable[[], int]) -> None:
        self._scenes = scenes
        self._changes = changes
        self._pacer = Pacer()
        self._display = display
        self._drawn: dict[tuple[Any, ...], _Drawn] = {}
        self._number = 0
        self._wanted: tuple[Any, ...] | None = None
        self._is_warm = False
        self._missing = 0
        """Parts of nodes of splat trees that the last picture lacks."""
        self._reads = 0
        """Number of reads of nodes when it was begun."""
        self._lacks_light = False
        """Whether the last picture shows an earlier light."""
        self._light_times = LightTimes()
        self._prepared: tuple[Any, ...] = ()
        """Scenes and budgets for which the next movement is prepared."""
        self._changed = 0
        """Number of changes of the stage before the last picture, which may show other times."""
        self.shown: Shown | None = None
        """The last picture, and what it was made from."""

    def close(self) -> None:
        """Forget the pictures that were drawn, so that their memory is freed."""
        self._drawn.clear()
        self.shown = self._wanted = None

    def put_back(self, shown: Shown | None) -> None:
        """Set the last picture to an earlier one, as those since were not displayed. The next call
        of `draw` returns a picture in any case."""
        self.shown, self._wanted = shown, None
        self._forget_closed()

    def draw(
        self,
        state: ViewState,
        lock: threading.RLock,
        overlays: FindOverlays,
        *,
        is_still: bool = False,
        cancel: CancelToken | None = None,
    ) -> Picture | None:
        """Return the next picture; None if the last one is still valid and of the same quality, or
        the next one was cancelled.

        Args:
            state: State of the viewport.
            lock: Held while the stage is read.
            overlays: Function that returns what is drawn over the picture of a state.
            is_still: Whether it is drawn in full at once, however long that takes, and waits until
                the nodes of splat trees are read.
            cancel: Ends the picture after its current stage.

        Raises:
            UsdSplatError: If something that the state requests cannot be drawn.
        """
        began = time.perf_counter()
        with ExitStack() as holding:
            holding.enter_context(lock)
            try:
                scenes = self._scenes.synced(state)
                if _follow(state, scenes):
                    scenes = self._scenes.synced(state)
            finally:
                self._forget_closed()
            found = overlays(scenes[0].engine, state)
            warnings = told(scenes)
            wanted = _key(state, scenes, found, warnings)
            quality = FULL if is_still else self._quality(state, wanted, scenes)
            lights = self._lights(state, wanted, scenes, quality, is_still=is_still)
            jobs = [
                job_of(state, scene, quality, waits=is_still, waits_for_light=waits)
                for scene, waits in zip(scenes, lights, strict=True)
            ]
            reads_stage = any(job.reads_stage for job in jobs)
            reads = _reads(scenes)
            is_finer = self._missing and (is_still or reads != self._reads)
            is_finer = is_finer or (self._lacks_light and all(lights))
            if reads_stage:
                self._scenes.author()
            changes = self._changes()
            is_same = wanted == self._wanted and not is_finer
            is_same = is_same and not (reads_stage and changes != self._changed)
            if is_same and self._is_shown(state, quality):
                self._prepare(state, scenes)
                return None
            synced = time.perf_counter()
            if not reads_stage:
                holding.close()
            self._wanted, before = None, self._drawn
            try:
                with compile_time() as compiled:
                    new = self._render(jobs, cancel)
            except Cancelled:
                self._drawn = before
                return None
            if reads_stage:  # the engines went to other times and came back: other versions
                scenes = self._scenes.synced(state)
                wanted = _key(state, scenes, found, warnings)
        sides = [
            Side(scene=job.scene, view=job.view, arrays=self._drawn[job.key].arrays) for job in jobs
        ]
        drawn = time.perf_counter()
        image = self._composed(state, sides, quality)
        ended = time.perf_counter()
        stats = [each.stats for each in self._drawn.values()]
        self._missing, self._reads = sum(each.missing for each in stats), reads
        self._lacks_light = any(each.lacks_light for each in stats)
        milliseconds = _added(each.wall_ms for each in new)
        if not compiled():
            self._light_times.note(scenes, new)
        if len(new) == len(stats) and not compiled():
            load = _load(state, scenes)
            if self._missing:
                load = replace(load, splats=max(each.splats for each in stats))
            self._learn(quality, milliseconds, 1e3 * (ended - drawn), load)
        milliseconds |= {
            "sync": 1e3 * (synced - began),
            "display": 1e3 * (ended - drawn),
            "total": 1e3 * (ended - began),
        }
        self._number += 1
        picture = Picture(
            image=image,
            state=state,
            camera=scenes[0].camera,
            number=self._number,
            scale=quality.scale,
            is_final=quality.is_whole
            and not state.is_moving
            and not self._missing
            and not self._lacks_light,
            missing=self._missing,
            lacks_light=self._lacks_light,
            splats=stats[0].visible,
            total=stats[0].total,
            milliseconds=milliseconds,
            megabytes=1e-6 * resident(),
            device=scenes[0].engine.device,
            lights=len(scenes[0].engine.render_scene.named_lights),
            boxes=found.boxes,
            overlays=found,
            warnings=warnings,
        )
        self._wanted, self._changed = wanted, changes
        self.shown = Shown(picture=picture, quality=quality, sides=tuple(sides))
        return picture

    @property
    def is_prepared(self) -> bool:
        """Whether a further call of `draw` would not make the next movement begin faster."""
        shown = self.shown
        if shown is None or shown.picture.state.is_moving:
            return True
        scenes = tuple(side.scene for side in shown.sides)
        return self._prepared == self._preparation(shown.picture.state, scenes)

    # --- private ---------------------------------------------------------------------------

    def _preparation(self, state: ViewState, scenes: tuple[Scene, ...]) -> tuple[Any, ...]:
        """Return what can be prepared for a movement: scenes, and the budgets of their splats."""
        load = _load(state, scenes)
        both = self._pacer.first(load).splats, self._pacer.opening(load).splats
        budgets = tuple(dict.fromkeys(each for each in both if each is not None))
        some = tuple((each.number, each.version) for each in scenes if not each.has_trees)
        return (some, budgets) if budgets and some else ()

    def _prepare(self, state: ViewState, scenes: tuple[Scene, ...]) -> None:
        """Choose the splats of the budgets of a movement, while the view rests."""
        self._prepared = self._preparation(state, scenes)
        for scene in scenes:
            for budget in self._prepared[1] if self._prepared and not scene.has_trees else ():
                scene.engine.render_scene.draw_list(budget)

    def _forget_closed(self) -> None:
        """Drop the last picture if its engine has been closed."""
        if self.shown and not all(self._scenes.has(side.scene) for side in self.shown.sides):
            self.shown = None

    def _quality(
        self, state: ViewState, wanted: tuple[Any, ...], scenes: tuple[Scene, ...]
    ) -> Quality:
        """Return the quality of the next picture."""
        load = _load(state, scenes)
        if state.is_moving:
            return self._pacer.moving(time.perf_counter(), load)
        is_same = self.shown is not None and wanted == self._wanted
        if self._missing and any(each.nodes.is_reading for each in scenes):
            is_same = False  # the intermediate quality, until a picture in full will stay
        return self._pacer.resting(self.shown.quality if self.shown and is_same else None, load)

    def _lights(
        self,
        state: ViewState,
        wanted: tuple[Any, ...],
        scenes: tuple[Scene, ...],
        quality: Quality,
        *,
        is_still: bool,
    ) -> list[bool]:
        """Return whether each side waits for its light: the last of the pictures at rest does, and
        others if that is quick."""
        shown = self.shown
        is_last = self._lacks_light and wanted == self._wanted and not state.is_moving
        is_last = is_last and shown is not None and shown.quality.is_at_least(quality)
        return [is_still or is_last or self._light_times.is_quick(each) for each in scenes]

    def _is_shown(self, state: ViewState, quality: Quality) -> bool:
        """Return whether the last picture has this quality.

        A picture of a movement is never reused at rest, as its value ranges may be out of date.
        """
        if self.shown is None or (self.shown.picture.state.is_moving and not state.is_moving):
            return False
        return self.shown.quality.is_at_least(quality)

    def _render(self, jobs: list[Job], cancel: CancelToken | None) -> list[FrameStats]:
        """Draw the sides that are not cached, and return the statistics of these drawings.

        Raises:
            Cancelled: If they are no longer wanted.
        """
        asked: dict[tuple[Any, ...], tuple[Job, tuple[str, ...]]] = {}
        for job in jobs:
            before = asked[job.key][1] if job.key in asked else ()
            asked[job.key] = job, tuple(dict.fromkeys((*before, *job.aovs)))
        known, self._drawn = self._drawn, {}
        new = []
        for key, (job, aovs) in asked.items():
            have = known.get(key)
            lasts = have is not None and not (job.reads_stage or have.stats.missing)
            if have is not None and have.stats.lacks_light:
                lasts = lasts and not job.waits_for_light
            if have is None or not lasts or not set(aovs) <= have.arrays.keys():
                engine = job.scene.engine
                patience = Patience(cancel=cancel, light=job.waits_for_light)
                arrays = engine.picture(job.view, job.settings, aovs, sync=False, patience=patience)
                have = _Drawn(arrays, engine.stats)
                new.append(have.stats)
            self._drawn[key] = have
        return new

    def _composed(self, state: ViewState, sides: list[Side], quality: Quality) -> Image:
        """Return the image of the only side, or both sides of a comparison, divided at the wipe."""
        images = [
            self._display.image(
                side.look,
                side.arrays,
                state.display,
                scale=quality.scale,
                is_moving=state.is_moving,
                prims=side.scene.prims,
                subject=side.scene.subject if side.look.aov == "P" else None,
                levels=_levels(state, side),
            )
            for side in sides
        ]
        if len(images) == 1:
            return images[0]
        cut = round(cut_of(state) / quality.scale)
        return np.concatenate([images[0][:, :cut], images[1][:, cut:]], axis=1)

    def _learn(
        self, quality: Quality, milliseconds: Mapping[str, float], display: float, load: Load
    ) -> None:
        """Report times to the pacer, except those of the first picture, which includes loading
        kernels."""
        if self._is_warm:
            fixed = sum(milliseconds.get(name, 0.0) for name in FIXED)
            once = sum(milliseconds.get(name, 0.0) for name in ONCE)
            rest = sum(milliseconds.values()) - fixed - once + display
            self._pacer.drew(quality, load, fixed=fixed, rest=rest)
        self._is_warm = True


def _key(
    state: ViewState, scenes: tuple[Scene, ...], found: Overlays, warnings: tuple[str, ...]
) -> tuple[Any, ...]:
    """Return what a picture shows, in whatever quality."""
    return replace(state, is_moving=False), *(each.place for each in scenes), found, warnings


def _follow(state: ViewState, scenes: tuple[Scene, ...]) -> bool:
    """Choose the items of LOD roots for the views; return whether this changed a scene."""
    for scene in scenes:
        scene.engine.sync(view_of(scene, state.size, 1.0))
    return any(scene.engine.version != scene.version for scene in scenes)


def _levels(state: ViewState, side: Side) -> Levels | None:
    """Return the levels of splat trees, if a side shows them."""
    shows = needed(side.look)[0] == "elementId" and state.display.id_colors == "levels"
    return Levels.of(side.scene.engine.render_scene) if shows else None


def _reads(scenes: tuple[Scene, ...]) -> int:
    """Return the number of finished reads of nodes of splat trees."""
    return sum(each.nodes.reads for each in scenes)


def _load(state: ViewState, scenes: tuple[Scene, ...]) -> Load:
    return Load(
        pixels=state.size[0] * state.size[1],
        splats=max(_budgeted(scene) for scene in scenes),
        samples=max(scene.samples for scene in scenes),
        has_trees=any(scene.has_trees for scene in scenes),
    )


def _budgeted(scene: Scene) -> int:
    """Return the number of splats that a look draws in full quality."""
    return min(scene.splats, scene.look.settings.splat_budget or scene.splats)


def _added(books: Iterable[Mapping[str, float]]) -> dict[str, float]:
    """Return the sums of the times of several pictures, by stage."""
    total: dict[str, float] = {}
    for book in books:
        for stage, spent in book.items():
            total[stage] = total.get(stage, 0.0) + spent
    return total
