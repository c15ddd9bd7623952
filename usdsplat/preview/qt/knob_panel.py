"""A form built from `Editor`s: a heading per group, a row per value."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QHBoxLayout,
    QLabel,
    QSizePolicy,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from usdsplat.preview.knob_model import Editor
from usdsplat.preview.qt import style
from usdsplat.preview.qt.glyphs import glyph
from usdsplat.preview.qt.knob_widgets import make_widget
from usdsplat.preview.qt.number_field import number_text


class KnobPanel(QWidget):
    """A form that shows editors and signals changes, but changes nothing itself.

    A group first shows the rows that are of use to most people, and the others behind "More". The
    rows of a group are created when it is first opened, so that hundreds of parameters cost
    nothing while hidden.

    Args:
        open_groups: Number of groups that are open at first: the first one, and those in which most
            is authored; None for all.
    """

    changed = Signal(str, object, str)
    """Name, new value, and a key shared by all changes of one drag ("" for a single change)."""
    refused = Signal(str)
    """Error message."""

    def __init__(self, *, open_groups: int | None = None, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._open_groups = open_groups
        self._shape: tuple[object, ...] = ()
        self._groups: dict[str, _Group] = {}
        self._column = QVBoxLayout(self)
        self._column.setContentsMargins(0, 0, 0, 0)
        self._column.setSpacing(0)

    def show_editors(self, editors: Sequence[Editor]) -> None:
        """Show editors; rows that stay keep text that is being typed."""
        groups: dict[str, list[Editor]] = {}
        for editor in editors:
            groups.setdefault(editor.group, []).append(editor)
        is_main = {name: any(each.is_main for each in group) for name, group in groups.items()}
        groups = dict(sorted(groups.items(), key=lambda item: not is_main[item[0]]))
        shape = tuple(_shape(editor) for editor in editors)
        if shape != self._shape:
            self._shape = shape
            self._rebuild(groups)
        for name, group in self._groups.items():
            group.show_editors(groups[name])

    def search(self, text: str) -> int:
        """Show only editors with a text in label, name or help; return their number."""
        return sum(group.search(text.strip().lower()) for group in self._groups.values())

    def row(self, name: str) -> KnobRow:
        """Return the row of an editor, and open its group.

        Raises:
            KeyError: If the name is unknown.
        """
        for group in self._groups.values():
            if group.has(name):
                group.open(True)
                group.show_more(group.shows_more or name not in group.rows)
                return group.rows[name]
        raise KeyError(name)

    def _rebuild(self, groups: dict[str, list[Editor]]) -> None:
        was_open = {name: group.is_open for name, group in self._groups.items()}
        was_long = {name: group.shows_more for name, group in self._groups.items()}
        for group in self._groups.values():
            self._column.removeWidget(group)
            group.hide()
            group.deleteLater()
        self._groups = {}
        first = self._first(groups)
        for name, editors in groups.items():
            group = _Group(name, editors, panel=self)
            group.open(was_open.get(name, name in first))
            group.show_more(was_long.get(name, False))
            self._groups[name] = group
            self._column.addWidget(group)

    def _first(self, groups: dict[str, list[Editor]]) -> list[str]:
        """Return the names of the groups that are open at first."""
        names = list(groups)
        if self._open_groups is None or not names:
            return names
        authored = {name: sum(each.is_authored for each in groups[name]) for name in names}
        others = sorted(names[1:], key=lambda name: -authored[name])
        return [names[0], *others[: self._open_groups - 1]]


class _Group(QWidget):
    """A heading with rows that can be collapsed."""

    def __init__(self, name: str, editors: list[Editor], *, panel: KnobPanel) -> None:
        super().__init__(panel)
        self._panel = panel
        self._editors = editors
        self._text = ""
        self.is_open = False
        self.rows: dict[str, KnobRow] = {}
        self._heading = QToolButton(self)  # without a parent it would briefly be a window
        self._heading.setText(name)
        self._heading.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextBesideIcon)
        self._heading.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self._heading.setProperty("role", "heading")
        self._heading.setVisible(bool(name))
        self._heading.clicked.connect(lambda: self.open(not self.is_open))
        self.more = QToolButton(self)
        self.more.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.more.setProperty("role", "quiet")
        self.more.setAutoRaise(True)
        self.more.clicked.connect(lambda: self.show_more(not self.shows_more))
        self.shows_more: bool = False
        self._body = QWidget(self)
        self._lines = QVBoxLayout(self._body)
        self._lines.setContentsMargins(8, 2, 4, 6)
        self._lines.setSpacing(3)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self._heading)
        column.addWidget(self._body)
        column.addWidget(self.more)
        self.open(not name)

    def has(self, name: str) -> bool:
        return any(editor.name == name for editor in self._editors)

    def open(self, is_open: bool) -> None:
        """Show or hide the rows."""
        self.is_open = is_open or not self._heading.text()
        self._heading.setIcon(glyph("down" if self.is_open else "right"))
        self._arrange()

    def show_more(self, is_shown: bool) -> None:
        """Show all rows, or those that are of use to most people."""
        self.shows_more = is_shown
        self._arrange()

    def show_editors(self, editors: list[Editor]) -> None:
        is_same = [each.is_main for each in editors] == [each.is_main for each in self._editors]
        self._editors = editors
        for editor in editors:
            if editor.name in self.rows:
                self.rows[editor.name].show_editor(editor)
        if not is_same:  # one that is authored is main
            self._arrange()

    def search(self, text: str) -> int:
        """Show matching rows, even if collapsed; return their number."""
        self._text = text
        found = sum(_matches(editor, text) for editor in self._editors)
        self.setVisible(found > 0)
        self._arrange()
        return found

    def _arrange(self) -> None:
        is_shown = self.is_open or bool(self._text)
        rest = sum(not editor.is_main for editor in self._editors)
        is_whole = self.shows_more or bool(self._text)
        self._body.setVisible(is_shown and (is_whole or rest < len(self._editors)))
        self.more.setVisible(self.is_open and not self._text and rest > 0)
        self.more.setText("Less" if self.shows_more else f"More ({rest})")
        if not is_shown:
            return
        for editor in self._editors:
            if not (editor.is_main or is_whole):
                if editor.name in self.rows:
                    self.rows[editor.name].hide()
                continue
            if editor.name not in self.rows:
                row = KnobRow(editor)
                row.changed.connect(self._panel.changed)
                row.refused.connect(self._panel.refused)
                self.rows[editor.name] = row
                known = [each.name for each in self._editors if each.name in self.rows]
                self._lines.insertWidget(known.index(editor.name), row)
            self.rows[editor.name].setVisible(_matches(editor, self._text))


class KnobRow(QWidget):
    """A row with a label, the value's widget, and a reset button."""

    changed = Signal(str, object, str)
    refused = Signal(str)

    def __init__(self, editor: Editor) -> None:
        super().__init__()
        self._editor = editor
        self._label = ElidedLabel()
        self._label.setFixedWidth(style.LABELS)
        self.widget = make_widget(editor)
        self.widget.changed.connect(lambda value, key: self.changed.emit(editor.name, value, key))
        self.widget.refused.connect(self.refused)
        self.problem = ElidedLabel()
        self.problem.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.reset = QToolButton()
        self.reset.setIcon(glyph("reset"))
        self.reset.setFixedSize(18, 18)
        self.reset.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.reset.clicked.connect(lambda: self.changed.emit(editor.name, self._editor.default, ""))
        keeps_place = self.reset.sizePolicy()
        keeps_place.setRetainSizeWhenHidden(True)
        self.reset.setSizePolicy(keeps_place)
        line = QHBoxLayout(self)
        line.setContentsMargins(0, 0, 0, 0)
        line.setSpacing(6)
        line.addWidget(self._label)
        line.addWidget(self.widget, 1)
        line.addWidget(self.problem, 1)
        line.addWidget(self.reset)
        self.setMinimumHeight(style.ROW)
        self.show_editor(editor)

    def show_editor(self, editor: Editor) -> None:
        """Show the current value, or why the stage's value is none."""
        self._editor = editor
        self._label.show_text(editor.label, role="animated" if editor.is_animated else "quiet")
        self.setToolTip(tool_tip(editor))
        self.reset.setToolTip(f"Back to {value_text(editor, editor.default)}")
        is_other = editor.value != editor.default or bool(editor.problem)
        self.reset.setVisible(is_other and not editor.is_read_only)
        self.widget.show_editor(editor)
        self.widget.setVisible(not editor.problem)
        self.problem.setVisible(bool(editor.problem))
        self.problem.setToolTip(editor.problem)
        self.problem.show_text(editor.problem.partition(": ")[2], role="wrong")


class ElidedLabel(QLabel):
    """A label that is elided if it is too long."""

    def show_text(self, text: str, *, role: str) -> None:
        """Show a text in one of the style's roles."""
        room = self.maximumWidth()
        self.setText(self.fontMetrics().elidedText(text, Qt.TextElideMode.ElideRight, room))
        if self.property("role") != role:
            self.setProperty("role", role)
            self.style().unpolish(self)
            self.style().polish(self)


def tool_tip(editor: Editor) -> str:
    """Return the tooltip of a value: name, help, unit, range, default."""
    facts = []
    if editor.unit:
        facts.append(f"[{editor.unit}]")
    low, high = editor.minimum, editor.maximum
    if low is not None and high is not None:
        facts.append(f"{number_text(low)} to {number_text(high)}")
    elif low is not None:
        facts.append(f"{number_text(low)} or more")
    elif high is not None:
        facts.append(f"{number_text(high)} or less")
    facts.append(f"default {value_text(editor, editor.default)}")
    if editor.is_animated:
        facts.append("animated")
    lines = (f"<b>{escape(editor.label)}</b>", escape(editor.help), escape(", ".join(facts)))
    return "<p>" + "<br>".join(line for line in lines if line) + "</p>"


def value_text(editor: Editor, value: object) -> str:
    """Format a value of an editor."""
    if isinstance(value, int | float) and value < 0 and editor.negative_label:
        return editor.negative_label
    if value is None:
        return editor.none_label or "nothing"
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, int | float):
        return number_text(value)
    if isinstance(value, tuple):
        return ", ".join(value_text(editor, part) for part in value)
    return str(value) or "nothing"


def _shape(editor: Editor) -> tuple[object, ...]:
    """Return the properties that an editor's widget is built from, to reuse widgets."""
    size = len(editor.value or editor.default or ()) if editor.kind in ("vector", "color") else 0
    return (
        *(editor.name, editor.label, editor.kind, editor.group, editor.choices, size),
        *(editor.unit, editor.none_label, editor.step, editor.is_read_only),
    )


def _matches(editor: Editor, text: str) -> bool:
    words = f"{editor.label} {editor.name} {editor.help}".lower()
    return all(part in words for part in text.split())
