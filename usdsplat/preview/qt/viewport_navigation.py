"""What mouse and keys do in a viewport, in tables.

usdview's habits: Alt with the left, middle and right button orbits, pans and dollies; F frames.
Without Alt, as viewers of splats have it: the left button picks, and orbits when dragged; the
middle one pans; the right one looks around, and WASD, Q and E fly while it is held.
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
"""Right, up and forward, while flying."""
MODE_KEYS: dict[int, Mode | None] = {
    Qt.Key.Key_Q: None,
    Qt.Key.Key_W: "translate",
    Qt.Key.Key_E: "rotate",
    Qt.Key.Key_R: "scale",
}
"""The manipulator, while not."""
CURSORS = {
    "orbit": Qt.CursorShape.ClosedHandCursor,
    "pan": Qt.CursorShape.SizeAllCursor,
    "dolly": Qt.CursorShape.SizeVerCursor,
    "fly": Qt.CursorShape.CrossCursor,
}

DOLLY = 1.44
"""Natural logarithm of the distance that a drag over the viewport's height covers."""
NOTCH = math.log(1.0 / 0.88)
"""And one notch of a wheel, of 120 units."""
QUICKER = 1.2
"""What a notch makes of the speed of a flight."""
HURRY = 4.0
"""How much faster Shift flies."""


def gesture_of(button: Qt.MouseButton, modifiers: Qt.KeyboardModifier) -> Gesture | None:
    """What a drag with a button does; None for buttons that do nothing."""
    return _BUTTONS.get((button, bool(modifiers & _ALT)))


def notches(units: float) -> float:
    """Of a wheel, from the units of its event."""
    return units / 120.0


def flight_of(keys: set[int], modifiers: Qt.KeyboardModifier) -> tuple[float, float, float]:
    """Right, up and forward of the keys that are held; opposite ones cancel."""
    ways = [FLIGHT_KEYS[key] for key in keys if key in FLIGHT_KEYS]
    pace = HURRY if modifiers & Qt.KeyboardModifier.ShiftModifier else 1.0
    right, up, forward = (pace * sum(parts) for parts in zip((0, 0, 0), *ways, strict=True))
    return right, up, forward


class Moves:
    """What the pointer did to the view since the last pass of the event loop."""

    def __init__(self) -> None:
        self._drags: dict[Gesture, tuple[float, float]] = {}
        self._zoom = 0.0

    def drag(self, gesture: Gesture, right: float, down: float) -> None:
        """Add a drag, in parts of the viewport's height."""
        if right or down:
            before = self._drags.get(gesture, (0.0, 0.0))
            self._drags[gesture] = before[0] + right, before[1] + down

    def zoom(self, amount: float) -> None:
        """Add a way towards the target, the natural logarithm of a factor."""
        self._zoom += amount

    def __bool__(self) -> bool:
        return bool(self._drags) or self._zoom != 0.0

    def give(self, viewer: Viewer) -> None:
        """Have the viewer do it, and forget it."""
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
