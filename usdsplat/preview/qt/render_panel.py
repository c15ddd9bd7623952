"""Panel of render settings, display settings and comparison."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtWidgets import (
    QFrame,
    QHBoxLayout,
    QLabel,
    QScrollArea,
    QSizePolicy,
    QTabBar,
    QVBoxLayout,
    QWidget,
)

from usdsplat.preview.display import choices
from usdsplat.preview.kept_view import COLOUR
from usdsplat.preview.knob_model import Editor, editors_of
from usdsplat.preview.qt import style
from usdsplat.preview.qt.adding_lights import LightOffer
from usdsplat.preview.qt.knob_panel import KnobPanel
from usdsplat.preview.qt.knob_widgets import CalmComboBox, TickBox
from usdsplat.preview.qt.number_field import NumberField
from usdsplat.preview.qt.panel_context import PanelContext
from usdsplat.preview.setting_editors import setting_editors, with_setting
from usdsplat.preview.values import Picture

DEVICES = ("auto", "cpu", "cuda")
FIRST = {
    "Splats": ("display_mode", "splat_budget", "sh_degree", "sorting", "rasterize_mode"),
    "Light": (
        "lighting",
        "ambient",
        "self_shadows",
        "shadow_resolution",
        "light_samples",
        "dome_samples",
    ),
    "Levels of detail": ("lod_error", "lod_samples", "node_memory", "node_lifetime"),
    "Colour": COLOUR,
}
"""Group -> knobs; others are in "Sampling"."""


class RenderPanel(QWidget):
    """A panel that edits the viewer's look, the comparison's look, and the display."""

    device_chosen = Signal(str)

    def __init__(
        self, context: PanelContext, *, device: str, parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self._context = context
        self.side = QTabBar()
        self.side.addTab("A")
        self.side.addTab("B")
        self.side.setExpanding(True)
        self.side.setDrawBase(False)
        self.side.setObjectName("sides")
        self.side.currentChanged.connect(context.set_side)
        self.compare = TickBox("Compare A | B")
        self.compare.setToolTip("Compare with B to the right of a draggable line (Shift+W)")
        self.compare.clicked.connect(lambda is_on: self.set_compare(is_on))
        self.aov = CalmComboBox()
        self.aov.activated.connect(lambda index: context.set_look(aov=self.aov.itemText(index)))
        self.has_time = TickBox()
        self.has_time.setToolTip("A separate time instead of the timeline's")
        self.has_time.clicked.connect(self._toggle_time)
        self.time = NumberField("Time", none_label="from the timeline")
        self.time.entered.connect(lambda time: context.set_look(time=time))
        self.time.refused.connect(context.complain)
        self.device = CalmComboBox()
        self.device.addItems(DEVICES)
        self.device.setCurrentText(device)
        self.device.activated.connect(
            lambda index: self.device_chosen.emit(self.device.itemText(index))
        )
        self.used_device = QLabel()
        self.used_device.setProperty("role", "quiet")
        self.used_device.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.lights = LightOffer(context)
        self.settings = KnobPanel()
        self.settings.changed.connect(self._set_setting)
        self.settings.refused.connect(context.complain)
        self.display = KnobPanel()
        self.display.changed.connect(self._set_display)
        self.display.refused.connect(context.complain)
        self._lay_out()
        context.view_changed.connect(self.follow)
        context.proxy.picture.connect(self._show_device)
        self.follow()

    def _offer_aovs(self) -> None:
        """Offer the AOVs of the stage, each with its meaning."""
        found = choices(self._context.viewer.lights)
        if [self.aov.itemText(i) for i in range(self.aov.count())] == [aov.name for aov in found]:
            return
        with QSignalBlocker(self.aov):
            self.aov.clear()
            for aov in found:
                self.aov.addItem(aov.name)
                self.aov.setItemData(self.aov.count() - 1, aov.meaning, _TOOL_TIP)

    def follow(self) -> None:
        """Show the current state."""
        state = self._context.viewer.state
        is_compared = state.other is not None
        self.compare.setChecked(is_compared)
        self.side.setVisible(is_compared)
        if not is_compared and self.side.currentIndex():
            self.side.setCurrentIndex(0)  # calls this method again
            return
        look = self._context.look
        self._offer_aovs()
        self.aov.setCurrentText(look.aov)
        self.has_time.setChecked(look.time is not None)
        self.time.setEnabled(look.time is not None)
        self.time.show_value(look.time)
        self.settings.show_editors(_grouped(setting_editors(look.settings)))
        self.display.show_editors(
            [replace(editor, group="Display") for editor in editors_of(state.display)]
        )

    def set_compare(self, is_on: bool) -> None:
        """Switch the comparison on or off; both looks are equal at first."""
        viewer = self._context.viewer
        viewer.set_other(viewer.state.look if is_on else None)
        if is_on:
            self.side.setCurrentIndex(1)

    # --- private ----------------------------------------------------------------------------

    def _lay_out(self) -> None:
        body = QWidget()
        column = QVBoxLayout(body)
        column.setContentsMargins(0, 6, 0, 6)
        column.setSpacing(4)
        for label, *widgets in (
            ("AOV", self.aov),
            ("Time", self.has_time, self.time),
            ("Device", self.device, self.used_device),
        ):
            column.addLayout(_line(str(label), *widgets))
        column.addWidget(self.display)
        column.addWidget(self.settings)
        column.addStretch(1)
        outer = QVBoxLayout(self)
        outer.setContentsMargins(0, 6, 0, 0)
        outer.setSpacing(4)
        outer.addLayout(_line("", self.compare))
        outer.addWidget(self.side)
        outer.addWidget(self.lights)
        outer.addWidget(scrolling(body), 1)

    def _toggle_time(self, is_on: bool) -> None:
        self._context.set_look(time=self._context.viewer.timeline.current if is_on else None)

    def _set_setting(self, name: str, value: Any, merge: str) -> None:
        self._context.attempt(
            lambda: self._context.set_look(
                settings=with_setting(self._context.look.settings, name, value)
            )
        )
        self.follow()

    def _set_display(self, name: str, value: Any, merge: str) -> None:
        self._context.attempt(lambda: self._context.viewer.set_display(**{name: value}))
        self.follow()

    def _show_device(self, picture: Picture) -> None:
        self.used_device.setText(f"on {picture.device}")


def scrolling(body: QWidget) -> QScrollArea:
    """Wrap a panel in a scroll area."""
    area = QScrollArea()
    area.setWidget(body)
    area.setWidgetResizable(True)
    area.setFrameShape(QFrame.Shape.NoFrame)
    area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    return area


def _line(label: str, *widgets: QWidget) -> QHBoxLayout:
    line = QHBoxLayout()
    line.setContentsMargins(8, 0, 28, 0)
    line.setSpacing(6)
    word = QLabel(label)
    word.setProperty("role", "quiet")
    word.setFixedWidth(style.LABELS)
    line.addWidget(word)
    for number, widget in enumerate(widgets):
        line.addWidget(widget, int(number == len(widgets) - 1 or isinstance(widget, CalmComboBox)))
    return line


def _grouped(editors: tuple[Editor, ...]) -> list[Editor]:
    """Group render settings, frequently used ones first."""
    by_name = {editor.name: editor for editor in editors}
    found = [
        replace(by_name.pop(name), group=group)
        for group, names in FIRST.items()
        for name in names
        if name in by_name
    ]
    return found + [replace(editor, group="Sampling") for editor in by_name.values()]


_TOOL_TIP = Qt.ItemDataRole.ToolTipRole
