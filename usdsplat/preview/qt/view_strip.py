"""The strip above the viewport: camera, AOV, channel, exposure."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import QSignalBlocker, Qt
from PySide6.QtGui import QAction, QResizeEvent
from PySide6.QtWidgets import (
    QComboBox,
    QHBoxLayout,
    QLabel,
    QMenu,
    QPushButton,
    QToolButton,
    QWidget,
)

from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.display import choices
from usdsplat.preview.qt import style
from usdsplat.preview.qt.knob_widgets import CalmComboBox
from usdsplat.preview.qt.number_field import NumberField
from usdsplat.preview.qt.panel_context import PanelContext

CHANNELS = ("rgb", "red", "green", "blue", "alpha", "luminance")
CAMERA = (84, 150)
"""Least and usual width of the menu of cameras [pixel]."""
FREE, ALL = "Free camera", "Frame everything"


class ViewStrip(QWidget):
    """A strip of the most used view controls."""

    def __init__(
        self, context: PanelContext, *, bookmarks: QMenu, parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self._context = context
        self.camera = _choices("Camera to look through", CAMERA[0])
        self.camera.setMaximumWidth(CAMERA[1])
        self.camera.activated.connect(self._use_camera)
        self.aov = _choices("What is shown of each pixel ([ and ])", 110)
        self.aov.activated.connect(lambda index: context.set_look(aov=self.aov.itemText(index)))
        self.channel = _choices("Channels of color (Shift+R G B A L)", 88)
        self.channel.addItems(CHANNELS)
        self.channel.activated.connect(
            lambda index: context.viewer.set_display(channel=self.channel.itemText(index))
        )
        self.exposure = NumberField("Exposure", unit="stop", step=0.5)
        self.exposure.setFixedWidth(74)
        self.exposure.setToolTip("Exposure of the picture on the screen (, and . and /)")
        self.exposure.entered.connect(self._expose)
        self.exposure.refused.connect(context.complain)
        marks = QPushButton("Bookmarks")
        marks.setMenu(bookmarks)
        self._line = line = QHBoxLayout(self)
        line.setContentsMargins(8, 4, 8, 4)
        line.setSpacing(6)
        labels: dict[str, QLabel] = {}
        for word, widget in (
            ("Camera", self.camera),
            ("AOV", self.aov),
            ("", self.channel),
            ("Exposure", self.exposure),
        ):
            if word:
                label = QLabel(word)
                label.setProperty("role", "quiet")
                line.addWidget(label)
                labels[word] = label
            line.addWidget(widget, 100 * (widget is self.camera))
            line.addSpacing(style.GAP)
        line.addStretch(1)
        line.addWidget(marks)
        self.aov_label = labels["AOV"]
        self._spare: tuple[QWidget, ...] = (*labels.values(), self.exposure, self.channel, marks)
        """Widgets that are hidden first if there is not enough room."""
        context.view_changed.connect(self.follow)
        self.follow()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Show as many widgets as there is room for."""
        super().resizeEvent(event)
        line = self.layout()
        assert line is not None

        def fits() -> bool:
            return line.minimumSize().width() <= self.width()

        self.camera.setMinimumWidth(CAMERA[1])
        for each in (*self._spare, self.aov):
            each.show()
        for each in self._spare:
            if fits():
                return
            each.hide()
        if not fits():
            self.camera.setMinimumWidth(CAMERA[0])
        if not fits():
            self.aov.hide()

    def show_tools(self, actions: Sequence[QAction]) -> None:
        """Show buttons of the window's actions at the left."""
        for place, action in enumerate(actions):
            button = QToolButton()
            button.setDefaultAction(action)
            button.setToolTip(f"{action.text()} ({action.shortcut().toString()})")
            button.setFocusPolicy(Qt.FocusPolicy.NoFocus)
            self._line.insertWidget(place, button)
        self._line.insertSpacing(len(actions), style.GAP)

    def follow(self) -> None:
        """Show the current state."""
        viewer = self._context.viewer
        state = viewer.state
        with QSignalBlocker(self.camera):
            wanted = [ALL, FREE, *viewer.cameras]
            if [self.camera.itemText(i) for i in range(self.camera.count())] != wanted:
                self.camera.clear()
                self.camera.addItems(wanted)
            if isinstance(state.camera, FreeCamera):
                self.camera.setCurrentText(FREE)
            else:
                self.camera.setCurrentText(state.camera or ALL)
        with QSignalBlocker(self.aov):
            names = [aov.name for aov in choices(viewer.lights)]
            if [self.aov.itemText(i) for i in range(self.aov.count())] != names:
                self.aov.clear()
                self.aov.addItems(names)
            self.aov.setCurrentText(self._context.look.aov)
        side = "" if state.other is None else f"{'AB'[self._context.side]} · "
        self.aov_label.setText(f"{side}AOV")
        self.channel.setCurrentText(state.display.channel)
        self.exposure.show_value(state.display.exposure)

    def _use_camera(self, index: int) -> None:
        viewer = self._context.viewer
        if index == 0:
            viewer.use_camera(None)
        elif index == 1:
            viewer.use_camera(viewer.free_camera())
        else:
            viewer.use_camera(self.camera.itemText(index))

    def _expose(self, stops: float) -> None:
        self._context.attempt(lambda: self._context.viewer.set_display(exposure=stops))
        self.follow()


def _choices(words: str, width: int) -> QComboBox:
    box = CalmComboBox()
    box.setToolTip(words)
    box.setMinimumWidth(width)
    return box
