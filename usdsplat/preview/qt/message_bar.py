"""Messages above the viewport: problems and notices with an action."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QHBoxLayout,
    QLabel,
    QPushButton,
    QSizePolicy,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from usdsplat.preview.qt import style
from usdsplat.preview.qt.glyphs import glyph


class MessageBar(QWidget):
    """A bar with one message, until it is dismissed or obsolete.

    Args:
        is_problem: Whether it shows errors.
    """

    def __init__(self, *, is_problem: bool, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._act: Callable[[], None] = self.clear
        mark = (style.WRONG if is_problem else style.ANIMATED).name()
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self.setObjectName("message")
        self.setStyleSheet(
            f"#message {{ background: {style.RAISED.name()}; border-left: 3px solid {mark}; }}"
        )
        self._label = QLabel()
        self._label.setWordWrap(True)
        self._label.setTextFormat(Qt.TextFormat.PlainText)
        self._label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self._label.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Preferred)
        self.button = QPushButton()
        self.button.clicked.connect(lambda: self._act())
        self.dismiss = QToolButton()
        self.dismiss.setIcon(glyph("cross"))
        self.dismiss.setToolTip("Dismiss")
        self.dismiss.clicked.connect(self.clear)
        line = QHBoxLayout(self)
        line.setContentsMargins(10, 4, 6, 4)
        line.addWidget(self._label, 1)
        line.addWidget(self.button)
        line.addWidget(self.dismiss)
        self.hide()

    @property
    def sentence(self) -> str:
        """The current message; "" for none."""
        return self._label.text() if not self.isHidden() else ""

    def say(
        self, sentence: str, *, action: str = "", act: Callable[[], None] | None = None
    ) -> None:
        """Show a message, with a button if there is an action."""
        self._label.setText(sentence)
        self._act = act or self.clear
        self.button.setText(action)
        self.button.setVisible(bool(action))
        self.show()

    def clear(self) -> None:
        """Hide the message."""
        self.hide()


def above(widget: QWidget, *bars: MessageBar) -> QWidget:
    """Lay out bars above a widget, which makes room for them: they cover nothing."""
    both = QWidget()
    lines = QVBoxLayout(both)
    lines.setContentsMargins(0, 0, 0, 0)
    lines.setSpacing(0)
    for bar in bars:
        lines.addWidget(bar)
    lines.addWidget(widget, 1)
    return both
