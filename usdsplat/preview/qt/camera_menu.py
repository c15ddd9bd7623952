"""The entries of the Camera menu for cameras of the stage and bookmarks."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from PySide6.QtGui import QAction
from PySide6.QtWidgets import QMenu

from usdsplat.preview.viewer import Viewer


class CameraEntries:
    """Entries below the fixed ones of a menu, made anew each time that it is shown.

    Args:
        menu: The menu, which has its fixed entries.
        viewer: Returns the viewer of the open stage; None without a stage.
    """

    def __init__(self, menu: QMenu, *, viewer: Callable[[], Viewer | None]) -> None:
        self._menu, self._viewer = menu, viewer
        self._entries: list[QAction] = []
        menu.aboutToShow.connect(self._fill)

    def _fill(self) -> None:
        for action in self._entries:
            self._menu.removeAction(action)
            action.deleteLater()
        self._entries = []
        viewer = self._viewer()
        if viewer is None:
            return
        entries: list[tuple[str, Callable[[], Any], bool]] = [
            (path, partial(viewer.use_camera, path), path == viewer.state.camera)
            for path in viewer.cameras
        ]
        entries += [
            (mark.name, partial(viewer.restore, mark.name), False) for mark in viewer.bookmarks
        ]
        for text, act, is_on in entries:
            action = QAction(text, self._menu)
            action.setCheckable(is_on)
            action.setChecked(is_on)
            action.triggered.connect(lambda checked=False, act=act: act())
            self._menu.addAction(action)
            self._entries.append(action)
