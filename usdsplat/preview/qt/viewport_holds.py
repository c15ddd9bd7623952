"""Drags in a viewport: of the view, the wipe or a handle.

Positions are in pixels of the viewport.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from PySide6.QtCore import Qt

from usdsplat.preview.dragging import as_matrix, begin_drag
from usdsplat.preview.manipulator import Handle, Manipulator
from usdsplat.preview.projection import Pixel, Projection
from usdsplat.preview.qt.viewport_navigation import (
    CURSORS,
    FLIGHT_KEYS,
    Gesture,
    Moves,
    flight_of,
)
from usdsplat.preview.viewer import Viewer

CLICK = 4.0
"""Distance from which a press becomes a drag [pixel of the window]."""


class Hold(Protocol):
    """A press of a button until its release."""

    @property
    def cursor(self) -> Qt.CursorShape:
        """Cursor during the hold."""

    def move(self, pixel: Pixel, modifiers: Qt.KeyboardModifier) -> None:
        """Handle a move of the pointer."""

    def let_go(self, pixel: Pixel) -> None:
        """Handle the release of the button."""

    def press(self, keys: set[int], modifiers: Qt.KeyboardModifier) -> bool:
        """Handle a change of pressed keys; return whether it was used."""


class NavigatingHold:
    """A drag of the view.

    Args:
        moves: Collects the moves.
        clicked: Called if the pointer is released where it was pressed; None if clicks do nothing
            and each move counts.
    """

    def __init__(
        self,
        gesture: Gesture,
        pixel: Pixel,
        moves: Moves,
        viewer: Viewer,
        *,
        slack: float = 0.0,
        clicked: Callable[[], None] | None = None,
    ) -> None:
        self.gesture = gesture
        self._moves, self._viewer = moves, viewer
        self._last, self._slack, self._clicked = pixel, slack, clicked

    @property
    def cursor(self) -> Qt.CursorShape:
        """Cursor of the gesture."""
        return CURSORS[self.gesture]

    def move(self, pixel: Pixel, modifiers: Qt.KeyboardModifier) -> None:
        """Drag the view; `modifiers` are ignored."""
        right, down = pixel[0] - self._last[0], pixel[1] - self._last[1]
        if self._clicked is not None:
            if max(abs(right), abs(down)) <= self._slack:
                return
            self._clicked = None
        self._last = pixel
        height = self._viewer.state.size[1]
        self._moves.drag(self.gesture, right / height, down / height)

    def let_go(self, pixel: Pixel) -> None:
        """Report a click, if it was one."""
        if self._clicked is not None:
            self._clicked()

    def press(self, keys: set[int], modifiers: Qt.KeyboardModifier) -> bool:
        """Fly while looking around."""
        if self.gesture != "fly":
            return False
        self._viewer.set_flight(*flight_of(keys, modifiers))
        return not keys.isdisjoint(FLIGHT_KEYS)


class WipeHold:
    """A drag of the wipe of a comparison."""

    cursor = Qt.CursorShape.SplitHCursor

    def __init__(self, pixel: Pixel, viewer: Viewer) -> None:
        self._viewer = viewer
        self._offset = viewer.state.wipe * viewer.state.size[0] - pixel[0]

    def move(self, pixel: Pixel, modifiers: Qt.KeyboardModifier) -> None:
        """Move the wipe to the pointer."""
        self._viewer.set_wipe((pixel[0] + self._offset) / self._viewer.state.size[0])

    def let_go(self, pixel: Pixel) -> None:
        """Do nothing: the position is kept."""

    def press(self, keys: set[int], modifiers: Qt.KeyboardModifier) -> bool:
        """Return False: keys are not used."""
        return False


class HandleHold:
    """A drag of a manipulator's handle; Ctrl snaps."""

    cursor = Qt.CursorShape.ClosedHandCursor

    def __init__(
        self,
        handle: Handle,
        manipulator: Manipulator,
        pixel: Pixel,
        projection: Projection,
        viewer: Viewer,
    ) -> None:
        self.handle = handle
        self._viewer = viewer
        self._drag = begin_drag(manipulator, handle, pixel, projection)
        viewer.begin_drag()

    def move(self, pixel: Pixel, modifiers: Qt.KeyboardModifier) -> None:
        """Move the prim by the pointer."""
        snaps = bool(modifiers & Qt.KeyboardModifier.ControlModifier)
        self._viewer.place(as_matrix(self._drag(pixel, snaps=snaps)))

    def let_go(self, pixel: Pixel) -> None:
        """Do nothing: the position is kept."""

    def press(self, keys: set[int], modifiers: Qt.KeyboardModifier) -> bool:
        """Return False: keys are not used."""
        return False
