"""What windows remember from one run to the next: their size and place, and the last files."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QByteArray, QSettings, QSize
from PySide6.QtWidgets import QWidget

SIZE = QSize(1600, 1000)
"""Size of the first window [pixel], on a screen that has room for it."""
SHARE = 0.92
"""Largest part of the screen, along each side, that a first window takes."""
MOST = 12
"""Number of files that are remembered."""
_GEOMETRY, _FILES = "window/geometry", "files/recent"


def place(window: QWidget) -> None:
    """Give a window the size and place of the last one that was closed, or fit it to its screen."""
    kept = _settings().value(_GEOMETRY)
    if isinstance(kept, QByteArray) and window.restoreGeometry(kept):
        return
    room = window.screen().availableGeometry()
    size = SIZE.boundedTo(room.size() * SHARE)
    window.resize(size)
    window.move(room.center() - window.rect().center())


def keep_place(window: QWidget) -> None:
    """Remember the size and place of a window."""
    _settings().setValue(_GEOMETRY, window.saveGeometry())


def recent_files() -> tuple[Path, ...]:
    """Return the files that were opened last, the newest first."""
    kept = _settings().value(_FILES)
    if isinstance(kept, str):  # Qt's form of a list with one text
        return (Path(kept),)
    return tuple(Path(name) for name in kept) if isinstance(kept, list) else ()


def note_file(path: Path) -> None:
    """Remember a file that was opened."""
    newest = path.absolute()
    others = [each for each in recent_files() if each != newest]
    _settings().setValue(_FILES, [str(each) for each in (newest, *others)][:MOST])


def forget_files() -> None:
    """Forget all files."""
    _settings().remove(_FILES)


def _settings() -> QSettings:
    scope = QSettings.Scope.UserScope
    return QSettings(QSettings.Format.IniFormat, scope, "usdsplat", "usdsplat")
