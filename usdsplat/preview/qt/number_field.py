"""Number field with arrow keys, wheel and unit."""

from __future__ import annotations

import math
from itertools import count

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QFocusEvent, QKeyEvent, QWheelEvent
from PySide6.QtWidgets import QDialog, QLineEdit, QWidget

from usdsplat.preview.qt import style

_runs = count()


class NumberField(QLineEdit):
    """A number field that signals entered values; the receiver checks limits.

    Args:
        label: Label of the value, for error messages.
        is_whole: Whether it is an integer.
        unit: Unit, shown while nothing is typed.
        step: Step of an arrow key; with Shift ten times that, with Ctrl a tenth.
        none_label: Meaning of an empty field; "" if a number is required.
        negative_label: Shown for negative numbers, and typed for -1; "" if they are shown.
        zero_label: Shown in place of 0 while nothing is typed; "" for the number.
    """

    entered = Signal(object)
    """int, float, or None for an empty field."""
    refused = Signal(str)
    """Error message if the text is not a number."""

    def __init__(
        self,
        label: str = "",
        *,
        is_whole: bool = False,
        unit: str = "",
        step: float = 1.0,
        none_label: str = "",
        negative_label: str = "",
        zero_label: str = "",
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parent)
        self._label = label
        self._is_whole = is_whole
        self._unit = unit
        self._step = step
        self._none_label = none_label
        self._negative_label = negative_label
        self._zero_label = zero_label
        self._value: float | None = None
        self.nudges = ""
        """Key shared by steps in a row of arrow keys or the wheel; "" after a typed number."""
        self.setFont(style.digits())
        self.setAlignment(Qt.AlignmentFlag.AlignRight)
        self.setPlaceholderText(none_label)
        self.editingFinished.connect(self.commit)

    @property
    def value(self) -> float | None:
        """The displayed value."""
        return self._value

    def show_value(self, value: float | None) -> None:
        """Show a number, unless another one is being typed."""
        is_other = value != self._value
        self._value = value
        if not (self.hasFocus() and self.isModified()) and (is_other or not self.text()):
            self._write()

    def commit(self) -> None:
        """Take what was typed, if anything was, as Return does."""
        if not self.isModified():
            return
        self.setModified(False)
        text = self.text().strip()
        try:
            value = None if not text and self._none_label else self._parsed(text)
        except ValueError:
            self._write()
            expected = "a whole number" if self._is_whole else "a number"
            self.refused.emit(f"{self._label}: found {text!r}, expected {expected}")
            return
        self.nudges = ""
        if value != self._value:
            self.entered.emit(value)
        self._write()

    # --- Qt's -------------------------------------------------------------------------------

    def focusInEvent(self, event: QFocusEvent) -> None:
        super().focusInEvent(event)
        self._write()
        self.selectAll()

    def focusOutEvent(self, event: QFocusEvent) -> None:
        super().focusOutEvent(event)
        self.nudges = ""
        self._write()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Up, Qt.Key.Key_Down):
            self._nudge(1 if event.key() == Qt.Key.Key_Up else -1, event.modifiers())
        elif event.key() == Qt.Key.Key_Escape:
            self._write()
            self.clearFocus()
            if isinstance(self.window(), QDialog):
                event.ignore()  # the dialog closes
        else:
            super().keyPressEvent(event)

    def wheelEvent(self, event: QWheelEvent) -> None:
        if not self.hasFocus():
            event.ignore()  # the panel scrolls
        elif event.angleDelta().y():
            self._nudge(1 if event.angleDelta().y() > 0 else -1, event.modifiers())

    # --- private ----------------------------------------------------------------------------

    def _write(self) -> None:
        text = "" if self._value is None else number_text(self._value)
        if self._zero_label and self._value == 0 and not self.hasFocus():
            self.setText(self._zero_label)
            return
        if self._is_automatic:
            text = self._negative_label
        elif text and self._unit and not self.hasFocus():
            longer = f"{text} {self._unit}"
            if self.fontMetrics().horizontalAdvance(longer) < self.width() - 14:
                text = longer
        self.setText(text)
        self.setCursorPosition(0)

    @property
    def _is_automatic(self) -> bool:
        return bool(self._negative_label) and self._value is not None and self._value < 0

    def _parsed(self, text: str) -> float:
        if self._negative_label and text.lower() in ("", self._negative_label):
            return -1 if self._is_whole else -1.0
        if self._is_whole:
            return int(text)
        value = float(text)
        if math.isnan(value):
            raise ValueError
        return value

    def _nudge(self, sign: int, modifiers: Qt.KeyboardModifier) -> None:
        if self._value is None or self.isReadOnly():
            return
        step = self._step
        if modifiers & Qt.KeyboardModifier.ShiftModifier:
            step *= 10
        elif modifiers & Qt.KeyboardModifier.ControlModifier and not self._is_whole:
            step /= 10
        value = (0.0 if self._is_automatic else self._value) + sign * step
        self.nudges = self.nudges or f"nudges {next(_runs)}"
        self.entered.emit(round(value) if self._is_whole else float(f"{value:.9g}"))
        self.selectAll()


def number_text(value: float) -> str:
    """Format a number for a panel."""
    return str(value) if isinstance(value, int) else f"{value:.6g}"
