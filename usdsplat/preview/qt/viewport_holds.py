"""Drags in a viewport: of the view, a box, the wipe or a handle.

Positions are in pixels of the viewport.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from PySide6.QtCore import Qt

from usdsplat.preview.dragging import as_matrix, begin_drag
from usdsplat.preview.manipulator import Handle, Manipulator, Mode
from usdsplat.preview.projection import Pixel, Projection
from usdsplat.preview.qt.viewport_navigation import (
    CURSORS,
    FLIGHT_KEYS,
    Gesture,
    Moves,
    flight_of,
)
from usdsplat.preview.viewer import Viewer

Rectangle = tuple[float, float, float, float]
"""Left, top, right and bottom edge."""
CLICK = 4.0
"""Distance from which a press becomes a drag [pixel of the window]."""

_VERBS: dict[Mode, str] = {"translate": "Move", "rotate": "Turn", "scale": "Scale"}
"""What a drag of the manipulator does, for the name of its undo."""


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


class BoxHold:
    """A drag that draws a box around what is to be selected; released at once it is a click."""

    cursor = Qt.CursorShape.CrossCursor

    def __init__(
        self,
        pixel: Pixel,
        *,
        slack: float,
        clicked: Callable[[], None],
        boxed: Callable[[Rectangle], None],
    ) -> None:
        self._start, self._end, self._slack = pixel, pixel, slack
        self._clicked, self._boxed = clicked, boxed
        self._is_box = False

    @property
    def rectangle(self) -> Rectangle | None:
        """The box so far; None as long as it may be a click."""
        if not self._is_box:
            return None
        (x0, x1), (y0, y1) = (sorted(pair) for pair in zip(self._start, self._end, strict=True))
        return x0, y0, x1, y1

    def move(self, pixel: Pixel, modifiers: Qt.KeyboardModifier) -> None:
        """Draw the box to the pointer."""
        self._end = pixel
        away = max(abs(pixel[0] - self._start[0]), abs(pixel[1] - self._start[1]))
        self._is_box |= away > self._slack

    def let_go(self, pixel: Pixel) -> None:
        """Report the box, or a click."""
        self.move(pixel, Qt.KeyboardModifier.NoModifier)
        rectangle = self.rectangle
        if rectangle is None:
            self._clicked()
        else:
            self._boxed(rectangle)

    def press(self, keys: set[int], modifiers: Qt.KeyboardModifier) -> bool:
        """Return False: keys are not used."""
        return False


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
    """A drag of a manipulator's handle; Ctrl snaps, Escape takes it back."""

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
        self._is_over = False
        self._drag = begin_drag(manipulator, handle, pixel, projection)
        viewer.begin_drag(_VERBS[manipulator.mode])

    @property
    def words(self) -> str:
        """What the drag has changed so far; "" for nothing."""
        return "" if self._is_over else self._drag.words

    def move(self, pixel: Pixel, modifiers: Qt.KeyboardModifier) -> None:
        """Move the prim by the pointer."""
        if self._is_over:
            return
        snaps = bool(modifiers & Qt.KeyboardModifier.ControlModifier)
        self._viewer.place(as_matrix(self._drag(pixel, snaps=snaps)))

    def let_go(self, pixel: Pixel) -> None:
        """Do nothing: the position is kept."""

    def press(self, keys: set[int], modifiers: Qt.KeyboardModifier) -> bool:
        """Take the drag back at Escape; the rest of it does nothing."""
        if Qt.Key.Key_Escape not in keys:
            return False
        if not self._is_over:
            self._is_over = True
            self._viewer.place(None)
        return True
