"""The viewport widget: shows a session's pictures and handles mouse and keys.

    viewport = Viewport(viewer)
    proxy.picture.connect(viewport.show_picture)
    viewport.pick_requested.connect(pick)

It paints with QPainter only, so it runs wherever Qt does. Overlays are placed by the displayed
picture, even if the view has moved on since.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
from PySide6.QtCore import QEvent, QPointF, QRectF, QSize, Qt, QTimer, Signal
from PySide6.QtGui import (
    QFocusEvent,
    QImage,
    QKeyEvent,
    QMouseEvent,
    QNativeGestureEvent,
    QPainter,
    QPaintEvent,
    QResizeEvent,
    QWheelEvent,
)
from PySide6.QtWidgets import QWidget

from usdsplat.preview.manipulator import Manipulator, Mode, Space
from usdsplat.preview.overlays import LightMark
from usdsplat.preview.projection import Pixel, Projection
from usdsplat.preview.qt import viewport_painting as painting
from usdsplat.preview.qt.viewport_figures import EdgeLines, placed
from usdsplat.preview.qt.viewport_holds import BoxHold, HandleHold, Hold, NavigatingHold
from usdsplat.preview.qt.viewport_keys import do_key
from usdsplat.preview.qt.viewport_navigation import NOTCH, QUICKER, Moves, notches
from usdsplat.preview.qt.viewport_painting import Badges, Rate, Scene
from usdsplat.preview.qt.viewport_targets import Hot, Press, Targets
from usdsplat.preview.values import Busy, Picture
from usdsplat.preview.viewer import Viewer

REST = 80
"""Time after the last input until the view rests [ms]."""
TICK = 8
"""Interval of ticks of animations [ms]."""


class Viewport(QWidget):
    """The viewport of a viewer.

    Args:
        viewer: Viewer that receives all user input.
        parent: Qt parent.
    """

    pick_requested = Signal(float, float, bool)
    """A click, in pixels of the viewport; whether it adds to the selection."""
    box_requested = Signal(object, bool)
    """A box was drawn: left, top, right, bottom; whether it adds to the selection."""
    focus_requested = Signal(float, float)
    """A double click."""
    probe_moved = Signal(float, float)
    """The pointer is over another pixel, without a button."""
    probe_left = Signal()
    manipulator_changed = Signal()
    """The manipulator's mode or space has changed."""

    def __init__(self, viewer: Viewer, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.viewer = viewer
        self.picture: Picture | None = None
        """The last displayed picture."""
        self.badges = Badges()
        """What is said over the picture."""
        self.side = 0
        """Side of a comparison that is changed, whose name stands out."""
        self.mode: Mode | None = "translate"
        """Mode of the manipulator; None for none."""
        self.space: Space = "world"
        self.shows_hud = True
        self._image = QImage()
        self._edges = EdgeLines(lambda overlays: overlays.edges)
        self._affectors = EdgeLines(lambda overlays: overlays.affectors)
        self._rate = Rate()
        self._moves = Moves()
        self._hold: Hold | None = None
        self._button = Qt.MouseButton.NoButton
        self._keys: set[int] = set()
        self._hot = Hot()
        self._probed: Pixel | None = None
        self._painted_over = self._over()
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setMouseTracking(True)
        self.setMinimumSize(160, 120)
        self._flush = self._timer(0, self._give_moves)
        self._rest = self._timer(REST, self._come_to_rest)
        self._clock = QTimer(self)
        self._clock.setTimerType(Qt.TimerType.PreciseTimer)
        self._clock.timeout.connect(self._tick)
        self.destroyed.connect(viewer.listen(self._viewer_changed))

    # --- display --------------------------------------------------------------------------

    def show_picture(self, picture: Picture) -> None:
        """Show a picture; its image is not copied and must not be modified afterwards."""
        height, width = picture.image.shape[:2]
        pixels = np.ascontiguousarray(picture.image)
        image = QImage(pixels.data, width, height, 3 * width, QImage.Format.Format_RGB888)
        self._image, self.picture = image.convertToFormat(QImage.Format.Format_RGB32), picture
        if picture.state.is_moving:
            self._rate.count(time.monotonic())
        else:
            self._rate.stop()
        self.update()

    def show_busy(self, busy: Busy) -> None:
        """Say what the first picture waits for, or how far the light of the next one is."""
        self.badges.follow(busy)
        self.update()

    def set_mode(self, mode: Mode | None) -> None:
        """Set the mode of the manipulator, or none."""
        self.mode, self._hot = mode, Hot()
        self.manipulator_changed.emit()
        self.update()

    def set_space(self, space: Space) -> None:
        """Set the manipulator's axes: the world's or the prim's own."""
        self.space, self._hot = space, Hot()
        self.manipulator_changed.emit()
        self.update()

    def set_side(self, side: int) -> None:
        """Set the side of a comparison whose name stands out."""
        if side != self.side:
            self.side = side
            self.update()

    def set_hud(self, is_shown: bool) -> None:
        """Show or hide the heads-up display."""
        self.shows_hud = is_shown
        self.update()

    @property
    def projection(self) -> Projection | None:
        """Projection of the displayed picture; None before the first."""
        if self.picture is None:
            return None
        return Projection.of(self.picture.camera, self._size())

    @property
    def manipulator(self) -> Manipulator | None:
        """Manipulator of the last selected prim; None for none."""
        placement = self.viewer.placement
        if self.mode is None or placement is None:
            return None
        return Manipulator(
            matrix=np.reshape(placement.matrix, (4, 4)),
            mode=self.mode,
            space=self.space,
            ratio=self.devicePixelRatioF(),
        )

    @property
    def targets(self) -> Targets:
        """Everything that can be pressed."""
        return Targets(
            viewer=self.viewer,
            projection=self.projection,
            manipulator=self.manipulator,
            lights=self._lights(),
            outlines=() if self.picture is None else self.picture.overlays.affectors,
            ratio=self.devicePixelRatioF(),
        )

    def sizeHint(self) -> QSize:
        return QSize(960, 720)

    # --- painting --------------------------------------------------------------------------

    def paintEvent(self, event: QPaintEvent) -> None:
        painter, state = QPainter(self), self.viewer.state
        if self.picture is None or self.projection is None:
            painting.paint_nothing(painter, QRectF(self.rect()), self.badges.waiting)
            return
        scene = Scene(
            picture=self.picture,
            image=self._image,
            size=self._size(),
            ratio=self.devicePixelRatioF(),
            projection=self.projection,
            state=state,
            lights=self._lights(),
            side=self.side,
            badges=self.badges,
            edges=self._edges.of(self.picture, self._size(), self.projection),
            affectors=self._affectors.of(self.picture, self._size(), self.projection),
            manipulator=self.manipulator,
            hot=self._hot.handle,
            hot_light=self._hot.light,
            wipe=None if state.other is None else state.wipe,
            wipe_is_hot=self._hot.is_wipe,
            box=self._hold.rectangle if isinstance(self._hold, BoxHold) else None,
            dragged=self._hold.words if isinstance(self._hold, HandleHold) else "",
            shows_hud=self.shows_hud,
            rate=self._rate.per_second,
        )
        painting.paint(painter, QRectF(self.rect()), scene)

    # --- mouse -----------------------------------------------------------------------------

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if self._hold is not None:
            return
        self._hold, self._button = self._take(event), event.button()
        if self._hold is not None:
            self.setCursor(self._hold.cursor)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        pixel = self._pixel(event.position())
        if self._hold is None:
            self._hover(pixel)
            return
        self._hold.move(pixel, event.modifiers())
        if isinstance(self._hold, BoxHold):
            self.update()
        else:
            self._soon()

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if self._hold is None or event.button() != self._button:
            return
        self._hold.let_go(self._pixel(event.position()))
        self._let_go()

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        pixel = self._pixel(event.position())
        is_free = self.targets.at(pixel) == Hot()
        if event.button() == Qt.MouseButton.LeftButton and is_free:
            self.focus_requested.emit(*pixel)
        else:
            self.mousePressEvent(event)

    def wheelEvent(self, event: QWheelEvent) -> None:
        amount = notches(event.angleDelta().y() or event.angleDelta().x())
        if isinstance(self._hold, NavigatingHold) and self._hold.gesture == "fly":
            self.viewer.set_speed(self.viewer.speed * QUICKER**amount)
        elif self._hold is None:
            self._moves.zoom(NOTCH * amount)
            self._soon()
        event.accept()

    def leaveEvent(self, event: QEvent) -> None:
        self._hot, self._probed = Hot(), None
        self.probe_left.emit()
        self.update()

    # --- keys ------------------------------------------------------------------------------

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.isAutoRepeat() and self._hold is not None:
            return
        self._keys.add(event.key())
        if self._hold is not None and self._hold.press(self._keys, event.modifiers()):
            self._viewer_changed()
        elif self._hold is not None or not do_key(self, event.key(), event.modifiers()):
            super().keyPressEvent(event)

    def keyReleaseEvent(self, event: QKeyEvent) -> None:
        if event.isAutoRepeat():
            return
        self._keys.discard(event.key())
        if self._hold is not None:
            self._hold.press(self._keys, event.modifiers())
            self._rest.start()

    def focusOutEvent(self, event: QFocusEvent) -> None:
        self._keys.clear()
        if self._hold is not None:
            self._hold.press(self._keys, Qt.KeyboardModifier.NoModifier)
        super().focusOutEvent(event)

    # --- other events ----------------------------------------------------------------------

    def event(self, event: QEvent) -> bool:
        kind = event.type()
        if kind == QEvent.Type.ShortcutOverride and self._hold is not None:
            event.accept()  # flight keys take precedence over shortcuts
            return True
        if kind == QEvent.Type.NativeGesture and isinstance(event, QNativeGestureEvent):
            return self._pinch(event)
        if kind == QEvent.Type.DevicePixelRatioChange:
            self.viewer.resize(*self._size())
        return super().event(event)

    def resizeEvent(self, event: QResizeEvent) -> None:
        self.viewer.resize(*self._size())
        super().resizeEvent(event)

    # --- private ---------------------------------------------------------------------------

    def _take(self, event: QMouseEvent) -> Hold | None:
        """Return the hold that a press begins, or None."""
        pixel, targets = self._pixel(event.position()), self.targets
        press = Press(
            pixel=pixel,
            button=event.button(),
            modifiers=event.modifiers(),
            has_tool=self.mode is not None,
            moves=self._moves,
            clicked=lambda pixel, adds: self.pick_requested.emit(*pixel, adds),
            boxed=self.box_requested.emit,
        )
        hold = press.hold(targets)
        if isinstance(hold, HandleHold):
            self._hot = targets.at(pixel)
        return hold

    def _hover(self, pixel: Pixel) -> None:
        hot = self.targets.at(pixel)
        if hot != self._hot:
            self._hot = hot
            self.setCursor(hot.cursor)
            self.update()
        self._probed = pixel
        self._flush.start()

    def _let_go(self) -> None:
        self._give_moves()
        self._hold = None
        self.setCursor(Qt.CursorShape.ArrowCursor)
        self.viewer.end_move()
        self._rest.stop()
        self.update()

    def _pinch(self, event: QNativeGestureEvent) -> bool:
        if event.gestureType() != Qt.NativeGestureType.ZoomNativeGesture:
            return False
        self._moves.zoom(math.log1p(max(event.value(), -0.9)))
        self._soon()
        return True

    def _soon(self) -> None:
        """Schedule one update of the viewer for this pass of the event loop."""
        self._flush.start()
        self._rest.start()

    def _give_moves(self) -> None:
        if self._moves:
            self._moves.give(self.viewer)
        probed, self._probed = self._probed, None
        if probed is not None:
            self.probe_moved.emit(*probed)

    def _come_to_rest(self) -> None:
        if not self.viewer.is_ticking:
            self.viewer.end_move()

    def _tick(self) -> None:
        self.viewer.tick(time.monotonic())
        self._viewer_changed()

    def _viewer_changed(self) -> None:
        if self.viewer.is_ticking and not self._clock.isActive():
            self._clock.start(TICK)
        elif not self.viewer.is_ticking:
            self._clock.stop()
        before, self._painted_over = self._painted_over, self._over()
        if self._painted_over != before:  # a moved camera shows with its picture only
            self.update()

    def _over(self) -> tuple[object, ...]:
        """Return what is painted of the viewer itself, not of the displayed picture."""
        state = self.viewer.state
        return state.other is None, state.wipe, state.selected, self.viewer.placement, self.side

    def _lights(self) -> tuple[LightMark, ...]:
        """Return the lights of the picture, the selected one where it is now."""
        known = () if self.picture is None else self.picture.overlays.lights
        return placed(known, self.viewer.placement)

    def _pixel(self, position: QPointF) -> Pixel:
        ratio = self.devicePixelRatioF()
        return position.x() * ratio, position.y() * ratio

    def _size(self) -> tuple[int, int]:
        ratio = self.devicePixelRatioF()
        return max(round(self.width() * ratio), 1), max(round(self.height() * ratio), 1)

    def _timer(self, pause: int, call: Callable[[], None]) -> QTimer:
        timer = QTimer(self)
        timer.setSingleShot(True)
        timer.setInterval(pause)
        timer.timeout.connect(call)
        return timer
