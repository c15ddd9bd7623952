"""The page of a window without a stage, which shows what is being read."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QProgressBar, QVBoxLayout, QWidget

from usdsplat.preview.qt.glyphs import window_icon
from usdsplat.preview.values import Busy

INVITATION = "Drop a stage or a capture here, or open one with Ctrl+O"
WIDTH = 320
"""Width of the progress bar [pixel]."""


class EmptyPage(QWidget):
    """An invitation, or what is being done, with its progress."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        picture = QLabel()
        picture.setPixmap(window_icon().pixmap(96, 96))
        self.note = QLabel(INVITATION)
        self.note.setProperty("role", "quiet")
        self.bar = QProgressBar()
        self.bar.setFixedWidth(WIDTH)
        self.bar.setTextVisible(False)
        self.bar.hide()
        column = QVBoxLayout(self)
        column.addStretch(1)
        for widget in (picture, self.note, self.bar):
            column.addWidget(widget, 0, Qt.AlignmentFlag.AlignHCenter)
        column.addStretch(1)

    def say(self, words: str) -> None:
        """Show what is being done; "" shows the invitation."""
        self.note.setText(words or INVITATION)
        self.bar.setVisible(bool(words))
        self.bar.setRange(0, 0)  # moves without an end

    def show_busy(self, busy: Busy) -> None:
        """Show what is being done, and how much of it is done."""
        self.say(busy.what)
        self.bar.setRange(0, busy.total)
        self.bar.setValue(busy.done)
