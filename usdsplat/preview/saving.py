"""Save what a viewport shows: one picture, one picture for each frame, or a movie.

Pictures are drawn in full quality at the viewport's size. PNG, JPEG and movies contain the
displayed image, with exposure, channel, wipe and background. An EXR contains what `usdsplat render`
writes for the same view.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path

from usdsplat.core.cancel import Cancelled, CancelToken
from usdsplat.core.errors import UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.images import ColorMode
from usdsplat.images.frame_numbers import frame_paths
from usdsplat.images.layout import Metadata
from usdsplat.interchange.files import check_not_input, layer_files
from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.document import Document
from usdsplat.preview.sides import Shown, Side
from usdsplat.preview.sources import files_of_capture
from usdsplat.preview.values import DisplaySettings, ViewState
from usdsplat.products import movie
from usdsplat.products.display_image import FORMATS, check_suffix, save_image
from usdsplat.products.drawing import write_picture
from usdsplat.products.header import Origin, labelled_layout, picture_header
from usdsplat.products.picture_file import PictureFile
from usdsplat.products.request import PicturePlan

MOST_FRAMES = 100_000
"""Maximum number of frames of a flipbook, more than an hour; more are assumed to be a mistake."""


def save_view(document: Document, state: ViewState, path: Path | str) -> Path:
    """Draw the state of a viewport in full quality, and write it; a task for a session.

    Args:
        document: Document that draws.
        state: State of the viewport; of a comparison, an EXR contains the left side.
        path: A PNG or JPEG, or an EXR, which contains the displayed AOV and colour.

    Raises:
        UnknownFormatError: If the suffix is another one.
        OutputError: If the file cannot be written, or is read by the stage.
        UsdSplatError: If the state cannot be drawn.
    """
    path = Path(path)
    check_suffix(path, (*FORMATS, ".exr"))
    check_not_read(document, (path,))
    _save(document, state, path, cancel=CancelToken())
    return path


def targets(path: Path, frames: Sequence[float]) -> tuple[Path, ...]:
    """Return the files that a flipbook writes.

    Raises:
        UsageError: If the name has no placeholder for the frame.
    """
    return (path,) if _is_movie(path) else frame_paths(path, frames)


def check_flipbook(path: Path, frames: Sequence[float]) -> None:
    """Check what can be known of a flipbook before its first frame is drawn.

    Raises:
        UnknownFormatError: If the path has another suffix than those of a flipbook.
        UsageError: If there are no frames, too many, or one that is not finite; or the name has no
            placeholder for the frame.
        OutputError: If it is a movie, and there is no ffmpeg.
    """
    if not frames:
        raise UsageError("frames", "none", "one or more")
    if len(frames) > MOST_FRAMES:
        raise UsageError("frames", f"more than {MOST_FRAMES}", f"at most {MOST_FRAMES}")
    if not all(map(math.isfinite, frames)):
        raise UsageError("frames", "one that is not finite", "finite numbers")
    check_suffix(path, (*FORMATS, ".exr", *movie.SUFFIXES))
    targets(path, frames)
    if _is_movie(path):
        movie.program_for(path)


class Flipbook:
    """Writer of a picture for each frame, or of one movie, in full quality, one frame per call.

    Each turn is a task for a session, so that other tasks can run in between. A movie that is not
    finished when the last reference to the flipbook is dropped is not written.

    Args:
        state: What to draw, except for the time.
        frames: Time codes, in their order.
        path: Name with a placeholder for the frame, such as a.####.png, .jpg or .exr; or a movie,
            .mp4 or .mov, which plays at the stage's rate.
        progress: Receives the number of finished frames.
        cancel: Ends the work; finished pictures remain, but nothing of a movie.
    """

    def __init__(
        self,
        state: ViewState,
        frames: Sequence[float],
        path: Path | str,
        *,
        progress: Progress = silent,
        cancel: CancelToken | None = None,
    ) -> None:
        self.files: tuple[Path, ...] = ()
        """Written files."""
        self._state, self._frames, self._path = state, frames, Path(path)
        self._progress, self._cancel = progress, cancel or CancelToken()
        self._turns: Iterator[None] | None = None

    def turn(self, document: Document) -> bool:
        """Draw and write the next frame, and return whether there are more.

        The document's listeners do not get the frame.

        Args:
            document: The same document in each call.

        Raises:
            UnknownFormatError: If the path has another suffix.
            UsageError: If there are no frames, or the name has no placeholder for the frame.
            OutputError: If a file cannot be written, or a movie is requested without ffmpeg.
            UsdSplatError: If a frame cannot be drawn.
        """
        if self._turns is None:
            self._turns = self._begun(document)
        return next(self._turns, self) is not self

    def _begun(self, document: Document) -> Iterator[None]:
        check_flipbook(self._path, self._frames)
        files = targets(self._path, self._frames)
        check_not_read(document, files)
        if _is_movie(self._path):
            return self._movie(document)
        return self._pictures(document, files)

    def _pictures(self, document: Document, files: Sequence[Path]) -> Iterator[None]:
        with suppress(Cancelled):
            for frame, target in zip(self._frames, files, strict=True):
                self._cancel.check()
                state = _at(self._state, frame)
                _save(document, state, target, cancel=self._cancel)
                self.files = (*self.files, target)
                self._progress.step(self._path.name, len(self.files), len(self._frames))
                yield

    def _movie(self, document: Document) -> Iterator[None]:
        rate = document.stage.GetTimeCodesPerSecond()
        first = _at(self._state, self._frames[0])
        metadata = _display_header(document, first, document.still(first))
        with suppress(Cancelled):
            with movie.Movie(self._path, self._state.size, rate, metadata=metadata) as target:
                for i, frame in enumerate(self._frames):
                    self._cancel.check()
                    target.write(document.still(_at(self._state, frame)).picture.image)
                    self._progress.step(self._path.name, i + 1, len(self._frames))
                    yield
            self.files = (self._path,)


def check_not_read(document: Document, files: Sequence[Path]) -> None:
    """Reject targets that are layers of the stage, or the capture itself."""
    read = layer_files(document.stage)
    if document.sources is not None and document.sources.is_capture:
        read += files_of_capture(document.sources.path)
    for path in files:
        check_not_input(path, read)


def _is_movie(path: Path) -> bool:
    return path.suffix.lower() in movie.SUFFIXES


def _at(state: ViewState, frame: float) -> ViewState:
    """Return the state at another time; a look with its own time keeps it."""
    return replace(state, time=frame)


def _save(document: Document, state: ViewState, path: Path, *, cancel: CancelToken) -> None:
    """Draw a state in full quality and write it in the format of the suffix."""
    shown = document.still(state)
    if path.suffix.lower() != ".exr":
        metadata = _display_header(document, state, shown)
        save_image(shown.picture.image, path, metadata=metadata)
        return
    side = shown.sides[0]
    engine, look = side.scene.engine, side.look
    plan = _plan(state, side, aovs=("color", look.aov), color_mode="scene")
    with document.lock:  # so that a running simulation cannot edit the stage
        layout = labelled_layout(engine, plan, side.view, origin=_origin(document, state, side))
        file = PictureFile(plan=plan, path=path, view=side.view, layout=layout)
        write_picture(engine, file, rows_written=lambda rows: cancel.check())


def _display_header(document: Document, state: ViewState, shown: Shown) -> Metadata:
    """Return the header of a picture of the displayed image; of a comparison, that of the left
    side."""
    side = shown.sides[0]
    plan = _plan(state, side, aovs=("color",), color_mode="display")
    origin = replace(_origin(document, state, side), shown=_adjustments(state))
    with document.lock:
        return picture_header(side.scene.engine, plan, side.view, origin=origin)


def _plan(
    state: ViewState, side: Side, *, aovs: tuple[str, ...], color_mode: ColorMode
) -> PicturePlan:
    """Return the plan of one side; `color_mode` replaces "auto"."""
    settings = side.look.settings
    if settings.color_mode == "auto":
        settings = replace(settings, color_mode=color_mode)
    return PicturePlan(
        camera=side.view.camera.path or None,
        framing=side.view.framing,
        settings=settings,
        aovs=tuple(dict.fromkeys(aovs)),
        purposes=state.purposes,
        is_baked=color_mode == "display" and settings.color_mode != "display",
    )


def _origin(document: Document, state: ViewState, side: Side) -> Origin:
    """Return stage, frame and camera of a side for the header."""
    layer = document.stage.GetRootLayer()
    name = document.path or layer.realPath or layer.GetDisplayName()
    if isinstance(state.camera, FreeCamera):
        return Origin(stage=str(name), frame=side.scene.time or 0.0, camera="free")
    return Origin(stage=str(name), frame=side.scene.time or 0.0)


def _adjustments(state: ViewState) -> dict[str, str | float]:
    """Return the display adjustments that differ from their defaults."""
    usual, settings = DisplaySettings(), state.display
    values = {item.name: getattr(settings, item.name) for item in fields(settings)}
    found = {
        name: value if isinstance(value, float | str) else str(value)
        for name, value in values.items()
        if value != getattr(usual, name)
    }
    if state.look.aov != "color":
        found["aov"] = state.look.aov
    if state.other is not None:
        found["wipe"] = state.wipe
    return found
