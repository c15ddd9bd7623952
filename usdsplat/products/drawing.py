"""Draw pictures into files, one after the other. Incomplete files are never left behind."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from usdsplat.core.errors import OutputError, UsageError
from usdsplat.core.findings import Findings
from usdsplat.core.folders import made_folder
from usdsplat.core.output import Existing
from usdsplat.core.progress import Progress, silent
from usdsplat.core.wording import counted
from usdsplat.delegate.engine import Engine
from usdsplat.images.deep_aovs import ALWAYS
from usdsplat.products import remarks
from usdsplat.products.budget import WORTH_SAYING, Budget, budget, with_node_memory
from usdsplat.products.cancel import Cancelled, CancelToken
from usdsplat.products.deep import DeepReport, draw_deep
from usdsplat.products.existing import difference
from usdsplat.products.flat import draw_flat
from usdsplat.products.header import Origin, labelled_layout, stage_hash
from usdsplat.products.holdouts import check_file, holdout_of, lacking_depth
from usdsplat.products.picture_file import PictureFile, RowsWritten
from usdsplat.products.preflight import findings_of, go_to, of_drawn, of_picture
from usdsplat.products.request import PicturePlan
from usdsplat.render.cost import Work
from usdsplat.render.specs import CameraSpec

if TYPE_CHECKING:
    from usdsplat.images.holdout import Holdout

_Job = tuple[PicturePlan, float, Path]
"""Plan, time code and file of a picture."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawOptions:
    """Options for drawing a sequence of pictures."""

    existing: Existing = "replace"
    """How to treat existing files; "resume" keeps them and skips their pictures, unless a file is
    truncated or another picture, see `existing.difference`."""
    memory_limit: int | None = None
    """Maximum memory of the process [byte]; None for no limit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnPicture:
    """Report on a picture whose file is complete."""

    path: Path
    frame: float
    product: str | None
    """Path of the RenderProduct; None for a picture that no product of the stage describes."""
    camera: str | None
    """Path of the camera; None for a camera that frames the scene."""
    aovs: tuple[str, ...]
    """Names of the AOVs in the file, see `images.aovs.AOVS`."""
    device: str
    """Name of the device that drew it."""
    resolution: tuple[int, int]
    """Width and height [pixel]."""
    splats: int
    """Number of drawn splats; each instance counts."""
    visible: int
    """Number of splats that may touch the data window."""
    seconds: float
    """Time for drawing and writing [s]."""
    deep_samples: int | None = None
    """Number of samples of a deep picture."""


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


def draw_frames(
    engine: Engine,
    plans: Sequence[PicturePlan],
    frames: Sequence[float],
    *,
    source: str,
    options: DrawOptions = DrawOptions(),
    progress: Progress = silent,
    findings: Findings | None = None,
    cancel: CancelToken | None = None,
) -> Iterator[DrawnPicture]:
    """Draw every picture at every frame, frame by frame, and yield each when its file is complete.

    Folders of files that do not exist are made.

    Args:
        engine: Engine of the stage; its time and purposes are changed.
        plans: The pictures.
        frames: Time codes.
        source: Name of the stage in the headers of the files.
        options: Treatment of existing files, and the memory limit.
        progress: Receives the progress in rows of all pictures together.
        findings: Receives what the stage asks for and does not get, at every frame, and messages
            on problems that are not visible in the pictures.
        cancel: Stops the drawing after the current band; complete files are kept.

    Raises:
        UsageError: If two pictures have the same file, or the memory limit is too low.
        StageError: If a camera cannot be used.
        OutputError: If a file cannot be written, or exists and `existing` is "error".
        StrictError: If `findings` are strict and not empty; then nothing is written.
    """
    cancel = cancel or CancelToken()
    findings = Findings() if findings is None else findings
    plans = [with_node_memory(plan, options.memory_limit) for plan in plans]
    jobs = _jobs(engine, plans, frames, options.existing, findings)
    engine.expect(work_of(plans, frames))
    said = engine.remark
    if said:
        findings.say(said)
    holdouts = _opened(jobs)
    cameras = {plan: _framing_camera(engine, plan, frames) for plan, _, _ in jobs}
    budgets = _budgets(engine, jobs, cameras, holdouts, options.memory_limit, findings)
    if findings.is_strict:
        for plan, frame, _ in jobs:
            findings.extend(findings_of(engine, plan, frame, cameras[plan]))
            if wrong := lacking_depth(plan, holdout_of(plan, frame)):
                findings.add(wrong)
        findings.check()
    warned: set[PicturePlan] = set()
    rows, total = 0, sum(plan.rows for plan, _, _ in jobs)
    what = jobs[0][2].name if len(jobs) == 1 else counted(len(jobs), "picture")
    label = f"{what}, row"
    progress.step(label, 0, total)
    for plan, frame, path in jobs:
        started = time.perf_counter()
        view = go_to(engine, plan, frame, cameras[plan])
        since = None if frame == jobs[0][1] else frame
        findings.extend(of_picture(engine, plan, view.camera), time=since)

        def rows_written(done: int, before: int = rows) -> None:
            progress.step(label, before + done, total)
            cancel.check()

        holdout = holdout_of(plan, frame)
        wrong = lacking_depth(plan, holdout)
        if wrong is not None and plan not in warned:  # their number differs from frame to frame
            warned.add(plan)
            findings.add(wrong, time=since)
        origin = Origin(stage=source, frame=frame)
        file = PictureFile(
            plan=plan,
            path=path,
            view=view,
            layout=labelled_layout(engine, plan, view, origin=origin),
            holdout=None if holdout is None else holdout.rows,
            band_pixels=budgets[plan].band_pixels,
            deep_entries=budgets[plan].deep_entries,
        )
        engine.render_scene.node_cache.most = budgets[plan].node_bytes
        try:
            cancel.check()
            with made_folder(path.parent):
                report = write_picture(engine, file, rows_written=rows_written)
        except Cancelled:
            return
        rows += plan.rows
        stats, seconds = engine.stats, time.perf_counter() - started
        if report is not None:
            stats = replace(stats, missing=report.missing)
            findings.say(remarks.what_is_deep(path, report, seconds))
        elif plan.settings.color_mode == "inverseView":
            findings.say(remarks.what_fails(path, stats))
        if engine.remark != said:  # a GPU has failed in the meantime
            said = engine.remark
            findings.say(said)
        findings.extend(of_drawn(engine, view, plan.settings, stats), time=since)
        yield DrawnPicture(
            path=path,
            frame=frame,
            product=plan.product or None,
            camera=view.camera.path or None,
            aovs=tuple(dict.fromkeys((*ALWAYS, *plan.aovs))) if plan.deep else plan.aovs,
            device=engine.device,
            resolution=view.framing.resolution,
            splats=stats.splats,
            visible=stats.visible,
            seconds=seconds,
            deep_samples=None if report is None else report.samples,
        )


def write_picture(
    engine: Engine, file: PictureFile, *, rows_written: RowsWritten = lambda rows: None
) -> DeepReport | None:
    """Draw one picture at the engine's time into its file. Return a report for a deep picture.

    Args:
        engine: Engine that draws.
        file: The picture and its file.
        rows_written: Called after each band. An exception that it raises ends the drawing, and no
            file is left.

    Raises:
        UsageError: If a deep picture is requested and splats are not sorted by planar depth.
        OutputError: If the file cannot be written.
    """
    if file.plan.deep:
        return draw_deep(engine, file, rows_written=rows_written)
    draw_flat(engine, file, rows_written=rows_written)
    return None


def _budgets(
    engine: Engine,
    jobs: Sequence[_Job],
    cameras: dict[PicturePlan, CameraSpec | None],
    holdouts: dict[PicturePlan, Holdout | None],
    limit: int | None,
    findings: Findings,
) -> dict[PicturePlan, Budget]:
    """Choose the bands of each picture by its first frame, before any picture is drawn."""
    budgets: dict[PicturePlan, Budget] = {}
    for plan, frame, path in jobs:
        if plan in budgets:
            continue
        view = go_to(engine, plan, frame, cameras[plan])
        holdout = holdouts[plan]
        nodes = 0.0 if holdout is None else holdout.nodes
        found = budgets[plan] = budget(engine, plan, view, limit=limit, held_nodes=nodes)
        findings.extend(plan.findings)
        if plan.deep:
            findings.say(remarks.what_is_forced(plan))
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
    """Return one camera for all frames if the picture has none, so that motion is visible."""
    if plan.camera is not None:
        return None
    engine.set_purposes(plan.purposes)
    times = dict.fromkeys((frames[0], frames[len(frames) // 2], frames[-1]))
    return engine.framing_camera(times, framing=plan.framing)


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


def _jobs(
    engine: Engine,
    plans: Sequence[PicturePlan],
    frames: Sequence[float],
    existing: Existing,
    findings: Findings,
) -> list[_Job]:
    """Return the pictures to draw with their files, frame by frame."""
    names = files_of(plans, frames)
    jobs = [
        (plan, frame, group[i])
        for i, frame in enumerate(frames)
        for plan, group in zip(plans, names, strict=True)
    ]
    if existing == "replace":
        return jobs
    if existing == "error":
        there = next((path for _, _, path in jobs if path.exists()), None)
        if there is not None:
            raise OutputError(str(there), "a file", "a new name")
        return jobs
    left, current = [], stage_hash(engine)
    for plan, frame, path in jobs:
        found = difference(plan, frame, path, stage_hash=current) if path.exists() else ""
        if found:
            findings.say(f"{path}: found {found}; it is drawn again")
        if found or not path.exists():
            left.append((plan, frame, path))
    return left
