"""The files that a stage was read from, and whether they are other on disk by now."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

Stamp = tuple[int, int] | None
"""When a file was written last [ns], and its size [byte]; None for one that is gone."""


class Sources:
    """What was read, and how it was then.

    Args:
        path: What was opened.
        is_capture: Whether it is a capture, rather than a stage.
        axes: Where x, y and z of the capture point, if a user said so.
    """

    def __init__(self, path: Path, *, is_capture: bool = False, axes: str | None = None) -> None:
        self.path = path
        self.is_capture = is_capture
        self.axes = axes
        self._stamps: dict[Path, Stamp] = {}

    def note(self, files: Iterable[Path]) -> None:
        """Add files that are read as well; how one is that is known already was noted then."""
        for path in files:
            self._stamps.setdefault(path, _stamp(path))

    def forget(self) -> None:
        """Take nothing as read, before all of it is read again."""
        self._stamps.clear()

    def changed(self) -> tuple[Path, ...]:
        """The files that are other than they were, or gone; sorted."""
        return tuple(sorted(path for path, was in self._stamps.items() if _stamp(path) != was))


def files_of_capture(path: Path) -> list[Path]:
    """What a capture is read from: the file, or all files of an unpacked one's folder."""
    folder = path if path.is_dir() else path.parent if path.name.lower() == "meta.json" else None
    if folder is None:
        return [path]
    return [Path(entry) for entry in os.scandir(folder) if entry.is_file()]


def _stamp(path: Path) -> Stamp:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size
