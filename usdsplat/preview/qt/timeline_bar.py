"""The timeline bar: play, step, scrub, range, frame and rate."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QHBoxLayout, QLabel, QToolButton, QWidget

from usdsplat.preview.qt.glyphs import glyph
from usdsplat.preview.qt.number_field import NumberField
from usdsplat.preview.qt.panel_context import PanelContext
from usdsplat.preview.qt.timeline_ruler import TimelineRuler
from usdsplat.preview.values import SimulationStatus


class TimelineBar(QWidget):
    """Controls of the viewer's timeline."""

    def __init__(self, context: PanelContext, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._context = context
        viewer = context.viewer
        self.setProperty("role", "bar")
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        line = QHBoxLayout(self)
        line.setContentsMargins(8, 5, 8, 5)
        line.setSpacing(3)
        for icon, words, act in (
            ("to start", "First frame (Home)", self.to_start),
            ("step back", "Previous frame (Left)", lambda: viewer.advance(-1)),
        ):
            line.addWidget(_button(icon, words, act))
        self.play = _button("play", "Play or pause (Space)", self.toggle)
        line.addWidget(self.play)
        for icon, words, act in (
            ("step on", "Next frame (Right)", lambda: viewer.advance(1)),
            ("to end", "Last frame (End)", self.to_end),
        ):
            line.addWidget(_button(icon, words, act))
        self.loop = _button("loop", "Begin again at the end", self._loop)
        self.loop.setCheckable(True)
        line.addWidget(self.loop)
        line.addSpacing(8)
        self.frame = self._field("Frame", viewer.set_time, width=64)
        line.addWidget(self.frame)
        line.addSpacing(8)
        self.start = self._field("First frame", lambda to: self._set_range(start=to))
        line.addWidget(self.start)
        self.ruler = TimelineRuler()
        self.ruler.show_baked(context.baked)
        self.ruler.scrubbed.connect(lambda time: viewer.set_time(time, is_scrubbing=True))
        self.ruler.released.connect(viewer.end_move)
        line.addWidget(self.ruler, 1)
        self.end = self._field("Last frame", lambda to: self._set_range(end=to))
        line.addWidget(self.end)
        line.addSpacing(8)
        self.rate = self._field("Frames per second", self._set_rate, width=46)
        line.addWidget(self.rate)
        unit = QLabel("fps")
        unit.setProperty("role", "quiet")
        line.addWidget(unit)
        context.view_changed.connect(self.follow)
        context.proxy.simulation.connect(self._show_cached)
        self.follow()

    def follow(self) -> None:
        """Show the current state of the timeline."""
        timeline = self._context.viewer.timeline
        self.ruler.show_range(timeline.start, timeline.end)
        self.ruler.show_current(timeline.current if timeline.end > timeline.start else None)
        self.frame.show_value(timeline.current)
        self.start.show_value(timeline.start)
        self.end.show_value(timeline.end)
        self.rate.show_value(timeline.rate)
        self.loop.setChecked(timeline.loops)
        self.play.setIcon(glyph("pause" if timeline.is_playing else "play"))

    def toggle(self) -> None:
        """Play, or stop."""
        self._context.viewer.play(not self._context.viewer.timeline.is_playing)

    def to_start(self) -> None:
        """Show the first frame."""
        self._context.viewer.set_time(self._context.viewer.timeline.start)

    def to_end(self) -> None:
        """Show the last frame."""
        self._context.viewer.set_time(self._context.viewer.timeline.end)

    def _field(self, label: str, set_value: Callable[[float], Any], width: int = 52) -> NumberField:
        field = NumberField(label)
        field.setFixedWidth(width)
        field.setToolTip(label)
        field.entered.connect(lambda value: self._try(lambda: set_value(value)))
        field.refused.connect(self._context.complain)
        return field

    def _try(self, act: Callable[[], Any]) -> None:
        self._context.attempt(act)
        self.follow()

    def _set_range(self, *, start: float | None = None, end: float | None = None) -> None:
        timeline = self._context.viewer.timeline
        timeline.set_range(
            timeline.start if start is None else start, timeline.end if end is None else end
        )
        self._context.viewer.set_time(timeline.current)

    def _set_rate(self, rate: float) -> None:
        self._context.viewer.timeline.set_rate(rate)

    def _loop(self) -> None:
        self._context.viewer.timeline.loops = self.loop.isChecked()

    def _show_cached(self, status: SimulationStatus) -> None:
        self.ruler.show_cached(status.frames)


def _button(icon: str, words: str, act: Callable[[], Any]) -> QToolButton:
    button = QToolButton()
    button.setIcon(glyph(icon))
    button.setToolTip(words)
    button.setFixedSize(26, 26)
    button.setFocusPolicy(Qt.FocusPolicy.NoFocus)
    button.clicked.connect(act)
    return button
