"""Keys of a viewport while no button is held."""

from __future__ import annotations

from typing import Protocol

from PySide6.QtCore import Qt

from usdsplat.preview.manipulator import Mode, Space
from usdsplat.preview.qt.viewport_navigation import MODE_KEYS
from usdsplat.preview.viewer import Viewer


class Keyed(Protocol):
    """A viewport, as needed by its keys."""

    viewer: Viewer
    space: Space
    shows_hud: bool

    def set_mode(self, mode: Mode | None) -> None:
        """Set the mode of the manipulator, or none."""

    def set_space(self, space: Space) -> None:
        """Set the manipulator's axes."""

    def set_hud(self, is_shown: bool) -> None:
        """Show or hide the heads-up display."""


def do_key(viewport: Keyed, key: int, modifiers: Qt.KeyboardModifier) -> bool:
    """Handle a key; return whether it was used."""
    shift = bool(modifiers & Qt.KeyboardModifier.ShiftModifier)
    if modifiers & ~Qt.KeyboardModifier.ShiftModifier & ~Qt.KeyboardModifier.KeypadModifier:
        return False
    if key == Qt.Key.Key_A or (key == Qt.Key.Key_F and shift):
        viewport.viewer.frame()
    elif key == Qt.Key.Key_F:
        viewport.viewer.frame(viewport.viewer.state.selected)
    elif key == Qt.Key.Key_H:
        viewport.set_hud(not viewport.shows_hud)
    elif key == Qt.Key.Key_X:
        viewport.set_space("local" if viewport.space == "world" else "world")
    elif key in MODE_KEYS:
        viewport.set_mode(MODE_KEYS[key])
    else:
        return False
    return True
