"""Synchronise files with the disk, and put them in place by renames: all of them, or none."""

from __future__ import annotations

import errno
import os
import secrets
from dataclasses import dataclass
from pathlib import Path

from usdsplat.core.errors import EarlierFilesError, OutputError

EXPECTED = "a writable place with enough free space"
_RESCUED = "usdsplat-earlier-"
"""Start of the name of a folder with earlier results that could not be put back."""
EARLIER = "earlier"
"""Folder in a private folder that keeps replaced results while a group is renamed."""
_NO_SYNC = {errno.EINVAL, errno.ENOSYS, errno.ENOTSUP}
"""Errors of fsync on file systems that do not have it."""


@dataclass(frozen=True, slots=True)
class Move:
    """A rename that puts a result in place."""

    target: str
    """Name of the result, for messages."""
    made: Path
    """The complete file or folder."""
    final: Path
    """Its path."""
    folder: Path
    """Private folder, beside `final`."""

    @property
    def kept(self) -> Path:
        """Path of the earlier result while a group is renamed."""
        return self.folder / EARLIER / self.final.name

    def keep_earlier(self) -> None:
        """Keep the existing result for `undo`."""
        if not os.path.lexists(self.final):
            return
        self.kept.parent.mkdir(exist_ok=True)
        try:
            os.link(self.final, self.kept)
        except OSError:  # a folder, or a file system without hard links
            os.replace(self.final, self.kept)

    def undo(self) -> None:
        """Restore the existing result, or remove the new one."""
        if os.path.lexists(self.kept):
            if self.final.is_dir():
                os.replace(self.final, self.made)
            os.replace(self.kept, self.final)
        elif not os.path.lexists(self.made) and os.path.lexists(self.final):
            os.replace(self.final, self.made)


def put_in_place(moves: list[Move]) -> None:
    """Rename all results to their targets, or none.

    Raises:
        OutputError: If one cannot be renamed.
        EarlierFilesError: If an earlier result cannot be put back either; the message says in which
            folder it is kept.
    """
    kept: list[Move] = []
    target = ""
    try:
        for move in moves:
            target = move.target
            if len(moves) > 1:  # a single rename happens or does not
                kept.append(move)
                move.keep_earlier()
            os.replace(move.made, move.final)
    except BaseException as error:
        places = _undo(kept)
        if not (places or isinstance(error, OSError)):
            raise
        found = (isinstance(error, OSError) and error.strerror) or str(error) or "an interruption"
        if places:
            names = " and ".join(map(str, places))
            found += f"; earlier files that could not be put back are in {names}"
            folders = {place.parent for place in places}  # those of other places are not private
            raise EarlierFilesError(target, found, EXPECTED, folders) from error
        raise OutputError(target, found, EXPECTED) from error
    for folder, target in {move.final.parent: move.target for move in moves}.items():
        _sync_folder(folder, target)


def _undo(kept: list[Move]) -> list[Path]:
    """Undo renames, and return the folders of the earlier results that could not be put back."""
    left: dict[Path, Path] = {}
    for move in reversed(kept):
        try:
            move.undo()
        except OSError:
            if os.path.lexists(move.kept):
                left[move.kept.parent] = move.final.parent
    return [_rescued(folder, beside) for folder, beside in left.items()]


def _rescued(folder: Path, beside: Path) -> Path:
    """Move a folder of earlier results out of its private folder, which is about to be removed;
    return its path, which is the same if that fails."""
    place = beside / f"{_RESCUED}{secrets.token_hex(4)}"
    try:
        os.replace(folder, place)
    except OSError:
        return folder
    return place


def sync(path: Path) -> None:
    """Write a file to the disk; this reports delayed errors of earlier writes."""
    handle = os.open(path, os.O_RDONLY if os.name == "posix" else os.O_RDWR)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in _NO_SYNC:
            raise
    finally:
        os.close(handle)


def _sync_folder(folder: Path, target: str) -> None:
    """Write the names in a folder to the disk, where a folder can be opened for that."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:  # on Windows, or a folder that can be written but not read
        return
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in _NO_SYNC:
            raise OutputError(target, error.strerror or str(error), EXPECTED) from error
    finally:
        os.close(handle)
