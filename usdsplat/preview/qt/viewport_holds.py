"""What the pointer holds in a viewport while a button is down: the view, the wipe or a handle.

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
"""How far a click may slip before it is a drag [pixel of the window]."""


class Hold(Protocol):
    """One press of a button, until it is let go."""

    @property
    def cursor(self) -> Qt.CursorShape:
        """While it is held."""

    def move(self, pixel: Pixel, modifiers: Qt.KeyboardModifier) -> None:
        """The pointer went there."""

    def let_go(self, pixel: Pixel) -> None:
        """The button is up again."""

    def press(self, keys: set[int], modifiers: Qt.KeyboardModifier) -> bool:
        """Other keys are down than before; whether that means anything."""


class NavigatingHold:
    """Of the view.

    Args:
        moves: Where the moves are gathered.
        clicked: Called if the pointer was let go where it was pressed; None if that is nothing and
            each move counts.
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
        """The gesture's."""
        return CURSORS[self.gesture]

    def move(self, pixel: Pixel, modifiers: Qt.KeyboardModifier) -> None:
        """Drag the view; `modifiers` change nothing."""
        right, down = pixel[0] - self._last[0], pixel[1] - self._last[1]
        if self._clicked is not None:
            if max(abs(right), abs(down)) <= self._slack:
                return
            self._clicked = None
        self._last = pixel
        height = self._viewer.state.size[1]
        self._moves.drag(self.gesture, right / height, down / height)

    def let_go(self, pixel: Pixel) -> None:
        """Click, if it was one."""
        if self._clicked is not None:
            self._clicked()

    def press(self, keys: set[int], modifiers: Qt.KeyboardModifier) -> bool:
        """Fly, while looking around."""
        if self.gesture != "fly":
            return False
        self._viewer.set_flight(*flight_of(keys, modifiers))
        return not keys.isdisjoint(FLIGHT_KEYS)


class WipeHold:
    """Of where a comparison is cut."""

    cursor = Qt.CursorShape.SplitHCursor

    def __init__(self, pixel: Pixel, viewer: Viewer) -> None:
        self._viewer = viewer
        self._offset = viewer.state.wipe * viewer.state.size[0] - pixel[0]

    def move(self, pixel: Pixel, modifiers: Qt.KeyboardModifier) -> None:
        """Cut where the pointer is."""
        self._viewer.set_wipe((pixel[0] + self._offset) / self._viewer.state.size[0])

    def let_go(self, pixel: Pixel) -> None:
        """It stays where it is."""

    def press(self, keys: set[int], modifiers: Qt.KeyboardModifier) -> bool:
        """Keys mean nothing to it."""
        return False


class HandleHold:
    """Of a handle of the manipulator; Ctrl snaps."""

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
        """Have the prim where the pointer wants it."""
        snaps = bool(modifiers & Qt.KeyboardModifier.ControlModifier)
        self._viewer.place(as_matrix(self._drag(pixel, snaps=snaps)))

    def let_go(self, pixel: Pixel) -> None:
        """It stays where it is."""

    def press(self, keys: set[int], modifiers: Qt.KeyboardModifier) -> bool:
        """Keys mean nothing to it."""
        return False
