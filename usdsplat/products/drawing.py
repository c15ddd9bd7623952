"""Draw pictures into files, one after the other. Incomplete files are never left behind."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from usdsplat.core.cancel import Cancelled, CancelToken
from usdsplat.core.findings import Findings
from usdsplat.core.folders import made_folder
from usdsplat.core.progress import Progress, silent
from usdsplat.core.wording import counted
from usdsplat.delegate.engine import Engine
from usdsplat.images.deep_aovs import ALWAYS
from usdsplat.products import remarks
from usdsplat.products.deep import DeepReport, draw_deep
from usdsplat.products.flat import draw_flat
from usdsplat.products.header import Origin, labelled_layout
from usdsplat.products.holdouts import holdout_of, lacking_depth
from usdsplat.products.picture_file import PictureFile, RowsWritten
from usdsplat.products.preflight import go_to, of_drawn, of_picture
from usdsplat.products.preparing import DRAW_OPTIONS, DrawOptions, prepared
from usdsplat.products.request import PicturePlan


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


def draw_frames(
    engine: Engine,
    plans: Sequence[PicturePlan],
    frames: Sequence[float],
    *,
    source: str,
    options: DrawOptions = DRAW_OPTIONS,
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
    ready = prepared(engine, plans, frames, options, findings)
    jobs, cameras, budgets = ready.jobs, ready.cameras, ready.budgets
    said = engine.remark
    warned: set[PicturePlan] = set()
    step = options.tile
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
        origin = Origin(stage=source, frame=frame, stamp=ready.lasting_stamp(plan, frame))
        file = PictureFile(
            plan=plan,
            path=path if step is None or step.joins else step.path(path),
            view=view,
            layout=labelled_layout(engine, plan, view, origin=origin),
            holdout=None if holdout is None else holdout.rows,
            band_pixels=budgets[plan].band_pixels,
            deep_entries=budgets[plan].deep_entries,
        )
        engine.render_scene.node_cache.most = budgets[plan].node_bytes
        try:
            cancel.check()
            with made_folder(file.path.parent):
                if step is None:
                    report = write_picture(engine, file, rows_written=rows_written)
                    stats = engine.stats
                else:
                    stamped = ready.stamp(plan, frame)
                    report, stats = step.write(
                        engine, file, path, stamped, rows_written=rows_written
                    )
        except Cancelled:
            return
        rows += plan.rows
        seconds = time.perf_counter() - started
        if report is not None:
            stats = replace(stats, missing=report.missing)
            if step is None or step.joins:
                findings.say(remarks.what_is_deep(path, report, seconds))
        elif plan.settings.color_mode == "inverseView":
            findings.say(remarks.what_fails(path, stats))
        if engine.remark != said:  # a GPU has failed in the meantime
            said = engine.remark
            findings.say(said)
        if step is None or step.joins:  # a tile may be empty
            findings.extend(of_drawn(engine, view, plan.settings, stats), time=since)
        yield DrawnPicture(
            path=file.path,
            frame=frame,
            product=plan.product or None,
            camera=view.camera.path or None,
            aovs=aovs_in(plan),
            device=engine.device,
            resolution=view.framing.resolution,
            splats=stats.splats,
            visible=stats.visible,
            seconds=seconds,
            deep_samples=None if report is None else report.samples,
        )


def aovs_in(plan: PicturePlan) -> tuple[str, ...]:
    """Return the names of the AOVs in the file of a picture."""
    return tuple(dict.fromkeys((*ALWAYS, *plan.aovs))) if plan.deep else plan.aovs


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
