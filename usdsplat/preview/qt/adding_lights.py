"""Add lights to the open stage: from menus, and where a picture lacks them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from PySide6.QtCore import QObject, Qt, Signal
from PySide6.QtWidgets import QFileDialog, QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

from usdsplat.preview.camera import middle_of
from usdsplat.preview.qt.message_bar import MessageBar
from usdsplat.preview.qt.panel_context import PanelContext
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.stage_model.lights import add_dome_light, add_key_light

NONE_HERE = "No lights on this stage. Lighting needs one; until then splats look as captured."
NO_EFFECT = "Lights have no effect on splats while Lighting is captured"


class LightOffer(QWidget):
    """A word that there are no lights, and buttons to add one.

    It is shown while lights are asked for and there are none.

    Args:
        context: Context of the session.
    """

    added = Signal()
    """A light was added."""

    def __init__(self, context: PanelContext, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._context = context
        words = QLabel(NONE_HERE)
        words.setWordWrap(True)
        words.setProperty("role", "animated")
        self.key = QPushButton("Add a key light")
        self.key.clicked.connect(self.add_key)
        self.dome = QPushButton("Add a dome light")
        self.dome.clicked.connect(lambda: self.add_dome())
        line = QHBoxLayout()
        line.addWidget(self.key)
        line.addWidget(self.dome)
        column = QVBoxLayout(self)
        column.setContentsMargins(8, 2, 8, 6)
        column.addWidget(words)
        column.addLayout(line)
        self.hide()
        context.view_changed.connect(self.follow)
        context.proxy.picture.connect(lambda picture: self.follow())

    def follow(self) -> None:
        """Show or hide this for the current look and the lights of the last picture."""
        picture = self._context.picture
        is_lit = self._context.look.settings.lighting != "captured"
        self.setVisible(is_lit and picture is not None and not picture.lights)

    def add_key(self) -> None:
        """Add a distant light from above left of the view, and select it."""
        picture, viewer = self._context.picture, self._context.viewer
        if picture is not None:
            middle = middle_of(viewer.subject, picture.camera)
            self._add(lambda edits: add_key_light(edits, picture.camera, middle))

    def add_dome(self, texture: Path | None = None) -> None:
        """Add a dome light, and select it."""
        self._add(lambda edits: add_dome_light(edits, texture))

    def ask_texture(self) -> None:
        """Ask for a picture, and add a dome light with it."""
        dialog = QFileDialog(self.window(), "Texture of the dome")
        dialog.setNameFilters(["Pictures (*.exr *.hdr *.png *.jpg *.tif *.tiff)", "All files (*)"])
        dialog.setFileMode(QFileDialog.FileMode.ExistingFile)
        dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        dialog.fileSelected.connect(lambda name: self.add_dome(Path(name)))
        dialog.open()

    def _add(self, add: Callable[[Edits], str]) -> None:
        """Add a light as a step that can be undone, and select it when it is there."""
        added: list[str] = []

        def done(paths: tuple[str, ...]) -> None:
            if paths:
                self._context.viewer.select(paths)
                self.added.emit()

        self._context.edit(lambda edits: added.append(add(edits)))
        self._context.proxy.ask(lambda document: tuple(added), done)


class LightHint(QObject):
    """A notice, after a light was added, that splats do not show it, and a button for it.

    Args:
        context: Context of the session.
        offer: Adds the lights.
        notices: Shows the notice.
    """

    def __init__(self, context: PanelContext, offer: LightOffer, notices: MessageBar) -> None:
        super().__init__(notices)
        self._context, self._notices = context, notices
        offer.added.connect(self._hint)
        context.view_changed.connect(self._take_back)

    @property
    def _is_captured(self) -> bool:
        return self._context.look.settings.lighting == "captured"

    def _hint(self) -> None:
        if self._is_captured:
            self._notices.say(NO_EFFECT, action="Relit", act=self._relight)

    def _relight(self) -> None:
        settings = replace(self._context.look.settings, lighting="relit")
        self._context.set_look(settings=settings)

    def _take_back(self) -> None:
        if self._notices.sentence == NO_EFFECT and not self._is_captured:
            self._notices.clear()
