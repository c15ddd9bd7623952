"""Buttons that make a stage with a simulation of the open capture, where there is none yet."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QLabel, QPushButton, QVBoxLayout, QWidget

from usdsplat.core.errors import StageError
from usdsplat.core.progress import silent
from usdsplat.preview.document import Document
from usdsplat.preview.qt.panel_context import PanelContext
from usdsplat.preview.qt.picture_dialogs import ask_name
from usdsplat.preview.qt.save_dialogs import BAKES
from usdsplat.preview.stage_model.saving import user_edits
from usdsplat.products.presets import make_stage

WORDS = {
    "grow": "Grow on it",
    "push": "Push through it",
    "wade": "Wade through it",
    "conform": "Conform it to a shape",
    "dissolve": "Dissolve it",
    "shatter": "Shatter it",
}
"""Preset -> what it does with a capture; those that need no second file."""
ABOUT = (
    "Nothing is simulated on this stage. Each of these writes a new stage, with the capture, your "
    "edits, a simulation and what acts on it, and opens it. The view stays."
)


class FirstSimulation(QWidget):
    """The page of a stage without a simulation.

    Args:
        context: Context of the session.
    """

    made = Signal(object)
    """The stage that was written, a Path."""

    def __init__(self, context: PanelContext, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._context = context
        about = QLabel(ABOUT)
        about.setWordWrap(True)
        about.setProperty("role", "quiet")
        self.buttons: dict[str, QPushButton] = {}
        column = QVBoxLayout(self)
        column.setContentsMargins(12, 12, 12, 12)
        column.addWidget(about)
        for name, words in WORDS.items():
            button = QPushButton(words)
            button.clicked.connect(partial(self._ask, name))
            self.buttons[name] = button
            column.addWidget(button)
        column.addStretch(1)

    def make(self, preset: str, path: Path) -> None:
        """Write the stage of a preset, and announce it."""
        for button in self.buttons.values():
            button.setEnabled(False)

        def ended(_: object = None) -> None:
            for button in self.buttons.values():
                button.setEnabled(True)

        def failed(error: Exception) -> None:
            ended()
            self._context.complain(str(error))

        def done(_: object) -> None:
            # asked again: an edit may have been made since
            self._context.proxy.ask(lambda document: document.edits.has_unsaved, announce)

        def announce(has_unsaved: bool) -> None:
            ended()
            self._context.has_unsaved = has_unsaved
            self.made.emit(path)

        self._context.proxy.ask(partial(_make, preset=preset, path=path), done, failed)

    def _ask(self, preset: str) -> None:
        act: Callable[[Path], None] = partial(self.make, preset)
        ask_name(self, WORDS[preset], BAKES, f"{preset}.usda", act)


def _make(document: Document, *, preset: str, path: Path) -> None:
    """Write the stage of a preset for a document's file, with the edits of the session."""
    sources = document.sources
    if sources is None:
        raise StageError("simulation", "a stage in memory", "one from a file")
    with document.lock:
        edits = user_edits(document.stage)
    make_stage(preset, sources.path, path, axes=sources.axes, progress=silent, edits=edits)
    document.edits.note_saved()
