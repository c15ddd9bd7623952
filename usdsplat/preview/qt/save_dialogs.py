"""Dialogs for saving; the session writes the files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, Qt
from PySide6.QtWidgets import (
    QProgressDialog,
    QWidget,
)

from usdsplat.core.cancel import CancelToken
from usdsplat.core.errors import UsdSplatError
from usdsplat.preview import exporting, saving
from usdsplat.preview.document import Document
from usdsplat.preview.qt.panel_context import PanelContext
from usdsplat.preview.qt.picture_dialogs import (
    PICTURES,
    FlipbookDialog,
    ScreenshotDialog,
    and_more,
    ask_name,
)
from usdsplat.preview.stage_model import saving as stage_saving
from usdsplat.preview.values import ViewState

USD = "USD layers (*.usda *.usd *.usdc)"
NO_EDITS = "There are no edits to save; nothing is written"
BAKES = "USD layers (*.usda)"


class Saving(QObject):
    """The save actions of a window.

    Args:
        context: Context of the session.
        said: Receives a message when a file is written.
        window: Parent of the dialogs.
    """

    def __init__(
        self, context: PanelContext, *, said: Callable[[str], None], window: QWidget
    ) -> None:
        super().__init__(context)
        self._context = context
        self._said = said
        self._window = window
        self._complaint = ""
        """Sentence of the last problem."""

    def session_layer(self, then: Callable[[], None] = lambda: None) -> None:
        """Ask for a file and save the session layer, which can be stacked over the stage.

        Without edits there is nothing to ask.
        """
        write = partial(self.write_session, then=then)

        def found(has_edits: bool) -> None:
            if has_edits:
                ask_name(self._window, "Save session layer as", USD, "session.usda", write)
            else:
                self._note_saved(NO_EDITS, then)

        self._ask(_has_edits, found)

    def write_session(self, path: Path, *, then: Callable[[], None] = lambda: None) -> None:
        """Write the session layer, then call `then`; without edits nothing is written."""

        def task(document: Document) -> bool:
            if not _has_edits(document):
                return False
            stage_saving.save_session(document.stage, path)
            document.edits.note_saved()
            return True

        def done(is_written: bool) -> None:
            self._note_saved(f"Wrote {path.name}" if is_written else NO_EDITS, then)

        self._ask(task, done)

    def camera_layer(self) -> None:
        """Ask for a file and save the view as a camera in a layer."""
        ask_name(self._window, "Save view as a camera", USD, "camera.usda", self.write_camera)

    def write_camera(self, path: Path) -> None:
        """Write the view as a camera."""
        picture = self._context.picture
        if picture is not None:
            camera = picture.camera
            self._write(
                path,
                lambda document: stage_saving.save_camera_layer(document.stage, camera, path),
            )

    def screenshot(self) -> None:
        """Ask for a size and a file, and save a full-quality picture of the viewport."""

        def chosen(size: tuple[int, int]) -> None:
            write = partial(self.write_screenshot, size=size)
            ask_name(self._window, "Screenshot", PICTURES, "screenshot.png", write)

        dialog = ScreenshotDialog(self._context, self._window)
        dialog.chosen.connect(chosen)
        dialog.open()

    def write_screenshot(self, path: Path, *, size: tuple[int, int] | None = None) -> None:
        """Write a full-quality picture of the viewport, of a size [pixel] or its own."""
        state = self._state(size)
        self._write(path, lambda document: saving.save_view(document, state, path))

    def flipbook(self) -> None:
        """Ask for a name and frames, and save a picture of each frame."""
        dialog = FlipbookDialog(self._context, self._window)
        dialog.chosen.connect(self.write_flipbook)
        dialog.open()

    def export(self) -> None:
        """Ask for a file of any format, and write the visible splats."""
        patterns = " ".join(
            suffix[1:] if suffix.startswith("/") else f"*{suffix}"
            for suffix in exporting.suffixes()
        )
        ask_name(
            self._window,
            "Export visible splats",
            f"Splats ({patterns})",
            "seen.ply",
            self.write_export,
        )

    def write_export(self, path: Path) -> None:
        """Write the splats that are visible at the current time."""
        state = self._state(None)
        self._said(f"Writing {path.name}…")
        self._ask(lambda document: exporting.export_seen(document, state, path), self._said)

    def write_flipbook(
        self, path: Path, frames: tuple[float, ...], size: tuple[int, int] | None = None
    ) -> None:
        """Write frames, with a progress bar that can be cancelled."""
        progress = _Progress(path.name, len(frames), self._window)
        self._context.destroyed.connect(progress.deleteLater)  # the stage was closed
        reporter = _Reporter(partial(self._context.proxy.call, progress.setValue))
        state = self._state(size)

        def failed(error: UsdSplatError) -> None:
            progress.deleteLater()
            self._complain(error)

        book = saving.Flipbook(state, frames, path, progress=reporter, cancel=progress.token)

        def done(has_more: bool) -> None:
            if has_more:
                ask()
                return
            progress.deleteLater()
            self._settle()
            written, wanted = len(book.files), len(saving.targets(path, frames))
            if written == wanted:
                self._said(f"Wrote {book.files[0].name}{and_more(book.files)}")
            elif wanted > 1:
                self._said(f"Stopped: {written} of {wanted} frames written")
            else:
                self._said(f"Stopped: {path.name} is not written")

        def ask() -> None:
            # One frame per task, so that others can run.
            self._context.proxy.ask(book.turn, done, failed)

        ask()

    def _state(self, size: tuple[int, int] | None) -> ViewState:
        """Return the state of pictures of a size [pixel], or the viewport's.

        They have the camera of the last picture: one that frames everything would frame the scene
        again for another shape.
        """
        viewer = self._context.viewer
        camera = viewer.state.camera or viewer.free_camera()
        return replace(viewer.state, size=size or viewer.state.size, camera=camera)

    def _note_saved(self, words: str, then: Callable[[], None]) -> None:
        """Say that all edits are in a file, and call `then`."""
        self._said(words)
        self._context.has_unsaved = False
        self._context.refresh_history()
        then()

    def _write(self, path: Path, task: Callable[[Document], Any]) -> None:
        self._ask(task, lambda result: self._said(f"Wrote {path.name}"))

    def _ask(self, task: Callable[[Document], Any], done: Callable[[Any], object]) -> None:
        """Have something written; a success takes back the problem of the last try."""

        def succeeded(result: Any) -> None:
            self._settle()
            done(result)

        self._context.proxy.ask(task, succeeded, self._complain)

    def _complain(self, error: UsdSplatError) -> None:
        self._said("")
        self._complaint = str(error)
        self._context.complain(self._complaint)

    def _settle(self) -> None:
        """Take back the last problem; it is over."""
        if self._complaint:
            self._context.settled.emit(self._complaint)
            self._complaint = ""


def _has_edits(document: Document) -> bool:
    """Return whether a session layer is worth a file: it says something, or no longer says what
    its file says."""
    return document.edits.has_unsaved or not stage_saving.is_without_edits(document.stage)


class _Progress(QProgressDialog):
    """Progress of written frames with a button to stop."""

    def __init__(self, name: str, total: int, parent: QWidget) -> None:
        super().__init__(f"Writing {name}", "Stop", 0, total, parent)
        self.token = CancelToken()
        self.setWindowModality(Qt.WindowModality.NonModal)
        self.setMinimumDuration(400)
        self.setAutoClose(False)
        self.setAutoReset(False)
        self.canceled.connect(self.token.cancel)
        self.destroyed.connect(self.token.cancel)


class _Reporter:
    """A progress receiver that forwards to the window."""

    def __init__(self, tell: Callable[[int], None]) -> None:
        self._tell = tell

    def step(self, label: str, done: int, total: int) -> None:
        self._tell(done)
