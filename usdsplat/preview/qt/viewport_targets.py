"""What lies under the pointer in a viewport, and the drag that a press of a button begins there.

Positions are in pixels of the viewport.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtCore import Qt

from usdsplat.preview.manipulator import Handle, Manipulator
from usdsplat.preview.overlays import LightMark, MeshEdges
from usdsplat.preview.projection import Pixel, Projection
from usdsplat.preview.qt.viewport_figures import lights_at, outline_at
from usdsplat.preview.qt.viewport_holds import (
    CLICK,
    BoxHold,
    HandleHold,
    Hold,
    NavigatingHold,
    Rectangle,
    WipeHold,
)
from usdsplat.preview.qt.viewport_navigation import Moves, gesture_of
from usdsplat.preview.viewer import Viewer

WIPE_REACH = 9.0
"""Maximum distance from the line of the wipe for a hit [pixel of the window]."""
GRIP_REACH = 20.0
"""Maximum distance from the middle of its handle."""


@dataclass(frozen=True, slots=True)
class Hot:
    """What the pointer is over."""

    handle: Handle | None = None
    is_wipe: bool = False
    lights: tuple[str, ...] = ()
    """Paths of lights, all at one place."""
    outline: str = ""
    """Path of the affector whose outline is at the place; "" for none."""

    @property
    def light(self) -> str:
        """Path of the first of the lights; "" for none."""
        return self.lights[0] if self.lights else ""

    @property
    def cursor(self) -> Qt.CursorShape:
        """Cursor that says what a drag would do."""
        if self.is_wipe:
            return Qt.CursorShape.SplitHCursor
        is_picked = bool(self.lights or self.outline)
        return Qt.CursorShape.PointingHandCursor if is_picked else Qt.CursorShape.ArrowCursor


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Targets:
    """Everything in a viewport that can be pressed."""

    viewer: Viewer
    projection: Projection | None
    """Of the displayed picture; None before the first."""
    manipulator: Manipulator | None
    lights: tuple[LightMark, ...]
    """Lights that are shown."""
    outlines: tuple[MeshEdges, ...]
    """Outlines of what acts on simulations, if they are shown."""
    ratio: float
    """Viewport pixels per window pixel."""

    def at(self, pixel: Pixel) -> Hot:
        """Return what lies under a pixel; the wipe is above the handles of the manipulator."""
        if self._is_wipe(pixel):
            return Hot(is_wipe=True)
        if self.projection is None:
            return Hot()
        handle = self.manipulator.hit(pixel, self.projection) if self.manipulator else None
        if handle is not None:
            return Hot(handle=handle)
        lights = lights_at(self.lights, pixel, self.projection, ratio=self.ratio)
        if lights:
            return Hot(lights=lights)
        return Hot(outline=outline_at(self.outlines, pixel, self.projection, ratio=self.ratio))

    def _is_wipe(self, pixel: Pixel) -> bool:
        state = self.viewer.state
        if state.other is None:
            return False
        x = state.wipe * state.size[0]
        grip = grip_of(x, state.size, ratio=self.ratio)
        is_grip = math.dist(pixel, grip) <= GRIP_REACH * self.ratio
        return is_grip or abs(x - pixel[0]) <= WIPE_REACH * self.ratio


def grip_of(x: float, size: tuple[int, int], *, ratio: float) -> Pixel:
    """Return the middle of the wipe's handle, which stays in the viewport at its edges too."""
    reach = GRIP_REACH * ratio
    return min(max(x, reach), max(size[0] - reach, reach)), 0.5 * size[1]


def with_lights(
    selected: tuple[str, ...], lights: tuple[str, ...], *, adds: bool
) -> tuple[str, ...]:
    """Return the selection after a click on lights at one place.

    A click selects the first, and repeated clicks the others in turn. One that adds to the
    selection adds the next light, and takes the first one out when all are selected.
    """
    if adds:
        new = [each for each in lights if each not in selected]
        if new:
            return (*selected, new[0])
        return tuple(each for each in selected if each != lights[0])
    last = selected[-1] if selected else ""
    after = lights.index(last) + 1 if last in lights else 0
    return (lights[after % len(lights)],)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Press:
    """A press of a button in a viewport."""

    pixel: Pixel
    button: Qt.MouseButton
    modifiers: Qt.KeyboardModifier
    has_tool: bool
    """Whether a tool of the manipulator is chosen; without one, dragging selects."""
    moves: Moves
    clicked: Callable[[Pixel, bool], None]
    """Receives a click, and whether it adds to the selection."""
    boxed: Callable[[Rectangle, bool], None]
    """Receives the box that was drawn."""

    def hold(self, targets: Targets) -> Hold | None:
        """Return the drag that begins here, or None."""
        gesture, hot = gesture_of(self.button, self.modifiers), targets.at(self.pixel)
        if gesture is None or targets.projection is None:
            return None
        viewer = targets.viewer
        is_plain = not self.modifiers & (
            Qt.KeyboardModifier.AltModifier | Qt.KeyboardModifier.MetaModifier
        )
        if self.button != Qt.MouseButton.LeftButton or not is_plain:
            return NavigatingHold(gesture, self.pixel, self.moves, viewer)
        if hot.is_wipe:
            return WipeHold(self.pixel, viewer)
        if targets.manipulator is not None and hot.handle is not None:
            return HandleHold(
                hot.handle, targets.manipulator, self.pixel, targets.projection, viewer
            )
        adds = bool(self.modifiers & Qt.KeyboardModifier.ShiftModifier)

        def clicked() -> None:
            figures = hot.lights or ((hot.outline,) if hot.outline else ())
            if figures:
                viewer.select(with_lights(viewer.state.selected, figures, adds=adds))
            else:
                self.clicked(self.pixel, adds)

        slack = CLICK * targets.ratio
        if not self.has_tool or self.modifiers & Qt.KeyboardModifier.ControlModifier:
            return BoxHold(
                self.pixel,
                slack=slack,
                clicked=clicked,
                boxed=lambda rectangle: self.boxed(rectangle, adds),
            )
        return NavigatingHold(
            gesture,
            self.pixel,
            self.moves,
            viewer,
            slack=slack,
            clicked=clicked,
        )
