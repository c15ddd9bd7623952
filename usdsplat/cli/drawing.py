"""Pictures to files: one after the other, each whole or not at all."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from usdsplat.cli.planning import OUTPUT_SPACE, Picture
from usdsplat.core.errors import UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.framing import conform
from usdsplat.delegate.specs import CameraSpec, View
from usdsplat.images import open_writer
from usdsplat.images.aovs import AOVS
from usdsplat.images.camera import camera_metadata
from usdsplat.images.frames import frame_paths
from usdsplat.images.layout import ImageLayout


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


def draw_frames(
    engine: Engine,
    pictures: Sequence[Picture],
    frames: Sequence[float],
    *,
    source: str,
    resume: bool = False,
    progress: Progress = silent,
) -> Iterator[Drawn]:
    """Draw every picture at every frame, frame after frame; yield each when its file is there.

    Args:
        engine: Whose stage is drawn; its time and purposes are set.
        pictures: What to draw.
        frames: Time codes.
        source: What the stage is called in the files.
        resume: Leave out pictures whose file exists.
        progress: Told about pictures, or about rows when there is only one.

    Raises:
        UsageError: If two pictures would be one file.
        StageError: If a camera cannot be used.
        OutputError: If a file cannot be written.
    """
    jobs = _jobs(pictures, frames, resume)
    cameras = {picture: _framing_camera(engine, picture, frames) for picture, _, _ in jobs}
    for done, (picture, frame, path) in enumerate(jobs):
        started = time.perf_counter()
        engine.set_time(frame)
        engine.set_purposes(picture.purposes)
        metadata: dict[str, str | float] = {"usdsplat:stage": source, "usdsplat:frame": frame}
        rows = progress if len(jobs) == 1 else silent
        camera = cameras[picture]
        view = draw(engine, picture, path, camera=camera, metadata=metadata, progress=rows)
        if len(jobs) > 1:
            progress.step("rendering", done + 1, len(jobs))
        yield Drawn(
            path=path,
            frame=frame,
            camera=view.camera.path or None,
            resolution=view.framing.resolution,
            splats=engine.stats.splats,
            visible=engine.stats.visible,
            seconds=time.perf_counter() - started,
        )


def draw(
    engine: Engine,
    picture: Picture,
    path: Path,
    *,
    camera: CameraSpec | None = None,
    metadata: Mapping[str, str | float],
    progress: Progress = silent,
) -> View:
    """Draw `picture` at the engine's time into `path`, band by band; return what was looked at.

    Args:
        engine: Whose stage is drawn; at its time, with its purposes.
        picture: What to draw.
        path: The file, the frame number in its name.
        camera: Takes the place of the picture's.
        metadata: Header entries that the picture itself does not know.
        progress: Told how many rows are finished.

    Raises:
        StageError: If the camera cannot be used.
        OutputError: If the file cannot be written.
    """
    if camera is None:
        view = engine.view(picture.camera, framing=picture.framing)
    else:
        view = View(camera=camera, framing=picture.framing)
    window, pixel_aspect_ratio = conform(view.camera.window, view.framing)
    seen_by = camera_metadata(
        world_to_camera=view.camera.world_to_camera,
        window=window,
        orthographic=view.camera.orthographic,
    )
    layout = ImageLayout(
        resolution=view.framing.resolution,
        data_window=view.framing.data_window,
        pixel_aspect_ratio=pixel_aspect_ratio,
        aovs=picture.aovs,
        pixel_type=picture.pixel_type,
        color_space=OUTPUT_SPACE[picture.settings.color_mode],
        metadata={**seen_by, **_drawing_metadata(engine, picture, view), **metadata},
    )
    names = {AOVS[name].hydra: AOVS[name] for name in picture.aovs}
    with open_writer(path, layout) as writer:
        for band in engine.render(view, picture.settings, tuple(names)):
            # -1, which stands for nothing among the renderer's ids, is 2**32 - 1 in the file.
            arrays = {
                aov.name: array.view(np.uint32) if aov.kind == "id" else array
                for aov, array in ((names[key], band.arrays[key]) for key in names)
            }
            writer.write_band(band.y0, arrays)
            progress.step(path.name, band.y1 - layout.window[1], layout.shape[0])
    return view


def why_nothing(engine: Engine, drawn: Drawn) -> str:
    """Say why there is no splat in a picture, at the engine's time; "" if there is one."""
    if drawn.visible:
        return ""
    if not engine.fields():
        return "the stage has no splats"
    if not drawn.splats:
        return "all splats are hidden, of other purposes, or cannot be drawn"
    return "no splats are in view"


def _framing_camera(engine: Engine, picture: Picture, frames: Sequence[float]) -> CameraSpec | None:
    """One camera for all frames where the picture has none of its own, so that motion shows."""
    if picture.camera is not None:
        return None
    engine.set_purposes(picture.purposes)
    times = dict.fromkeys((frames[0], frames[len(frames) // 2], frames[-1]))
    return engine.framing_camera(times, framing=picture.framing)


def _jobs(
    pictures: Sequence[Picture], frames: Sequence[float], resume: bool
) -> list[tuple[Picture, float, Path]]:
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


def _drawing_metadata(engine: Engine, picture: Picture, view: View) -> dict[str, str]:
    """How it was drawn, and what the ids in it stand for, for the header."""
    fields = [field.spec for _, field, _ in engine.render_scene.drawn()]
    settings = picture.settings.resolved(field.sorting_mode for field in fields)
    modes = {field.rasterize_mode for field in fields}
    if settings.rasterize_mode != "auto":
        modes = {settings.rasterize_mode}
    entries = {
        "usdsplat:camera": view.camera.path or "framing the scene",
        "usdsplat:sorting": settings.sorting,
        "usdsplat:rasterizeMode": " and ".join(sorted(modes)),
        "usdsplat:colorMode": settings.color_mode,
    }
    if "id" in picture.aovs:
        entries["usdsplat:ids"] = json.dumps(engine.drawn_paths())
    return entries
