"""Track the files that a stage was read from, and detect which have changed on disk."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

Stamp = tuple[int, int] | None
"""Modification time [ns] and size [byte] of a file; None if it does not exist."""


class Sources:
    """The files that were read, with their stamps at that time.

    Args:
        path: File that was opened.
        is_capture: Whether it is a capture rather than a stage.
        axes: Directions of the capture's x, y and z axes, if a user gave them.
    """

    def __init__(self, path: Path, *, is_capture: bool = False, axes: str | None = None) -> None:
        self.path = path
        self.is_capture = is_capture
        self.axes = axes
        self._stamps: dict[Path, Stamp] = {}

    def note(self, files: Iterable[Path]) -> None:
        """Add files; the stamp of one that is known already stays."""
        for path in files:
            self._stamps.setdefault(path, _stamp(path))

    def forget(self) -> None:
        """Forget all files, before all of them are read again."""
        self._stamps.clear()

    def changed(self) -> tuple[Path, ...]:
        """Return the files that changed or disappeared, sorted."""
        return tuple(sorted(path for path, was in self._stamps.items() if _stamp(path) != was))


def files_of_capture(path: Path) -> list[Path]:
    """Return the files of a capture: the file itself, or all files of its unpacked folder."""
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
