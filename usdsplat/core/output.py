"""Write files so that each appears complete or not at all.

A file is written in a private folder beside its target, so that the temporary files of libraries
are in it too. When it is complete, it is checked, synchronised with the disk and renamed to its
target. Then the folder is removed. The files of an `output_group` are renamed together at its end.

A process that is killed leaves its private folders. The next process on the same computer that
writes a file beside them removes them, unless the computer was started anew in between.
"""

from __future__ import annotations

import errno
import functools
import os
import re
import secrets
import shutil
import sys
import zlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from io import BufferedWriter
from pathlib import Path
from typing import Literal

from usdsplat.core import interrupt
from usdsplat.core.errors import EarlierFilesError, OutputError, UsdSplatError
from usdsplat.core.renames import EARLIER, EXPECTED, Move, put_in_place, sync

Existing = Literal["error", "resume", "replace"]
"""Treatment of existing results: raise an error, keep and continue them, or replace them."""

announce: Callable[[str, bool], None] | None = None
"""Called with the path of a private folder and True before the folder is made, and with the path
and False after it was removed. A supervising process learns from it what to remove if this one
ends without doing so."""

_PREFIX = ".usdsplat-"
_PRIVATE = re.compile(re.escape(_PREFIX) + r"([0-9a-f]{8})-([0-9]{1,9})-[0-9a-f]{8}")
_NO_ROOM = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG, errno.EIO}
"""Errors of a write, which have no file name."""
_searched: set[Path] = set()
"""Folders that were searched for what killed processes left."""


@dataclass(frozen=True, slots=True)
class OutputFile:
    """A file that is being written, under a temporary path.

    The temporary name is ASCII and ends in the target's last two suffixes, so that writers that
    choose a format by suffix (".exr", ".compressed.ply") choose the same one.
    """

    target: str
    """Name of the result, for messages."""
    path: Path
    """Path to write to; its folder is private and can hold further temporary files."""

    def open(self) -> BufferedWriter:
        """Open the temporary file to write bytes."""
        return self.path.open("wb")

    @property
    def text(self) -> str:
        """The temporary path, for libraries that only take text.

        Raises:
            OutputError: If the name of a folder above is not valid in the file system's encoding.
        """
        try:
            str(self.path).encode()
        except UnicodeEncodeError as error:
            found = "a folder whose name is not UTF-8"
            raise OutputError(self.target, found, "a folder with a name in UTF-8") from error
        return str(self.path)


@contextmanager
def output_file(
    target: Path | str, *, is_whole: Callable[[Path], bool] | None = None
) -> Iterator[OutputFile]:
    """Write a file that appears at `target` when the block ends, and not at all on any error.

    An existing file at `target` stays untouched until it is replaced by a rename. A symbolic link
    is followed, not replaced.

    Args:
        target: Path of the result.
        is_whole: Returns whether the file that was written is complete, for formats whose
            libraries do not report all errors.

    Raises:
        OutputError: If the folder is missing or not writable, if `target` exists and is not a plain
            file, or if the file cannot be written completely.
        Interrupted: If the process was asked to end, see `core.interrupt`.
    """
    final = Path(os.path.realpath(target))
    _check(target, final)
    group = _GROUP.get()
    with ExitStack() as stack:
        output = OutputFile(str(target), final.parent / _new_name() / _plain_name(final.name))
        with _explained(output):
            stack.enter_context(_private_folder(output.path.parent))
            yield output
            if not output.path.is_file() or not (is_whole is None or is_whole(output.path)):
                raise OutputError(str(target), "a truncated file", EXPECTED)
            sync(output.path)
        move = Move(output.target, output.path, final, output.path.parent)
        if group is None:
            interrupt.check()
            put_in_place([move])
        else:
            group.moves.append(move)
            group.stack.push(stack.pop_all())


def write_output(target: Path | str, data: bytes | memoryview) -> None:
    """Write `data` as the file `target`, see `output_file`.

    Raises:
        OutputError: As `output_file` does.
    """
    with output_file(target) as output, output.open() as file:
        file.write(data)


@dataclass(slots=True, eq=False)
class OutputGroup:
    """The files of an `output_group`, which are complete but not yet in place."""

    moves: list[Move] = field(default_factory=list)
    stack: ExitStack = field(default_factory=ExitStack)
    """Removes the private folders."""
    _made: list[Path] = field(default_factory=list)
    _unneeded: list[Path] = field(default_factory=list)

    def place_folder(self, made: Path, target: Path) -> None:
        """Put a finished folder in place with the files, instead of an existing one.

        Args:
            made: The folder, in the private folder of a file of the group that will be beside
                `target`.
            target: Path of the result.

        Raises:
            OutputError: If a file in it cannot be synchronised with the disk.
        """
        output = OutputFile(str(target), made)
        with _explained(output):
            for path in sorted(made.rglob("*")):
                if path.is_file():
                    sync(path)
        folder = next(parent for parent in made.parents if is_private(parent.name))
        self.moves.append(Move(str(target), made, target, folder))

    def make_folder(self, folder: Path) -> None:
        """Make a folder now; it is removed if the group fails."""
        folder.mkdir()
        self._made.append(folder)

    def remove_later(self, path: Path) -> None:
        """Remove a file after all others are in place, if that is possible."""
        self._unneeded.append(path)

    def finish(self) -> None:
        """Put everything in place, or nothing."""
        interrupt.check()
        put_in_place(self.moves)
        self._made.clear()
        for path in self._unneeded:
            with suppress(OSError):  # the new files are complete without the removal
                path.unlink()

    def remove_made(self) -> None:
        """Remove the folders that were made, if the group failed."""
        for folder in reversed(self._made):
            with suppress(OSError):  # somebody else's files are in it
                folder.rmdir()


_GROUP: ContextVar[OutputGroup | None] = ContextVar("group", default=None)


@contextmanager
def output_group() -> Iterator[OutputGroup]:
    """Put all output files of the block in place when it ends, and none of them on any error.

    If one of the renames fails, those before it are undone. Only a process that is killed between
    two renames leaves some new and some old files. A group within another one belongs to it. The
    files must be written by the thread that entered the block.

    Raises:
        OutputError: If a file cannot be put in place.
    """
    outer = _GROUP.get()
    if outer is not None:
        yield outer
        return
    group = OutputGroup()
    token = _GROUP.set(group)
    try:
        with group.stack:  # which has to know the error, see `_private_folder`
            yield group
            group.finish()
    finally:
        _GROUP.reset(token)
        group.remove_made()


def remove_left_folder(folder: Path) -> None:
    """Remove a private folder of a process that has ended.

    What the process had moved away to replace it, and did not replace, is moved back.
    """
    with suppress(OSError):
        for kept in (folder / EARLIER).iterdir():
            final = folder.parent / kept.name
            if not os.path.lexists(final):
                os.replace(kept, final)
    shutil.rmtree(folder, ignore_errors=True)


def remove_stale(folder: Path) -> None:
    """Remove the private folders in a folder of processes of this computer that were killed."""
    if sys.platform == "win32":  # there, os.kill ends processes
        return
    with suppress(OSError):
        for name in os.listdir(folder):
            found = _PRIVATE.fullmatch(name)
            if found and found[1] == _computer() and _has_ended(int(found[2])):
                remove_left_folder(folder / name)


def is_private(name: str) -> bool:
    """Return whether a file name is that of a private folder."""
    return _PRIVATE.fullmatch(name) is not None


# --- private -------------------------------------------------------------------------------


@contextmanager
def _private_folder(folder: Path) -> Iterator[None]:
    """Make a private folder, and remove it with all its files, also on Ctrl-C; not if earlier
    results are left in it."""
    if folder.parent not in _searched:
        _searched.add(folder.parent)
        remove_stale(folder.parent)
    is_needed = False
    try:
        if announce is not None:
            announce(str(folder), True)
        folder.mkdir(mode=0o700)
        yield
    except EarlierFilesError as error:
        is_needed = folder in error.folders
        raise
    finally:
        if not is_needed:
            shutil.rmtree(folder, ignore_errors=True)
        if announce is not None:
            announce(str(folder), False)


@contextmanager
def _explained(output: OutputFile) -> Iterator[None]:
    """Convert errors of the operating system about the output to OutputError; others pass."""
    try:
        yield
    except UsdSplatError:
        raise
    except OSError as error:
        named = (error.filename, error.filename2)
        places = [os.fsdecode(name) for name in named if isinstance(name, str | bytes)]
        is_ours = any(place.startswith(str(output.path.parent)) for place in places)
        if not is_ours and (places or error.errno not in _NO_ROOM):
            raise
        raise OutputError(output.target, error.strerror or str(error), EXPECTED) from error


def _new_name() -> str:
    """Return an unused name for a private folder of this process."""
    return f"{_PREFIX}{_computer()}-{os.getpid()}-{secrets.token_hex(4)}"


def _plain_name(name: str) -> str:
    """Return an ASCII name with the last two suffixes of `name`."""
    suffixes = [end for end in Path(name).suffixes[-2:] if re.fullmatch(r"\.[A-Za-z0-9_]+", end)]
    return "output" + "".join(suffixes)


@functools.cache
def _computer() -> str:
    """Return 8 hexadecimal digits for this computer since it was started, and its numbering of
    processes, which a container has of its own.

    Computers made from one image may share name and machine id; the id of their start differs.
    """
    parts = [os.uname().nodename if hasattr(os, "uname") else ""]
    for name in ("/etc/machine-id", "/proc/sys/kernel/random/boot_id"):
        with suppress(OSError):
            parts.append(Path(name).read_text(encoding="ascii", errors="replace"))
    with suppress(OSError):
        parts.append(str(os.stat("/proc/self/ns/pid").st_ino))
    return f"{zlib.crc32(chr(0).join(parts).encode(errors='replace')):08x}"


def _has_ended(process: int) -> bool:
    """Return whether no process of this computer has this number, or only one whose parent has not
    asked for its status, as in containers whose first process does not."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    except OSError:
        return False
    with suppress(OSError):  # other systems have no such file
        stat = Path(f"/proc/{process}/stat").read_bytes()
        return stat.rpartition(b")")[2].split()[:1] == [b"Z"]
    return False


def _check(target: Path | str, final: Path) -> None:
    """Raise an error early for a target that would fail, or be damaged, at the rename."""
    if not final.parent.is_dir():
        raise OutputError(str(target), f"no folder {final.parent}", "an existing folder")
    if not os.access(final.parent, os.W_OK | os.X_OK):
        raise OutputError(str(target), "a folder without write permission", "a writable folder")
    if final.exists() and not final.is_file():
        raise OutputError(str(target), "something that is not a plain file", "a file or a new name")
