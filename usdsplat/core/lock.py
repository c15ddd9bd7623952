"""Keep two processes from writing the same output at the same time."""

from __future__ import annotations

import errno
import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from usdsplat.core.errors import OutputError

if sys.platform != "win32":
    import fcntl

_ATTEMPTS = 3
"""Attempts to open a lock that its holder may be removing; in a folder where no file can be made,
all of them find none."""


@contextmanager
def output_lock(target: Path | str) -> Iterator[None]:
    """Hold the lock of an output: a hidden file beside it, `.NAME.lock`, removed at the end.

    The operating system releases the lock of a process that is killed, so a file that such a
    process leaves does no harm; the next one removes it. All users may open the file, because a
    folder may be shared. Where files cannot be locked, on Windows and on some network file systems,
    nothing is locked.

    Raises:
        OutputError: If another process, or another thread, holds it, if the file belongs to another
            user and cannot be opened, or if it is a symbolic link.
    """
    final = Path(os.path.realpath(target))
    path = final.with_name(f".{final.name}.lock")
    handle = None if sys.platform == "win32" else _locked(path, str(target))
    try:
        yield
    finally:
        if handle is not None:
            _release(handle, path)


def _locked(path: Path, target: str) -> int | None:
    """Return a handle of the locked file; None if the file cannot be made or locked."""
    while True:
        handle, is_held = -1, False
        try:
            handle, is_writable = _opened(path, str(target))
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            is_held = _is_at(handle, path)
            if is_held and is_writable:
                os.ftruncate(handle, 0)
                os.write(handle, f"{os.getpid()} {os.uname().nodename}".encode())
            if is_held:
                return handle
        except BlockingIOError:
            found = f"an output that {_holder(handle)} is writing"
            raise OutputError(target, found, "its end, or another name") from None
        except OutputError:
            raise
        except BaseException as error:
            cannot_lock = isinstance(error, OSError)  # nobody else can hold it then
            if handle >= 0:
                _release(handle, path if is_held or cannot_lock else None)
            if cannot_lock:
                return None
            raise
        os.close(handle)


def _opened(path: Path, target: str) -> tuple[int, bool]:
    """Return a handle of the file of a lock, and whether it is this user's, to write to.

    A link is not followed, and a file with a second name or of another user is locked but neither
    written nor made accessible: in a shared folder, anybody can give a file this name.

    Raises:
        OutputError: If it is a symbolic link, or another user's that cannot be read either.
        OSError: If it cannot be made.
    """
    for _ in range(_ATTEMPTS):
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
        except PermissionError:
            handle = _opened_to_read(path, target)
            if handle >= 0:
                return handle, False  # it can be locked all the same
            continue
        except OSError as error:
            if error.errno == errno.ELOOP:
                found = f"{path.name}, a symbolic link instead of a lock"
                raise OutputError(target, found, "no such link") from error
            raise
        about = os.fstat(handle)
        is_own = stat.S_ISREG(about.st_mode) and about.st_nlink == 1
        is_own = is_own and about.st_uid == os.geteuid()
        if is_own:
            with suppress(OSError):
                os.fchmod(handle, 0o666)  # whatever the umask of this process
        return handle, is_own
    raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))


def _opened_to_read(path: Path, target: str) -> int:
    """Return a handle of a file that cannot be written; -1 if there is none, or none any more."""
    try:
        return os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
    except FileNotFoundError:
        return -1
    except PermissionError as error:
        found = f"{path.name}, the lock of another user"
        raise OutputError(target, found, "a lock that can be read") from error


def _release(handle: int, path: Path | None) -> None:
    """Remove the file of a lock, if it is held, and release the lock."""
    if path is not None:
        with suppress(OSError):
            path.unlink()
    os.close(handle)


def _is_at(handle: int, path: Path) -> bool:
    """Return whether an open file is still at a path; its last holder may have removed it."""
    try:
        return os.path.samestat(os.fstat(handle), os.lstat(path))
    except FileNotFoundError:
        return False


def _holder(handle: int) -> str:
    """Name the process that holds a lock, and close the file."""
    words = os.read(handle, 300).decode(errors="replace").split()
    os.close(handle)
    if len(words) != 2:
        return "another process"
    return f"process {words[0]}" + ("" if words[1] == os.uname().nodename else f" on {words[1]}")
