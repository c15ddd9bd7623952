"""Dialogs for saving; the session writes the files."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, Qt, Signal
from PySide6.QtWidgets import (
    QDialog,
    QDialogButtonBox,
    QFileDialog,
    QFormLayout,
    QLineEdit,
    QMessageBox,
    QProgressDialog,
    QWidget,
)

from usdsplat.core.errors import UsdSplatError
from usdsplat.preview import saving
from usdsplat.preview.document import Document
from usdsplat.preview.qt.number_field import NumberField
from usdsplat.preview.qt.panel_context import PanelContext
from usdsplat.preview.stage_model import saving as stage_saving
from usdsplat.products.cancel import CancelToken

USD = "USD layers (*.usda *.usd *.usdc)"
BAKES = "USD layers (*.usda)"
PICTURES = "Pictures (*.png *.jpg *.exr)"


def ask_name(
    parent: QWidget, title: str, filters: str, suggested: str, done: Callable[[Path], None]
) -> QFileDialog:
    """Show a non-blocking dialog for a file to write."""
    dialog = QFileDialog(parent, title)
    dialog.setAcceptMode(QFileDialog.AcceptMode.AcceptSave)
    dialog.setNameFilter(filters)
    dialog.setDefaultSuffix(Path(suggested).suffix.lstrip("."))
    dialog.selectFile(suggested)
    dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
    dialog.fileSelected.connect(lambda name: done(Path(name)))
    dialog.open()
    return dialog


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

    def session_layer(self, then: Callable[[], None] = lambda: None) -> None:
        """Ask for a file and save the session layer, which can be stacked over the stage."""
        write = partial(self.write_session, then=then)
        ask_name(self._window, "Save session layer as", USD, "session.usda", write)

    def write_session(self, path: Path, *, then: Callable[[], None] = lambda: None) -> None:
        """Write the session layer, then call `then`."""

        def task(document: Document) -> None:
            stage_saving.save_session(document.stage, path)
            document.edits.note_saved()

        def done(_: object) -> None:
            self._said(f"Wrote {path.name}")
            self._context.has_unsaved = False
            self._context.refresh_history()
            then()

        self._context.proxy.ask(task, done)

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
        """Ask for a file and save a full-quality picture of the viewport."""
        ask_name(self._window, "Screenshot", PICTURES, "screenshot.png", self.write_screenshot)

    def write_screenshot(self, path: Path) -> None:
        """Write a full-quality picture of the viewport."""
        state = self._context.viewer.state
        self._write(path, lambda document: saving.save_view(document, state, path))

    def flipbook(self) -> None:
        """Ask for a name and frames, and save a picture of each frame."""
        dialog = FlipbookDialog(self._context, self._window)
        dialog.chosen.connect(self.write_flipbook)
        dialog.open()

    def write_flipbook(self, path: Path, frames: tuple[float, ...]) -> None:
        """Write frames, with a progress bar that can be cancelled."""
        progress = _Progress(path.name, len(frames), self._window)
        self._context.destroyed.connect(progress.deleteLater)  # the stage was closed
        reporter = _Reporter(partial(self._context.proxy.call, progress.setValue))
        state = self._context.viewer.state

        def failed(error: UsdSplatError) -> None:
            progress.deleteLater()
            self._context.complain(str(error))

        book = saving.Flipbook(state, frames, path, progress=reporter, cancel=progress.token)

        def done(has_more: bool) -> None:
            if has_more:
                ask()
                return
            progress.deleteLater()
            if book.files:
                self._said(f"Wrote {book.files[0].name}{_more(book.files)}")

        def ask() -> None:
            # One frame per task, so that others can run.
            self._context.proxy.ask(book.turn, done, failed)

        ask()

    def _write(self, path: Path, task: Callable[[Document], Any]) -> None:
        self._context.proxy.ask(task, lambda result: self._said(f"Wrote {path.name}"))


class FlipbookDialog(QDialog):
    """Dialog for frames and name of a flipbook."""

    chosen = Signal(object, object)

    def __init__(self, context: PanelContext, parent: QWidget) -> None:
        super().__init__(parent)
        self.setWindowTitle("Flipbook")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        timeline = context.viewer.timeline
        self._complain = context.complain
        self.first, self.last, self.step = (
            NumberField(name) for name in ("First frame", "Last frame", "Step")
        )
        for field, value in (
            (self.first, timeline.start),
            (self.last, timeline.end),
            (self.step, timeline.step),
        ):
            field.show_value(value)
            field.entered.connect(field.show_value)
            field.refused.connect(context.complain)
        self.name = QLineEdit("flipbook.####.png")
        self.name.setMinimumWidth(320)
        self.name.setToolTip("#### is the frame; .png, .jpg or .exr, or a movie: .mp4 or .mov")
        browse = self.name.addAction(
            self.style().standardIcon(self.style().StandardPixmap.SP_DirOpenIcon),
            QLineEdit.ActionPosition.TrailingPosition,
        )
        browse.triggered.connect(self._browse)
        self.buttons = QDialogButtonBox(
            QDialogButtonBox.StandardButton.Save | QDialogButtonBox.StandardButton.Cancel
        )
        self.buttons.accepted.connect(self._accept)
        self.buttons.rejected.connect(self.reject)
        form = QFormLayout(self)
        form.setContentsMargins(16, 16, 16, 12)
        for label, widget in (
            ("First frame", self.first),
            ("Last frame", self.last),
            ("Step", self.step),
            ("File", self.name),
        ):
            form.addRow(label, widget)
        form.addRow(self.buttons)

    def frames(self) -> tuple[float, ...]:
        """Return the chosen time codes."""
        first, last, step = (field.value or 0.0 for field in (self.first, self.last, self.step))
        if step <= 0 or last < first:
            return ()
        return tuple(first + number * step for number in range(int((last - first) / step) + 1))

    def _browse(self) -> None:
        filters = f"{PICTURES};;Movies (*.mp4 *.mov)"
        dialog = ask_name(
            self, "Flipbook", filters, self.name.text(), lambda to: self.name.setText(str(to))
        )
        # Asked in `_accept`, when all is known.
        dialog.setOption(QFileDialog.Option.DontConfirmOverwrite)

    def _accept(self) -> None:
        """Accept; ask once before overwriting existing frames."""
        try:
            files = saving.targets(Path(self.name.text()), self.frames())
        except UsdSplatError as error:
            self._complain(str(error))
            return
        there = [path for path in files if path.exists()]
        if not there:
            self._choose()
            return
        words = f"{there[0].name}{_more(tuple(there))} exist{'' if len(there) > 1 else 's'}."
        box = QMessageBox(QMessageBox.Icon.Question, "Flipbook", words, parent=self)
        box.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        replace = box.addButton("Replace", QMessageBox.ButtonRole.DestructiveRole)
        replace.clicked.connect(self._choose)
        box.setDefaultButton(box.addButton(QMessageBox.StandardButton.Cancel))
        box.open()

    def _choose(self) -> None:
        self.chosen.emit(Path(self.name.text()), self.frames())
        self.accept()


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


def _more(files: tuple[Path, ...]) -> str:
    return f" and {len(files) - 1} more" if len(files) > 1 else ""
