"""What a viewport shows, into files: one picture, or one for each frame, or a movie.

All is drawn in full at the viewport's size. PNG, JPEG and movies hold what the screen shows, with
exposure, channel, wipe and background; EXR holds what a compositor wants, linear and with alpha.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from usdsplat.core.errors import UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.images import cryptomatte, open_writer
from usdsplat.images.aovs import find_aovs
from usdsplat.images.camera import camera_metadata
from usdsplat.images.frames import frame_paths
from usdsplat.images.labels import picture_metadata
from usdsplat.images.layout import ImageLayout, Metadata
from usdsplat.interchange.files import check_not_input, layer_files
from usdsplat.preview.document import Document
from usdsplat.preview.drawing import Shown, Side
from usdsplat.preview.sources import files_of_capture
from usdsplat.preview.values import ViewState
from usdsplat.products import movie
from usdsplat.products.display_image import FORMATS, check_suffix, save_image
from usdsplat.render.framing import conform

DISPLAY = "srgb_rec709_display"


def save_view(document: Document, state: ViewState, path: Path | str) -> Path:
    """Draw what a viewport shows in full, and write it; a task for a session.

    Args:
        document: Drawn with.
        state: What is seen; of a comparison an EXR gets the left side.
        path: Of a PNG or JPEG, or an EXR of the AOV that is looked at, colour besides.

    Raises:
        UnknownFormatError: If the suffix is another.
        OutputError: If the file cannot be written, or is one that the stage reads.
        UsdSplatError: If the state cannot be drawn.
    """
    path = Path(path)
    check_suffix(path, (*FORMATS, ".exr"))
    _check_not_read(document, (path,))
    _save(document, document.still(state), path)
    return path


def flipbook(
    document: Document,
    state: ViewState,
    frames: Sequence[float],
    path: Path | str,
    *,
    progress: Progress = silent,
    cancelled: Callable[[], bool] = lambda: False,
) -> tuple[Path, ...]:
    """Draw every frame in full, and write a picture of each, or one movie.

    As a task for a session it takes as long as all frames: `Flipbook` lets others have turns.

    Args:
        document: Drawn with. Its listeners are not shown the frames.
        state: What is seen, but for the time.
        frames: Time codes, in their order.
        path: With a place for the frame, such as a.####.png, .jpg or .exr, or a movie, .mp4 or
            .mov, which plays at the stage's rate.
        progress: Told how many frames are done.
        cancelled: Asked between frames; what is finished stays, but of a movie nothing does.

    Returns:
        The files that were written.

    Raises:
        UnknownFormatError: If the suffix is another.
        UsageError: If there are no frames, or the name has no place for them.
        OutputError: If a file cannot be written, or a movie is asked for where there is no ffmpeg.
        UsdSplatError: If a frame cannot be drawn.
    """
    book = Flipbook(state, frames, path, progress=progress, cancelled=cancelled)
    while book.turn(document):
        pass
    return book.files


def targets(path: Path, frames: Sequence[float]) -> tuple[Path, ...]:
    """The files that a flipbook writes.

    Raises:
        UsageError: If the name has no place for the frames.
    """
    return (path,) if path.suffix.lower() in movie.SUFFIXES else frame_paths(path, frames)


class Flipbook:
    """A `flipbook` frame by frame: each turn is a task for a session, and others come between.

    What is not finished when the last reference to it goes leaves no movie.

    Args:
        state, frames, path, progress, cancelled: As `flipbook` takes them.
    """

    def __init__(
        self,
        state: ViewState,
        frames: Sequence[float],
        path: Path | str,
        *,
        progress: Progress = silent,
        cancelled: Callable[[], bool] = lambda: False,
    ) -> None:
        self.files: tuple[Path, ...] = ()
        """That were written."""
        self._state, self._frames, self._path = state, frames, Path(path)
        self._progress, self._cancelled = progress, cancelled
        self._turns: Iterator[None] | None = None

    def turn(self, document: Document) -> bool:
        """Draw and write the next frame; whether there is more to do. Raises what `flipbook` does.

        Args:
            document: The same one each time.
        """
        if self._turns is None:
            self._turns = self._begun(document)
        return next(self._turns, self) is not self

    def _begun(self, document: Document) -> Iterator[None]:
        suffix = self._path.suffix.lower()
        if not self._frames:
            raise UsageError("frames", "none", "one or more")
        check_suffix(self._path, (*FORMATS, ".exr", *movie.SUFFIXES))
        files = targets(self._path, self._frames)
        _check_not_read(document, files)
        if suffix in movie.SUFFIXES:
            return self._movie(document)
        return self._pictures(document, files)

    def _pictures(self, document: Document, files: Sequence[Path]) -> Iterator[None]:
        for frame, target in zip(self._frames, files, strict=True):
            if self._cancelled():
                return
            _save(document, document.still(_at(self._state, frame)), target)
            self.files = (*self.files, target)
            self._progress.step(self._path.name, len(self.files), len(self._frames))
            yield

    def _movie(self, document: Document) -> Iterator[None]:
        class Cancelled(Exception):
            """Leaves the movie without a file."""

        rate = document.stage.GetTimeCodesPerSecond()
        with suppress(Cancelled):
            with movie.Movie(self._path, self._state.size, rate) as target:
                for i, frame in enumerate(self._frames):
                    if self._cancelled():
                        raise Cancelled
                    target.write(document.still(_at(self._state, frame)).picture.image)
                    self._progress.step(self._path.name, i + 1, len(self._frames))
                    yield
            self.files = (self._path,)


def _check_not_read(document: Document, files: Sequence[Path]) -> None:
    """Refuse to replace the layers of the stage, or the capture that it is of."""
    read = layer_files(document.stage)
    if document.sources is not None and document.sources.is_capture:
        read += files_of_capture(document.sources.path)
    for path in files:
        check_not_input(path, read)


def _at(state: ViewState, frame: float) -> ViewState:
    """The same at another time; what has a time of its own keeps it."""
    return replace(state, time=frame)


def _save(document: Document, shown: Shown, path: Path) -> None:
    """Write a picture, as the suffix says."""
    if path.suffix.lower() == ".exr":
        _save_exr(document, shown.sides[0], path)
    else:
        save_image(shown.picture.image, path)


def _save_exr(document: Document, side: Side, path: Path) -> None:
    """One side, drawn once more as a compositor wants it."""
    look = side.look
    settings = look.settings
    if settings.color_mode == "auto":
        settings = replace(settings, color_mode="scene")
    aovs = find_aovs(tuple(dict.fromkeys(("color", look.aov))))
    pixels = side.scene.engine.picture(side.view, settings, tuple(aov.hydra for aov in aovs))
    is_display = settings.color_mode == "display"
    layout = ImageLayout(
        resolution=side.view.framing.resolution,
        aovs=tuple(aov.name for aov in aovs),
        color_space=DISPLAY if is_display else settings.working_space,
        metadata=_metadata(document, side),
    )
    with open_writer(path, layout) as writer:
        writer.write_band(
            0,
            {
                # -1, which stands for nothing among the renderer's ids, is 2**32 - 1 in the file.
                aov.name: pixels[aov.hydra].view(np.uint32)
                if aov.kind == "id"
                else pixels[aov.hydra]
                for aov in aovs
            },
        )


def _metadata(document: Document, side: Side) -> Metadata:
    """What the header says of the picture."""
    camera, scene, look = side.view.camera, side.scene, side.look
    window, _ = conform(camera.window, side.view.framing)
    name = document.path or document.stage.GetRootLayer().GetDisplayName()
    entries = {
        **camera_metadata(
            world_to_camera=camera.world_to_camera, window=window, orthographic=camera.orthographic
        ),
        **picture_metadata(
            stage=str(name),
            frame=scene.time or 0.0,
            samples=look.settings.samples,
            exposure=camera.exposure,
        ),
    }
    if look.aov == "id":
        entries["usdsplat:ids"] = json.dumps(scene.prims)
    if look.aov == "cryptoObject":
        return {**entries, **cryptomatte.metadata("cryptoObject", scene.prims)}
    return entries
