"""Dialogs for the size, the frames and the file of pictures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QIcon
from PySide6.QtWidgets import (
    QDialog,
    QDialogButtonBox,
    QFileDialog,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QMessageBox,
    QWidget,
)

from usdsplat.core.errors import UsdSplatError
from usdsplat.preview import saving
from usdsplat.preview.qt.knob_widgets import TickBox
from usdsplat.preview.qt.number_field import NumberField
from usdsplat.preview.qt.panel_context import PanelContext

PICTURES = "Pictures (*.png *.jpg *.exr)"
STILL = "Nothing is simulated yet: run or record it first."
"""Hint for a stage whose simulation has no frames: pictures would show the capture as it is."""
LARGEST = 16384
"""Largest width and height [pixel]."""


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


class SizeFields(QWidget):
    """Width and height of pictures, that of the viewport at first.

    Args:
        size: Width and height of the viewport [pixel].
        complain: Receives an error message.
    """

    def __init__(self, size: tuple[int, int], *, complain: Callable[[str], None]) -> None:
        super().__init__()
        self._shape, self._complain = size, complain
        self.width_field, self.height_field = (
            NumberField(name, is_whole=True) for name in ("Width", "Height")
        )
        self.keeps_shape = TickBox("Shape of the viewport")
        self.keeps_shape.setChecked(True)
        self.keeps_shape.toggled.connect(lambda is_on: self._set(0, self.chosen[0]))
        line = QHBoxLayout(self)
        line.setContentsMargins(0, 0, 0, 0)
        for place, field in enumerate((self.width_field, self.height_field)):
            field.setFixedWidth(72)
            field.show_value(size[place])
            field.entered.connect(lambda value, place=place: self._set(place, value))
            field.refused.connect(complain)
            line.addWidget(field)
            if not place:
                line.addWidget(QLabel("×"))
        line.addWidget(self.keeps_shape)
        line.addStretch(1)

    @property
    def chosen(self) -> tuple[int, int]:
        """Width and height [pixel]."""
        return int(self.width_field.value or 1), int(self.height_field.value or 1)

    def _set(self, place: int, value: float) -> None:
        """Set one side, and with the shape the other one."""
        sides = list(self.chosen)
        sides[place] = int(value)
        if self.keeps_shape.isChecked():
            ratio = self._shape[1 - place] / self._shape[place]
            sides[1 - place] = max(1, round(sides[place] * ratio))
        if not all(1 <= each <= LARGEST for each in sides):
            self._complain(f"size: found {sides[0]} x {sides[1]}, expected 1 to {LARGEST} each")
            return
        self.width_field.show_value(sides[0])
        self.height_field.show_value(sides[1])


class ScreenshotDialog(QDialog):
    """Dialog for the size of a screenshot; a dialog for the file follows."""

    chosen = Signal(object)
    """Width and height [pixel]."""

    def __init__(self, context: PanelContext, parent: QWidget) -> None:
        super().__init__(parent)
        self.setWindowTitle("Screenshot")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.size_fields = SizeFields(context.viewer.state.size, complain=context.complain)
        self.buttons = _buttons()
        self.buttons.accepted.connect(self._choose)
        self.buttons.rejected.connect(self.reject)
        form = QFormLayout(self)
        form.setContentsMargins(16, 16, 16, 12)
        form.addRow("Size", self.size_fields)
        form.addRow(self.buttons)

    def _choose(self) -> None:
        self.chosen.emit(self.size_fields.chosen)
        self.accept()


class FlipbookDialog(QDialog):
    """Dialog for frames and name of a flipbook."""

    chosen = Signal(object, object, object)
    """Path, time codes, and width and height [pixel]."""

    def __init__(self, context: PanelContext, parent: QWidget) -> None:
        super().__init__(parent)
        self.setWindowTitle("Flipbook")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        timeline, simulated = context.viewer.timeline, context.simulation.frames
        first, last = simulated or (timeline.start, timeline.end)
        is_still = context.viewer.has_simulation and not (simulated or context.baked)
        self.hint = QLabel(STILL)
        self.hint.setProperty("role", "animated")
        self.hint.setVisible(is_still)
        self._context = context
        self._complaint = ""
        """Error message in the dialog; "" if there is none."""
        self.first, self.last, self.step = (
            NumberField(name) for name in ("First frame", "Last frame", "Step")
        )
        for field, value in (
            (self.first, first),
            (self.last, last),
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
        self.size_fields = SizeFields(context.viewer.state.size, complain=context.complain)
        self.buttons = _buttons()
        self.buttons.accepted.connect(self._accept)
        self.buttons.rejected.connect(self.reject)
        form = QFormLayout(self)
        form.setContentsMargins(16, 16, 16, 12)
        for label, widget in (
            ("First frame", self.first),
            ("Last frame", self.last),
            ("Step", self.step),
            ("Size", self.size_fields),
            ("File", self.name),
        ):
            form.addRow(label, widget)
        if is_still:
            form.addRow(self.hint)
        form.addRow(self.buttons)

    def frames(self) -> tuple[float, ...]:
        """Return the chosen time codes, of too many only as many as `check_flipbook` refuses."""
        first, last, step = (field.value or 0.0 for field in (self.first, self.last, self.step))
        if step <= 0 or last < first:
            return ()
        # In this order, what is not a number, as for inf to inf, is too many as well.
        steps = int(min(saving.MOST_FRAMES, (last - first) / step))
        return tuple(first + number * step for number in range(steps + 1))

    def _browse(self) -> None:
        filters = f"{PICTURES};;Movies (*.mp4 *.mov)"
        dialog = ask_name(
            self, "Flipbook", filters, self.name.text(), lambda to: self.name.setText(str(to))
        )
        # Asked in `_accept`, when all is known.
        dialog.setOption(QFileDialog.Option.DontConfirmOverwrite)

    def _accept(self) -> None:
        """Accept, if everything can be written; ask once before overwriting existing frames."""
        path, frames = Path(self.name.text()), self.frames()
        self._context.settled.emit(self._complaint)
        try:
            saving.check_flipbook(path, frames)
        except UsdSplatError as error:
            self._complaint = str(error)
            self._context.complain(self._complaint)
            return
        there = [each for each in saving.targets(path, frames) if each.exists()]
        if not there:
            self._choose()
            return
        words = f"{there[0].name}{and_more(tuple(there))} exist{'' if len(there) > 1 else 's'}."
        box = QMessageBox(QMessageBox.Icon.Question, "Flipbook", words, parent=self)
        box.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        replace = box.addButton("Replace", QMessageBox.ButtonRole.DestructiveRole)
        replace.clicked.connect(self._choose)
        box.setDefaultButton(box.addButton(QMessageBox.StandardButton.Cancel))
        box.open()

    def _choose(self) -> None:
        self.chosen.emit(Path(self.name.text()), self.frames(), self.size_fields.chosen)
        self.accept()


def _buttons() -> QDialogButtonBox:
    """Return buttons to save or cancel, without the coloured icons of the style."""
    kinds = QDialogButtonBox.StandardButton
    box = QDialogButtonBox(kinds.Save | kinds.Cancel)
    for button in box.buttons():
        button.setIcon(QIcon())
    return box


def and_more(files: tuple[Path, ...]) -> str:
    """Return " and 3 more" for four files; "" for one."""
    return f" and {len(files) - 1} more" if len(files) > 1 else ""
