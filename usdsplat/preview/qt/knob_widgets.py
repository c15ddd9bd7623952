"""Widgets for the kinds of `Editor`."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import count
from typing import Any

from PySide6.QtCore import QRect, QSignalBlocker, Qt, Signal
from PySide6.QtGui import QColor, QIcon, QPainter, QPaintEvent, QWheelEvent
from PySide6.QtWidgets import (
    QCheckBox,
    QColorDialog,
    QComboBox,
    QHBoxLayout,
    QLineEdit,
    QPushButton,
    QSlider,
    QStyle,
    QStyleOptionButton,
    QWidget,
)

from usdsplat.preview.knob_model import Editor
from usdsplat.preview.qt.glyphs import glyph
from usdsplat.preview.qt.number_field import NumberField

FIELD = 88
"""Width of a number beside its slider [pixel]."""
NOTCHES = 1000
"""Number of positions of a slider."""
LOGARITHMIC = 1000.0
"""Ratio of a range from which its slider is logarithmic."""

_drags = count()


class ValueWidget(QWidget):
    """A widget for one editable value."""

    changed = Signal(object, str)
    """New value, and a key shared by all changes of one drag, "" for a single change."""
    refused = Signal(str)

    def __init__(self, editor: Editor) -> None:
        super().__init__()
        self.row = QHBoxLayout(self)
        self.row.setContentsMargins(0, 0, 0, 0)
        self.row.setSpacing(6)

    def show_editor(self, editor: Editor) -> None:
        """Show the current value."""
        raise NotImplementedError


def make_widget(editor: Editor) -> ValueWidget:
    """Create the widget of an editor, showing its value."""
    widget = _WIDGETS[editor.kind](editor)
    widget.show_editor(editor)
    widget.setEnabled(not editor.is_read_only)
    return widget


class CheckWidget(ValueWidget):
    """A check box."""

    def __init__(self, editor: Editor) -> None:
        super().__init__(editor)
        self._box = TickBox()
        self._box.clicked.connect(lambda value: self.changed.emit(value, ""))
        self.row.addWidget(self._box)
        self.row.addStretch(1)

    def show_editor(self, editor: Editor) -> None:
        self._box.setChecked(bool(editor.value))


class NumberWidget(ValueWidget):
    """A slider over the usual range, and a field for any number."""

    def __init__(self, editor: Editor) -> None:
        super().__init__(editor)
        self._editor = editor
        self._drag = ""
        self._slider = _CalmSlider(Qt.Orientation.Horizontal)
        self._slider.setFocusPolicy(Qt.FocusPolicy.ClickFocus)
        self._slider.setMinimumWidth(40)
        self._slider.sliderPressed.connect(self._begin_drag)
        self._slider.sliderReleased.connect(self._end_drag)
        self._slider.valueChanged.connect(self._slid)
        self._field = NumberField(
            editor.label,
            is_whole=editor.kind == "int",
            unit=editor.unit,
            step=editor.step,
            none_label=editor.none_label,
            negative_label=editor.negative_label,
            zero_label=editor.zero_label,
        )
        self._field.setFixedWidth(FIELD)
        self._field.entered.connect(lambda value: self.changed.emit(value, ""))
        self._field.refused.connect(self.refused)
        self.row.addWidget(self._slider, 1)
        self.row.addWidget(self._field)

    def show_editor(self, editor: Editor) -> None:
        self._field.show_value(editor.value)
        if self._slider.isSliderDown():
            return  # the range may depend on the value; it must not change during a drag
        self._editor = editor
        with QSignalBlocker(self._slider):
            self._slider.setMaximum(self._notches())
            if editor.value is not None:
                self._slider.setValue(self._notch(editor.value))

    def _begin_drag(self) -> None:
        self._drag = f"drag {next(_drags)}"

    def _end_drag(self) -> None:
        self._drag = ""

    def _slid(self, notch: int) -> None:
        value = self._value_at(notch)
        if value != self._field.value:
            self._field.show_value(value)
            self.changed.emit(value, self._drag)

    def _notches(self) -> int:
        low, high = self._editor.soft_range
        if self._editor.kind == "int" and high - low <= NOTCHES:
            return max(round(high - low), 1)
        return NOTCHES

    def _is_logarithmic(self) -> bool:
        low, high = self._editor.soft_range
        return low > 0 and high / low >= LOGARITHMIC

    def _notch(self, value: float) -> int:
        low, high = self._editor.soft_range
        value = min(max(value, low), high)
        if self._is_logarithmic():
            part = math.log(value / low) / math.log(high / low)
        else:
            part = (value - low) / (high - low or 1.0)
        return round(part * self._notches())

    def _value_at(self, notch: int) -> float:
        low, high = self._editor.soft_range
        part = notch / self._notches()
        if self._is_logarithmic():
            value = float(f"{low * (high / low) ** part:.3g}")
        else:
            step = (high - low) / self._notches()
            digits = max(0, 1 - math.floor(math.log10(step))) if step > 0 else 0
            value = round(low + part * (high - low), digits)
        return round(value) if self._editor.kind == "int" else value


class ChoiceWidget(ValueWidget):
    """A combo box of choices."""

    def __init__(self, editor: Editor) -> None:
        super().__init__(editor)
        self._choices: list[str | None] = [*([None] if editor.none_label else []), *editor.choices]
        self._box = CalmComboBox()
        self._box.addItems([editor.none_label if c is None else str(c) for c in self._choices])
        self._box.activated.connect(lambda index: self.changed.emit(self._choices[index], ""))
        self.row.addWidget(self._box, 1)

    def show_editor(self, editor: Editor) -> None:
        if editor.value in self._choices:
            self._box.setCurrentIndex(self._choices.index(editor.value))
        else:
            self._box.setCurrentIndex(-1)


class TextWidget(ValueWidget):
    """A text field."""

    def __init__(self, editor: Editor) -> None:
        super().__init__(editor)
        self._has_none = bool(editor.none_label)
        self._line = QLineEdit()
        self._line.setPlaceholderText(editor.none_label)
        self._line.editingFinished.connect(self._take)
        self.row.addWidget(self._line, 1)

    def show_editor(self, editor: Editor) -> None:
        text = "" if editor.value is None else str(editor.value)
        if not (self._line.hasFocus() and self._line.isModified()) and text != self._line.text():
            self._line.setText(text)
            self._line.setCursorPosition(0)

    def _take(self) -> None:
        if self._line.isModified():
            self._line.setModified(False)
            text = self._line.text()
            self.changed.emit(None if self._has_none and not text else text, "")


class VectorWidget(ValueWidget):
    """A row of number fields."""

    def __init__(self, editor: Editor) -> None:
        super().__init__(editor)
        self.row.setSpacing(3)
        self._fields: list[NumberField] = []
        for index in range(len(editor.value or editor.default or ())):
            field = NumberField(editor.label, is_whole=editor.is_whole, step=editor.step)
            field.setMinimumWidth(36)
            field.entered.connect(lambda value, at=index: self._take(at, value))
            field.refused.connect(self.refused)
            self._fields.append(field)
            self.row.addWidget(field, 1)

    def show_editor(self, editor: Editor) -> None:
        for field, part in zip(self._fields, editor.value or (), strict=False):
            field.show_value(part)

    def values(self) -> tuple[Any, ...]:
        """Return the values of the fields."""
        return tuple(field.value for field in self._fields)

    def _take(self, index: int, value: float) -> None:
        parts = list(self.values())
        parts[index] = value
        self.changed.emit(tuple(parts), "")


class ColorWidget(VectorWidget):
    """A swatch that opens a colour dialog, and fields of the linear values."""

    def __init__(self, editor: Editor) -> None:
        super().__init__(editor)
        self._label = editor.label
        self._swatch = QPushButton()
        self._swatch.setFixedSize(26, 19)
        self._swatch.clicked.connect(self._choose)
        self.row.insertWidget(0, self._swatch)

    def show_editor(self, editor: Editor) -> None:
        super().show_editor(editor)
        name = swatch(editor.value or (0.0, 0.0, 0.0)).name()
        self._swatch.setStyleSheet(f"background: {name}; padding: 0;")

    def _choose(self) -> None:
        dialog = QColorDialog(swatch(self.values()), self)
        dialog.setWindowTitle(self._label)
        dialog.setOption(QColorDialog.ColorDialogOption.DontUseNativeDialog)
        dialog.colorSelected.connect(self._chosen)
        dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        dialog.open()

    def _chosen(self, color: QColor) -> None:
        parts = (color.redF(), color.greenF(), color.blueF())
        linear = [round(_linear(part), 5) for part in parts]
        self.changed.emit((*linear, *self.values()[3:]), "")


class TickBox(QCheckBox):
    """A check box that draws its own tick: style sheets support only ticks from files."""

    def paintEvent(self, event: QPaintEvent) -> None:
        super().paintEvent(event)
        if self.isChecked():
            option = QStyleOptionButton()
            self.initStyleOption(option)
            part = QStyle.SubElement.SE_CheckBoxIndicator
            glyph("tick", "#ffffff").paint(
                QPainter(self), self.style().subElementRect(part, option, self)
            )


class _CalmSlider(QSlider):
    """A slider that ignores the wheel, so that its panel scrolls."""

    def wheelEvent(self, event: QWheelEvent) -> None:
        event.ignore()


class CalmComboBox(QComboBox):
    """A combo box that ignores the wheel, so that its panel scrolls, and may be narrow."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.setMinimumContentsLength(6)

    def paintEvent(self, event: QPaintEvent) -> None:
        super().paintEvent(event)
        painter = QPainter(self)  # style sheets support only arrows from files
        mode = QIcon.Mode.Normal if self.isEnabled() else QIcon.Mode.Disabled
        place = QRect(self.width() - 17, (self.height() - 12) // 2, 12, 12)
        glyph("down").paint(painter, place, Qt.AlignmentFlag.AlignCenter, mode)

    def wheelEvent(self, event: QWheelEvent) -> None:
        event.ignore()


def swatch(linear: tuple[Any, ...]) -> QColor:
    """Return the sRGB display colour of a linear Rec.709 colour."""
    red, green, blue = (min(max(_curved(part or 0.0), 0.0), 1.0) for part in linear[:3])
    return QColor.fromRgbF(red, green, blue)


def _curved(value: float) -> float:
    """Convert linear to code value by IEC 61966-2-1."""
    return 12.92 * value if value <= 0.0031308 else 1.055 * value ** (1 / 2.4) - 0.055


def _linear(value: float) -> float:
    """Convert code value to linear by IEC 61966-2-1."""
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4


_WIDGETS: dict[str, Callable[[Editor], ValueWidget]] = {
    "bool": CheckWidget,
    "int": NumberWidget,
    "float": NumberWidget,
    "choice": ChoiceWidget,
    "text": TextWidget,
    "vector": VectorWidget,
    "color": ColorWidget,
}
