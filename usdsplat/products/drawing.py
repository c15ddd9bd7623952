"""Pictures to files: one after the other, each whole or not at all."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from usdsplat.core.errors import UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.core.wording import counted
from usdsplat.delegate.engine import Engine
from usdsplat.images.frames import frame_path, frame_paths
from usdsplat.products import remarks
from usdsplat.products.budget import WORTH_SAYING, Budget, budget
from usdsplat.products.deep import DeepReport, draw_deep
from usdsplat.products.flat import draw_flat
from usdsplat.products.header import labelled
from usdsplat.products.request import Picture
from usdsplat.render.cost import Work
from usdsplat.render.occluders import ReadHoldout
from usdsplat.render.specs import CameraSpec, View

Remark = Callable[[str], None]
Job = tuple[Picture, float, Path]
"""What is drawn, at which time code, into which file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn:
    """A finished picture."""

    path: Path
    frame: float
    camera: str | None
    """Path of the camera; None for one that frames the scene."""
    resolution: tuple[int, int]
    """[pixel]"""
    splats: int
    """Splats that were drawn, instances counted each."""
    visible: int
    """Those that may touch the picture."""
    seconds: float
    """Time it took, file included."""
    deep_samples: int | None = None
    """Of all pixels of a deep picture."""


def work_of(pictures: Sequence[Picture], frames: Sequence[float]) -> list[Work]:
    """Return what `draw_frames` will draw, for `Engine.expect`."""
    return [
        Work(
            pixels=math.prod(picture.framing.resolution) * len(frames),
            pictures=len(frames),
            settings=picture.settings,
            aovs=picture.aovs,
            deep=picture.deep,
        )
        for picture in pictures
    ]


def draw_frames(
    engine: Engine,
    pictures: Sequence[Picture],
    frames: Sequence[float],
    *,
    source: str,
    resume: bool = False,
    memory_limit: int | None = None,
    progress: Progress = silent,
    remark: Remark = lambda _: None,
) -> Iterator[Drawn]:
    """Draw every picture at every frame, frame after frame; yield each when its file is there.

    Args:
        engine: Whose stage is drawn; its time and purposes are set.
        pictures: What to draw.
        frames: Time codes.
        source: What the stage is called in the files.
        resume: Leave out pictures whose file exists.
        memory_limit: [byte] that the process may take.
        progress: Told about the rows of all pictures together.
        remark: Told what a user would not see in the pictures.

    Raises:
        UsageError: If two pictures would be one file, or the memory is too little.
        StageError: If a camera cannot be used.
        OutputError: If a file cannot be written.
    """
    jobs = _jobs(pictures, frames, resume)
    engine.expect(work_of(pictures, frames))
    before = engine.remark
    tell = _once(remark)
    _check_holdouts(jobs)
    cameras = {picture: _framing_camera(engine, picture, frames) for picture, _, _ in jobs}
    budgets = _budgets(engine, jobs, cameras, memory_limit, tell)
    rows, total = 0, sum(picture.rows for picture, _, _ in jobs)
    what = jobs[0][2].name if len(jobs) == 1 else counted(len(jobs), "picture")
    label = f"{what}, row"
    progress.step(label, 0, total)
    for picture, frame, path in jobs:
        started = time.perf_counter()
        view = _go_to(engine, picture, frame, cameras[picture])

        def finished(done: int, before: int = rows) -> None:
            progress.step(label, before + done, total)

        report = _draw(
            engine, picture, path, view, frame, source, budgets[picture].band_pixels, finished
        )
        rows += picture.rows
        stats, seconds = engine.stats, time.perf_counter() - started
        if report is not None:
            remark(remarks.what_is_deep(path, report, seconds))
        elif picture.settings.color_mode == "inverseView":
            remark(remarks.what_fails(path, stats))
        if engine.remark != before:  # a GPU has failed meanwhile
            tell(engine.remark)
        empty = remarks.why_nothing(engine, stats)
        if empty:
            tell(f"nothing is drawn: {empty}", f"{path}: ")
        yield Drawn(
            path=path,
            frame=frame,
            camera=view.camera.path or None,
            resolution=view.framing.resolution,
            splats=stats.splats,
            visible=stats.visible,
            seconds=seconds,
            deep_samples=None if report is None else report.samples,
        )


def _draw(
    engine: Engine,
    picture: Picture,
    path: Path,
    view: View,
    frame: float,
    source: str,
    band_pixels: int,
    finished: Callable[[int], None],
) -> DeepReport | None:
    """Draw one picture at the engine's time into its file."""
    layout = labelled(engine, picture, view, stage=source, frame=frame)
    holdout = _holdout(picture, frame)
    if picture.deep:
        return draw_deep(
            engine, picture, path, view, layout,
            holdout=holdout, band_pixels=band_pixels, finished=finished,
        )  # fmt: skip
    draw_flat(
        engine, picture, path, view, layout,
        holdout=holdout, band_pixels=band_pixels, finished=finished,
    )  # fmt: skip
    return None


def _go_to(engine: Engine, picture: Picture, frame: float, camera: CameraSpec | None) -> View:
    """Bring the engine to a frame; return what the picture looks at there."""
    engine.set_refinement(picture.settings.refinement)
    engine.set_time(frame)
    engine.set_purposes(picture.purposes)
    if camera is None:
        view = engine.view(picture.camera, framing=picture.framing)
    else:
        view = View(camera=camera, framing=picture.framing)
    return replace(view, matte=picture.matte)


def _budgets(
    engine: Engine,
    jobs: Sequence[Job],
    cameras: dict[Picture, CameraSpec | None],
    limit: int | None,
    tell: Callable[..., None],
) -> dict[Picture, Budget]:
    """The bands of each picture, by its first frame, before anything is drawn."""
    budgets: dict[Picture, Budget] = {}
    for picture, frame, path in jobs:
        if picture in budgets:
            continue
        view = _go_to(engine, picture, frame, cameras[picture])
        found = budgets[picture] = budget(engine, picture, view, limit=limit)
        for text in picture.warnings:
            tell(text)
        if picture.deep:
            tell(remarks.what_is_forced(picture))
        if sharp := remarks.why_sharp(picture, view.camera):
            tell(sharp)
        if limit is not None or found.estimate.total > WORTH_SAYING:
            tell(found.sentence(), f"{path.name}: ")
    return budgets


def _once(remark: Remark) -> Callable[..., None]:
    """A remark that is made once, about the first that it is true of."""
    told: set[str] = set()

    def tell(text: str, where: str = "") -> None:
        if text not in told:
            told.add(text)
            remark(where + text)

    return tell


def _holdout(picture: Picture, frame: float) -> ReadHoldout | None:
    """What hides from elsewhere at a frame."""
    if picture.holdout is None:
        return None
    from usdsplat.images.holdout import open_holdout

    path = frame_path(picture.holdout, frame)
    return open_holdout(path, resolution=picture.framing.resolution).rows


def _check_holdouts(jobs: Sequence[Job]) -> None:
    """Refuse to begin what could not be finished: all holdouts must be there."""
    for picture, frame, _ in jobs:
        if picture.holdout is not None:
            path = frame_path(picture.holdout, frame)
            if not path.is_file():
                raise UsageError("--holdout", f"no file {path}", "an EXR with depth")
    for picture in dict.fromkeys(picture for picture, _, _ in jobs):
        first = next(frame for other, frame, _ in jobs if other is picture)
        _holdout(picture, first)


def _framing_camera(engine: Engine, picture: Picture, frames: Sequence[float]) -> CameraSpec | None:
    """One camera for all frames where the picture has none of its own, so that motion shows."""
    if picture.camera is not None:
        return None
    engine.set_purposes(picture.purposes)
    times = dict.fromkeys((frames[0], frames[len(frames) // 2], frames[-1]))
    return engine.framing_camera(times, framing=picture.framing)


def _jobs(pictures: Sequence[Picture], frames: Sequence[float], resume: bool) -> list[Job]:
    """What is to be drawn into which file, frame after frame."""
    names = [frame_paths(picture.output, frames) for picture in pictures]
    paths = [path for group in names for path in group]
    if len(set(paths)) < len(paths):
        twice = next(path for path in paths if paths.count(path) > 1)
        raise UsageError(str(twice), "two products with this file", "a file for each")
    jobs = [
        (picture, frame, group[i])
        for i, frame in enumerate(frames)
        for picture, group in zip(pictures, names, strict=True)
    ]
    return [job for job in jobs if not (resume and job[2].exists())]
