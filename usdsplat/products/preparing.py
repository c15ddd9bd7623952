"""Prepare the drawing of pictures: choose files, cameras and bands, and check everything."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from usdsplat.core.errors import OutputError, UsageError
from usdsplat.core.findings import Findings
from usdsplat.core.output import Existing
from usdsplat.delegate.engine import Engine
from usdsplat.images.aovs import is_light
from usdsplat.products import remarks
from usdsplat.products.budget import WORTH_SAYING, Budget, budget, with_node_memory
from usdsplat.products.existing import difference
from usdsplat.products.frames import framed
from usdsplat.products.header import stage_hash
from usdsplat.products.holdouts import check_file, holdout_of, lacking_depth
from usdsplat.products.preflight import findings_of, go_to
from usdsplat.products.request import PicturePlan
from usdsplat.products.source_hash import source_hash
from usdsplat.products.stamp import picture_stamp
from usdsplat.products.tiles import TileStep, is_drawn, remove_tiles
from usdsplat.render.cost import Work
from usdsplat.render.specs import CameraSpec

if TYPE_CHECKING:
    from usdsplat.images.holdout import Holdout

_Job = tuple[PicturePlan, float, Path]
"""Plan, time code and file of a picture; with tiles, the plan is that of a tile."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawOptions:
    """Options for drawing a sequence of pictures."""

    existing: Existing = "replace"
    """How to treat existing files; "resume" keeps them and skips their pictures, unless a file is
    truncated or another picture, see `existing.difference`."""
    memory_limit: int | None = None
    """Maximum memory of the process [byte]; None for no limit."""
    tile: TileStep | None = None
    """What to do with the tiles of each picture; None for whole pictures."""
    files: tuple[Path, ...] = ()
    """Files of a capture; empty for a stage, whose files are known."""
    chunks: tuple[Path, ...] = ()
    """Further files of a capture, of which only names and sizes are compared."""
    opening: tuple[str, ...] = ()
    """How the stage was opened, where its files do not say it: variants, muted layers, a mask, the
    axes of a capture."""
    fitted: tuple[float, ...] = ()
    """Frames that the camera of a picture without one frames; empty for the first, the middle and
    the last one."""


DRAW_OPTIONS = DrawOptions()


def work_of(plans: Sequence[PicturePlan], frames: Sequence[float]) -> list[Work]:
    """Return the work that `draw_frames` will do, for `Engine.expect`."""
    return [
        Work(
            pixels=math.prod(plan.framing.resolution) * len(frames),
            pictures=len(frames),
            settings=plan.settings,
            aovs=plan.aovs,
            deep=plan.deep,
        )
        for plan in plans
    ]


def check_frames(
    engine: Engine,
    plans: Sequence[PicturePlan],
    frames: Sequence[float],
    *,
    options: DrawOptions = DRAW_OPTIONS,
    findings: Findings,
) -> None:
    """Check what `draw_frames` checks before it draws. Arguments and errors are those of it."""
    prepared(engine, plans, frames, options, findings)


@dataclass(frozen=True, slots=True, eq=False)
class Preparation:
    """What is known before the first picture is drawn."""

    jobs: list[_Job]
    cameras: dict[PicturePlan, CameraSpec | None]
    """Cameras of pictures that have none on the stage."""
    budgets: dict[PicturePlan, Budget]
    whole: dict[PicturePlan, PicturePlan]
    """Plan of what is drawn -> plan of the picture."""
    opening: tuple[str, ...]
    fitted: tuple[float, ...]
    """Frames that the camera of a picture without one frames."""
    source: Callable[[], str]
    """Returns the hash of the files of the stage or capture; "" if they are not saved."""

    def stamp(self, plan: PicturePlan, frame: float) -> str:
        """Return the stamp of a picture, which its tiles share."""
        return picture_stamp(
            self.whole[plan],
            frame,
            source=self.source(),
            opening=self.opening,
            fitted=self.fitted,
        )

    def lasting_stamp(self, plan: PicturePlan, frame: float) -> str:
        """Return the stamp of a picture; "" if nobody could tell later of what it was made."""
        return self.stamp(plan, frame) if self.source() else ""

    def has_tile(self, engine: Engine, step: TileStep, job: _Job) -> bool:
        """Return whether the tile of a step is drawn, as it would be drawn now."""
        plan, frame, path = job
        return is_drawn(step.path(path), self.stamp(plan, frame), engine.device)


def prepared(
    engine: Engine,
    plans: Sequence[PicturePlan],
    frames: Sequence[float],
    options: DrawOptions,
    findings: Findings,
) -> Preparation:
    """Check everything before the first picture is drawn."""
    plans = [with_node_memory(plan, options.memory_limit) for plan in plans]
    whole = {options.tile.planned(plan) if options.tile else plan: plan for plan in plans}
    jobs: list[_Job] = []
    cameras: dict[PicturePlan, CameraSpec | None] = {}
    budgets: dict[PicturePlan, Budget] = {}
    fitted = framed(options.fitted or frames)

    @functools.cache
    def source() -> str:
        files, chunks = (list(map(str, each)) for each in (options.files, options.chunks))
        return stage_hash(engine) or source_hash(files, chunks)

    found = Preparation(jobs, cameras, budgets, whole, options.opening, fitted, source)
    jobs += _undrawn(engine, found, frames, options, findings)
    if jobs:
        cameras |= {plan: _framing_camera(engine, whole[plan], fitted) for plan in whole}
    if options.existing == "resume" and options.tile is not None and not options.tile.joins:
        jobs[:] = [job for job in jobs if not found.has_tile(engine, options.tile, job)]
    engine.expect(work_of(list(whole), frames))
    if engine.remark:
        findings.say(engine.remark)
    holdouts = _opened(jobs)
    budgets |= _budgets(engine, found, holdouts, options, findings)
    if findings.is_strict:
        for plan, frame, _ in jobs:
            findings.extend(findings_of(engine, plan, frame, cameras[plan]))
            if wrong := lacking_depth(plan, holdout_of(plan, frame)):
                findings.add(wrong)
        findings.check()
    return found


def _budgets(
    engine: Engine,
    ready: Preparation,
    holdouts: dict[PicturePlan, Holdout | None],
    options: DrawOptions,
    findings: Findings,
) -> dict[PicturePlan, Budget]:
    """Choose the bands of each picture by its first frame, before any picture is drawn."""
    budgets: dict[PicturePlan, Budget] = {}
    limit = options.memory_limit
    is_tile = options.tile is not None and not options.tile.joins
    for plan, frame, path in ready.jobs:
        if plan in budgets:
            continue
        view = go_to(engine, plan, frame, ready.cameras[plan])
        holdout = holdouts[plan]
        nodes = 0.0 if holdout is None else holdout.nodes
        found = budgets[plan] = budget(
            engine, plan, view, limit=limit, held_nodes=nodes, is_tile=is_tile
        )
        findings.extend(plan.findings)
        if plan.deep:
            findings.say(remarks.what_is_forced(plan))
        elif any(map(is_light, plan.aovs)):
            findings.say(remarks.what_lights_force(plan))
        if limit is not None or found.estimate.total > WORTH_SAYING:
            findings.say(f"{path.name}: {found.sentence()}")
    return budgets


def _opened(jobs: Sequence[_Job]) -> dict[PicturePlan, Holdout | None]:
    """Open the first holdout of each picture. Raise an error before drawing if one is missing."""
    first: dict[PicturePlan, float] = {}
    for plan, frame, _ in jobs:
        check_file(plan, frame)
        first.setdefault(plan, frame)
    return {plan: holdout_of(plan, frame) for plan, frame in first.items()}


def _framing_camera(
    engine: Engine, plan: PicturePlan, frames: Sequence[float]
) -> CameraSpec | None:
    """Return one camera for all frames if the picture has none, so that motion is visible.

    Args:
        frames: Those that it frames.
    """
    if plan.camera is not None:
        return None
    engine.set_purposes(plan.purposes)
    return engine.framing_camera(frames, framing=plan.framing)


def files_of(plans: Sequence[PicturePlan], frames: Sequence[float]) -> list[tuple[Path, ...]]:
    """Return the file of each frame of each picture.

    Raises:
        UsageError: If two pictures have the same file.
    """
    names = [plan.output.paths(frames) for plan in plans]
    paths = [path for group in names for path in group]
    if len(set(paths)) < len(paths):
        twice = next(path for path in paths if paths.count(path) > 1)
        raise UsageError(str(twice), "two products with this file", "a file for each")
    return names


def _undrawn(
    engine: Engine,
    ready: Preparation,
    frames: Sequence[float],
    options: DrawOptions,
    findings: Findings,
) -> list[_Job]:
    """Return the pictures whose files are to be written, frame by frame."""
    plans = ready.whole
    names = files_of(list(plans.values()), frames)
    jobs = [
        (plan, frame, group[i])
        for i, frame in enumerate(frames)
        for plan, group in zip(plans, names, strict=True)
    ]
    if options.existing == "replace":
        return jobs
    if options.existing == "error":
        there = next((path for _, _, path in jobs if path.exists()), None)
        if there is not None:
            raise OutputError(str(there), "a file", "a new name")
        return jobs
    left, current = [], stage_hash(engine)
    for plan, frame, path in jobs:
        is_there, found = path.exists(), ""
        if is_there:
            stamp = ready.lasting_stamp(plan, frame)
            found = difference(plans[plan], frame, path, stage_hash=current, stamp=stamp)
        if found:
            findings.say(f"{path}: found {found}; it is drawn again")
        if found or not is_there:
            left.append((plan, frame, path))
        elif options.tile is not None:
            remove_tiles(path)  # a join that was killed may have left some
    return left
