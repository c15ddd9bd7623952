"""The menu of the files that were opened last."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path

from PySide6.QtWidgets import QMenu, QWidget

from usdsplat.preview.qt import remembered


class RecentMenu(QMenu):
    """Entries for the last files, made anew each time that it is shown.

    Args:
        parent: Its window.
        opens: Receives the file that is chosen.
    """

    def __init__(self, parent: QWidget, *, opens: Callable[[Path], None]) -> None:
        super().__init__("Open recent", parent)
        self._opens = opens
        self.setToolTipsVisible(True)
        self.aboutToShow.connect(self._fill)

    def _fill(self) -> None:
        self.clear()
        files = remembered.recent_files()
        for path in files:
            action = self.addAction(path.name)
            action.setToolTip(str(path))
            action.setEnabled(os.path.exists(path))  # False too where nobody may look
            action.triggered.connect(partial(self._choose, path))
        if files:
            self.addSeparator()
        forget = self.addAction("Forget these", remembered.forget_files)
        forget.setEnabled(bool(files))

    def _choose(self, path: Path, _: bool = False) -> None:
        self._opens(path)
