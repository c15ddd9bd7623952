"""Tables of mouse buttons and keys in a viewport.

As in usdview, Alt with the left, middle and right button orbits, pans and dollies; F frames.
Without Alt, as in splat viewers, the left button picks and orbits, the middle one pans, and the
right one looks around; WASD, Q and E fly while it is held.
"""

from __future__ import annotations

import math
from typing import Literal

from PySide6.QtCore import Qt

from usdsplat.preview.manipulator import Mode
from usdsplat.preview.viewer import Viewer

Gesture = Literal["orbit", "pan", "dolly", "fly"]

_ALT = Qt.KeyboardModifier.AltModifier | Qt.KeyboardModifier.MetaModifier
_BUTTONS: dict[tuple[Qt.MouseButton, bool], Gesture] = {
    (Qt.MouseButton.LeftButton, True): "orbit",
    (Qt.MouseButton.MiddleButton, True): "pan",
    (Qt.MouseButton.RightButton, True): "dolly",
    (Qt.MouseButton.LeftButton, False): "orbit",
    (Qt.MouseButton.MiddleButton, False): "pan",
    (Qt.MouseButton.RightButton, False): "fly",
}
FLIGHT_KEYS: dict[int, tuple[int, int, int]] = {
    Qt.Key.Key_W: (0, 0, 1),
    Qt.Key.Key_S: (0, 0, -1),
    Qt.Key.Key_A: (-1, 0, 0),
    Qt.Key.Key_D: (1, 0, 0),
    Qt.Key.Key_Q: (0, -1, 0),
    Qt.Key.Key_E: (0, 1, 0),
}
"""Key -> right, up and forward, while flying."""
MODE_KEYS: dict[int, Mode | None] = {
    Qt.Key.Key_Q: None,
    Qt.Key.Key_W: "translate",
    Qt.Key.Key_E: "rotate",
    Qt.Key.Key_R: "scale",
}
"""Key -> mode of the manipulator, while not flying."""
CURSORS = {
    "orbit": Qt.CursorShape.ClosedHandCursor,
    "pan": Qt.CursorShape.SizeAllCursor,
    "dolly": Qt.CursorShape.SizeVerCursor,
    "fly": Qt.CursorShape.CrossCursor,
}

DOLLY = 1.44
"""Natural logarithm of the distance factor of a drag over the viewport's height."""
NOTCH = math.log(1.0 / 0.88)
"""Logarithm of the distance factor of a wheel notch, 120 units."""
QUICKER = 1.2
"""Factor of a wheel notch on the flight speed."""
HURRY = 4.0
"""Factor of Shift on the flight speed."""


def gesture_of(button: Qt.MouseButton, modifiers: Qt.KeyboardModifier) -> Gesture | None:
    """Return the gesture of a drag with a button; None for unused buttons."""
    return _BUTTONS.get((button, bool(modifiers & _ALT)))


def notches(units: float) -> float:
    """Convert wheel units to notches."""
    return units / 120.0


def flight_of(keys: set[int], modifiers: Qt.KeyboardModifier) -> tuple[float, float, float]:
    """Return right, up and forward of the pressed keys; opposite ones cancel."""
    ways = [FLIGHT_KEYS[key] for key in keys if key in FLIGHT_KEYS]
    pace = HURRY if modifiers & Qt.KeyboardModifier.ShiftModifier else 1.0
    right, up, forward = (pace * sum(parts) for parts in zip((0, 0, 0), *ways, strict=True))
    return right, up, forward


class Moves:
    """Moves of the view since the last pass of the event loop."""

    def __init__(self) -> None:
        self._drags: dict[Gesture, tuple[float, float]] = {}
        self._zoom = 0.0

    def drag(self, gesture: Gesture, right: float, down: float) -> None:
        """Add a drag, in fractions of the viewport's height."""
        if right or down:
            before = self._drags.get(gesture, (0.0, 0.0))
            self._drags[gesture] = before[0] + right, before[1] + down

    def zoom(self, amount: float) -> None:
        """Add a move towards the target, the natural logarithm of a distance factor."""
        self._zoom += amount

    def __bool__(self) -> bool:
        return bool(self._drags) or self._zoom != 0.0

    def give(self, viewer: Viewer) -> None:
        """Apply the moves to the viewer and clear them."""
        drags, zoom = self._drags, self._zoom
        self._drags, self._zoom = {}, 0.0
        for gesture, (right, down) in drags.items():
            if gesture == "orbit":
                viewer.orbit(right, down)
            elif gesture == "pan":
                viewer.pan(right, down)
            elif gesture == "fly":
                viewer.look_around(right, down)
            else:
                zoom += DOLLY * (right + down)
        if zoom:
            viewer.dolly(math.exp(-zoom))
