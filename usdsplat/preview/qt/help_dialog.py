"""Dialogs with all keys and gestures, and with the version."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QDialog, QMessageBox, QTextBrowser, QVBoxLayout, QWidget

from usdsplat import __version__
from usdsplat.preview.qt.glyphs import window_icon
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


def show_about(parent: QWidget) -> None:
    """Show name, version and licence."""
    words = (
        f"<b>usdsplat {__version__}</b><p>Gaussian splats in USD pipelines.</p><p>Apache-2.0</p>"
    )
    box = QMessageBox(QMessageBox.Icon.NoIcon, "About usdsplat", words, parent=parent)
    box.setIconPixmap(window_icon().pixmap(64, 64))
    box.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
    box.open()
