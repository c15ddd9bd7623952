"""Dialog with all keys and gestures."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QDialog, QTextBrowser, QVBoxLayout, QWidget

from usdsplat.preview.qt.keys import help_html


class HelpDialog(QDialog):
    """A non-modal dialog with all keys and gestures."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setWindowTitle("Keys and gestures")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setModal(False)
        self.resize(520, 720)
        self.text = QTextBrowser()
        self.text.setHtml(help_html())
        self.text.setFrameShape(QTextBrowser.Shape.NoFrame)
        column = QVBoxLayout(self)
        column.setContentsMargins(14, 6, 6, 6)
        column.addWidget(self.text)
